"""A frame of a fit with its markers, from the front and from the side, and a joint angle over the clip.

python -m benchmarks.laboratory_picture RESULT docs/images/laboratories.jpg
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro
from jaxtyping import Float, UInt8
from tyro.conf import Positional

from benchmarks.marker_picture import picture_of
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.markers.marker_set import STANDARD, marker_places
from fitting_core.io.motion_files import stored_motion
from fitting_core.io.result_files import read_fit
from fitting_core.measure.angles.joint_angles import joint_angles
from fitting_core.render.sheets import View, beside

Image = UInt8[np.ndarray, "H W 3"]
_SIZE = (330, 560)
_CHART = (540, 560)
_MARGIN = (60, 24, 24, 48)
"""Pixels to the left, above, to the right, below."""
_COLORS = {"left": (200, 60, 40), "right": (30, 80, 200)}
_INK, _LINE = (40, 40, 40), (205, 205, 205)


@dataclass(frozen=True, kw_only=True)
class LaboratoryPicture:
    """What is drawn, and where it goes."""

    result: Positional[Path]
    """A folder that tcfit fit wrote."""
    out: Positional[Path]
    frame: int = 60
    """From 0."""
    angle: str = "elbow_flexion"
    """Of both sides."""


def main(options: LaboratoryPicture) -> None:
    """Draw and write it."""
    stored = read_fit(options.result)
    body = load_body(find_body(gender=stored.gender))
    motion = stored_motion(stored, body, name=options.result.resolve().name).in_axes("y-up")
    one = motion[options.frame : options.frame + 1]
    vertices, places = next(iter(one.vertices())), marker_places(body, one.params, STANDARD)[0]
    middle = (vertices.min(0) + vertices.max(0)) / 2
    center = (float(middle[0]), float(middle[1]), float(middle[2]))
    pictures = [
        picture_of(body, vertices, places, View(center=center, extent=1.06, degrees=degrees, size=_SIZE), named=False)
        for degrees in (0, 90)
    ]
    angles = joint_angles(motion)
    curves = {side: angles[f"{side}_{options.angle}"] for side in _COLORS}
    chart = _chart(curves, options.angle.replace("_", " "), motion.frame_rate, options.frame)
    cv2.imwrite(
        str(options.out), cv2.cvtColor(beside([*pictures, chart]), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88]
    )


def _chart(curves: dict[str, Float[np.ndarray, "T"]], name: str, frame_rate: float, frame: int) -> Image:
    """Degrees over seconds, with a line at a frame."""
    image = np.full((_CHART[1], _CHART[0], 3), 255, np.uint8)
    left, top, right, bottom = _MARGIN
    seconds = np.arange(len(next(iter(curves.values())))) / frame_rate
    values = np.concatenate(list(curves.values()))
    low, high = 20 * np.floor(np.nanmin(values) / 20), 20 * np.ceil(np.nanmax(values) / 20)

    def at(second: float, value: float) -> tuple[int, int]:
        x = left + (_CHART[0] - left - right) * second / seconds[-1]
        return round(x), round(_CHART[1] - bottom - (_CHART[1] - top - bottom) * (value - low) / (high - low))

    for value in np.arange(low, high + 1, 20):
        cv2.line(image, at(0, value), at(seconds[-1], value), _LINE, 1)
        _write(image, f"{value:.0f}", (12, at(0, value)[1] + 5), _INK)
    for second in range(int(seconds[-1]) + 1):
        _write(image, f"{second} s", (at(second, low)[0] - 8, _CHART[1] - 24), _INK)
    cv2.line(image, at(frame / frame_rate, low), at(frame / frame_rate, high), _INK, 1, cv2.LINE_AA)
    for k, (side, curve) in enumerate(curves.items()):
        points = np.array([at(s, v) for s, v in zip(seconds, curve, strict=True) if np.isfinite(v)])
        cv2.polylines(image, [points], False, _COLORS[side], 2, cv2.LINE_AA)
        _write(image, f"{side} {name}, degrees", (left + 12, at(0, low)[1] - 34 + 22 * k), _COLORS[side])
    return image


def _write(image: Image, text: str, at: tuple[int, int], color: tuple[int, int, int]) -> None:
    for ink, thickness in (((255, 255, 255), 4), (color, 1)):
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.48, ink, thickness, cv2.LINE_AA)


if __name__ == "__main__":
    main(tyro.cli(LaboratoryPicture))
