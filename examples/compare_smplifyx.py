"""Compare SMPLify-X, every frame on its own, with the temporally consistent fit.

python examples/compare_smplifyx.py walk.mp4 [reference]
"""

import sys
from dataclasses import replace

from fitting_core import PRESETS, evaluate_fit, figure_titles, find_body, fit_clip, load_body, read_clip
from fitting_core.config.schema import without_collisions


def main(video: str, reference: str | None = None) -> None:
    clip, body = read_clip(video), load_body(find_body(gender="neutral"))
    methods = {
        # Phase 1 is all that SMPLify-X does. Its self-collision term takes 4 s a frame.
        "SMPLify-X": replace(without_collisions(PRESETS["smplifyx"]), last_phase=1),
        "tcfit": PRESETS["tcfit"],
    }
    found = {
        name: evaluate_fit(fit_clip(clip, body, config), clip, body, reference, surfaces=False).figures
        for name, config in methods.items()
    }
    print(f"{'':50}" + "".join(f"{name:>12}" for name in methods))
    for figure, (title, unit, _) in figure_titles().items():
        values = [figures[figure] for figures in found.values()]
        if all(value is not None for value in values):
            print(f"{f'{title}, {unit}':50}" + "".join(f"{value:12.2f}" for value in values))


if __name__ == "__main__":
    main(*sys.argv[1:])
