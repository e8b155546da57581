"""The standard set of markers on the free body, from the front and from behind.

python -m benchmarks.marker_picture docs/images/markers.jpg
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
import tyro
from jaxtyping import Float, UInt8
from tyro.conf import Positional

from fitting_core.body.files.reading import load_body
from fitting_core.body.markers.marker_set import RADIUS, STANDARD, marker_places
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.render.renderer import DrawnMesh, Renderer
from fitting_core.render.sheets import View, beside
from fitting_core.shipped import FREE_FOLDER

Image = UInt8[np.ndarray, "H W 3"]
_COLOR = (0.85, 0.12, 0.08)
_INNER, _BELOW = ("MED", "FMH", "ELM"), ("SACR", "LTOE", "RTOE", "LHEE", "RHEE")
"""Markers whose names stand on their other side, and below them."""
_LOWERED = 0.55
"""Radians by which the arms hang down from the T-pose."""


@dataclass(frozen=True, kw_only=True)
class MarkerPicture:
    """Where it goes."""

    out: Positional[Path]
    gender: str = "NEUTRAL"


def main(options: MarkerPicture) -> None:
    """Draw and write it."""
    body = load_body(FREE_FOLDER / f"SMPLX_{options.gender}.npz")
    params = _standing(body)
    vertices = Mesh(body)(params)[0].numpy()
    places = marker_places(body, params, STANDARD)[0]
    middle = (vertices.min(0) + vertices.max(0)) / 2
    view = View(center=(middle[0], middle[1], middle[2]), extent=1.72, size=(760, 860))
    pictures = [picture_of(body, vertices, places, replace(view, degrees=degrees)) for degrees in (0, 180)]
    cv2.imwrite(str(options.out), cv2.cvtColor(beside(pictures), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])


def _standing(body: BodyModel) -> BodyParams:
    params = BodyParams.neutral(1)
    for joint, sign in (("left_shoulder", -1.0), ("right_shoulder", 1.0)):
        params.body_pose[0, 3 * (JOINT[joint] - 1) + 2] = sign * _LOWERED
    return params


def picture_of(
    body: BodyModel,
    vertices: Float[np.ndarray, "V 3"],
    places: Float[np.ndarray, "M 3"],
    view: View,
    *,
    named: bool = True,
) -> Image:
    """A body with markers as balls, and their names beside those that are seen."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.3 * RADIUS)
    faces = np.asarray(ball.faces)
    balls = [DrawnMesh(vertices=view.camera_space(ball.vertices + at), faces=faces, color=_COLOR) for at in places]
    skin = DrawnMesh(vertices=view.camera_space(vertices), faces=body.faces)
    drawn = Renderer(view.camera).draw([skin, *balls])
    image = np.ascontiguousarray(drawn.over())
    depths, pixels = view.camera_space(places)[:, 2], view.pixels(places)
    for name, depth, (x, y) in zip(STANDARD.names, depths, pixels, strict=True):
        if named and depth < drawn.depth[round(y), round(x)] + 3 * RADIUS:
            _label(image, name, x, y)
    return image


def _label(image: Image, name: str, x: float, y: float) -> None:
    """Beside the marker, away from the body's middle if it is on the outer side of a limb, or below it."""
    (width, height), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.36, 1)
    right = (x >= image.shape[1] / 2 - 2) != (name[1:] in _INNER)
    at = (round(x + 8 if right else x - 8 - width), round(y + height / 2))
    if name in _BELOW:
        at = (round(x - width / 2), round(y + 8 + height))
    for color, thickness in (((255, 255, 255), 3), ((20, 20, 20), 1)):
        cv2.putText(image, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.36, color, thickness, cv2.LINE_AA)


if __name__ == "__main__":
    main(tyro.cli(MarkerPicture))
