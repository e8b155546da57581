"""The commands behind every figure that the project states: `python -m benchmarks.NAME --help`.

Each compares two or more things in one run, prints a table in Markdown, and writes what it measured with `--json`.
Run them from the repository's root. They need the development data (see clips.py), which is not part of the project.

    accuracy     how right fits are, on everything that can judge them: for each change to the method
    real_clips   quality of the presets on real footage, phase 1 against the last one
    solvers      lm against lbfgs: objective, seconds and evaluations from the same start on the same cost
    speed        how fast fits are, by phase and length, with their memory; ways to fit against each other
    profile      where the time of a fit goes
    recover_poses  whether a fit of noise-free keypoints returns hard poses
    live         what a move of a live correction costs, against a plain re-run
"""
