"""Looks at the motion suite: what the camera sees with the detections, and truth and fits from there and from the side.

python -m benchmarks.motion_sheets SHEET.png [NAMES]
    [--fits before/fits/true/tcfit after/fits/true/tcfit]
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import tyro
from jaxtyping import Float, UInt8
from tyro.conf import Positional

from evaluation.synthetic.motion_suite.clips import MotionClipMade, make_motion, motion_sequences
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.mesh import shared_mesh
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.io.result_files import read_fit
from fitting_core.keypoints import BODY, BONES
from fitting_core.render.renderer import Renderer
from fitting_core.render.sheets import Cell, View, beside, write_sheet
from fitting_core.shipped import FREE_FOLDER

_HEIGHT = 300
"""Of a picture, pixels."""
_UPRIGHT = np.array([1.0, -1.0, -1.0])
"""Camera space to the world of render.sheets."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to draw."""

    sheet: Positional[Path]
    """The picture to write."""
    names: Positional[tuple[str, ...]] = ()
    """Sequences; none: all."""
    fits: tuple[Path, ...] = ()
    """Folders with a fit for each sequence, as `python -m evaluation motion` leaves them; none: the truth alone."""
    moments: tuple[float, ...] = field(default=(0.5,))
    """Where in each clip, 0 to 1."""


def main(options: Options) -> None:
    """Draw and write."""
    cells = []
    for name in options.names or motion_sequences():
        if name not in motion_sequences():
            raise InputError(f"The motion suite has no {name}, only {', '.join(motion_sequences())}.")
        made = make_motion(motion_sequences()[name])
        cells += [_cell(made, round(moment * (len(made.clip) - 1)), options.fits) for moment in options.moments]
    write_sheet(options.sheet, cells, 2)


def _cell(made: MotionClipMade, frame: int, fits: Sequence[Path]) -> Cell:
    true = shared_mesh(made.body)(made.truth.params[[frame]])[0].double().numpy()
    pictures = [_seen(made, frame, true)]
    bodies = [(true, (0.55, 0.7, 0.85))]
    for folder in fits:
        body = load_body(find_body(search=FREE_FOLDER))
        found = shared_mesh(body)(read_fit(folder / made.sequence.name).params[[frame]])[0].double().numpy()
        bodies.append((found, (0.9, 0.65, 0.5)))
    for vertices, color in bodies:
        points = vertices * _UPRIGHT
        center = tuple((points.min(axis=0) + points.max(axis=0)) / 2)
        for degrees in (0.0, 90.0):
            view = View(center=center, extent=1.9, degrees=degrees, size=(200, _HEIGHT))
            drawn = Renderer(view.camera).render(view.camera_space(points), made.body.faces, color=color)
            pictures.append(drawn)
    shot = made.sequence.shot
    told = f"{made.sequence.name} {made.directions[frame]} {shot.elevation:.0f} deg, {shot.lens:.0f} mm, {shot.cut}"
    return Cell(picture=beside(pictures), caption=f"{told}, frame {frame}: camera, truth, fits")


def _seen(made: MotionClipMade, frame: int, vertices: Float[np.ndarray, "V 3"]) -> UInt8[np.ndarray, "H W 3"]:
    """The camera's picture with the detected bones: the darker the surer."""
    camera = made.truth.camera
    scale = _HEIGHT / camera.size[1]
    small = Camera(
        focal=(scale * camera.focal[0], scale * camera.focal[1]),
        center=(scale * camera.center[0], scale * camera.center[1]),
        size=(round(scale * camera.size[0]), _HEIGHT),
    )
    picture = np.ascontiguousarray(Renderer(small).render(vertices, made.body.faces))
    xy, confidence = made.clip.keypoints.xy[frame], made.clip.keypoints.confidence[frame]
    for a, b in BONES:
        if max(a, b) < BODY.stop and min(confidence[a], confidence[b]) > 0:
            ends = [tuple(int(v) for v in scale * xy[i]) for i in (a, b)]
            light = int(230 * (1 - min(confidence[a], confidence[b])))
            cv2.line(picture, ends[0], ends[1], (220, light, light), 2, cv2.LINE_AA)
    cv2.rectangle(picture, (0, 0), (small.size[0] - 1, _HEIGHT - 1), (120, 120, 120), 1)
    return picture


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        sys.exit(str(error))
