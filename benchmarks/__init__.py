"""The commands behind the project's figures: `python -m benchmarks.NAME --help`.

Each compares two or more things in one run and prints a table in Markdown. `--json` writes the figures, and `--results`
writes the table with its command, date and commit into a file of `evaluation/RESULTS`. Run them from the repository's
root. They need the development data (see clips.py), which is not part of the project.

    accuracy        errors on everything that can judge a fit: run it before and after each change to the method
    real_clips      the presets on real footage, phase 1 against the last phase
    standing        upright people: trunk and knees
    ground          gravity, contacts and floor on the motion suite
    error_bars      error bars beside true errors, and the table that widens them
    keypoint_noise  noise of each keypoint by detector
    detector        the embedded detector: confidence, hands, speed
    speed           fits, detection and start in units of this computer, beside the committed values
    live            time of one move of a live correction
    review          time of the app in a browser: opening, seeking, dragging
    screenshots, screencast  pictures and the film of the documentation
"""
