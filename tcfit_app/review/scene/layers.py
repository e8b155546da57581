"""What both modes draw, bodies and video frames, as values. No viser here."""

from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.camera import Camera
from fitting_core.render.colors import rgb

RGB = tuple[int, int, int]
"""0 to 255, sRGB."""

FIT_COLOR: RGB = rgb("fit")
OTHER_OPACITY = 0.5
"""Maximum opacity of people other than the one on show."""
MOST_OTHERS = 9
"""How many other people are drawn: the first ones."""
OPACITY = 0.6
"""Initial opacity of bodies: the video's fingers and seams show through, and so does the shading."""
DISTANCE_LIMIT = 0.1
"""Metres at the top of the colour scale; larger values are clipped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyLayer:
    """A body of one frame.

    Arrays are compared by identity: to change one, pass a new array and leave the old one unchanged.
    """

    vertices: Float[np.ndarray, "V 3"]
    """Camera space: x right, y down, z away from the camera, metres."""
    faces: Int[np.ndarray, "F 3"]
    """Corners counter-clockwise seen from outside; the same array for all frames."""
    color: RGB = FIT_COLOR
    opacity: float = OPACITY
    outline: bool = False
    """On a poster: as outlines, with the video between them."""
    values: Float[np.ndarray, "V"] | None = None
    """Metres at each vertex, such as the distance to another run, drawn as colours instead of `color`."""
    opacities: UInt8[np.ndarray, "V"] | None = None
    """At each vertex, relative to `opacity`, which then applies to solid bodies too: 255 is all of it. None: all."""
    camera: Camera | None = None
    """The camera it was fitted with; None: the poster's."""

    @cached_property
    def problem(self) -> str | None:
        """Why this body cannot be drawn, for users; None if it can."""
        if not np.isfinite(self.vertices).all():
            return "the mesh has coordinates that are not finite"
        if np.median(self.vertices[:, 2]) < NEAREST:
            return "the body is behind the camera"
        return None


NEAREST = 0.05
"""The near plane, metres from the camera: nearer vertices are moved onto it."""


def jpeg(rgb: UInt8[np.ndarray, "H W 3"], *, quality: int = 85) -> bytes:
    """A JPEG of an RGB array."""
    done, data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done, "OpenCV has no JPEG encoder"
    return data.tobytes()


def uniform_jpeg(color: RGB) -> bytes:
    """An image of one colour, for any size."""
    return jpeg(np.full((8, 8, 3), color, np.uint8))


def css(color: RGB) -> str:
    """A CSS colour."""
    return "#" + "".join(f"{channel:02x}" for channel in color)


@cache
def color_table() -> UInt8[np.ndarray, "256 3"]:
    """The colours of values from 0 to the limit, RGB: OpenCV's inferno, perceptually uniform, dark to light."""
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    # The darkest fifth would look like shading.
    ramp = (48 + ramp * (207 / 255)).astype(np.uint8)
    return cv2.applyColorMap(ramp, cv2.COLORMAP_INFERNO)[:, 0, ::-1].copy()


def color_index(values: Float[np.ndarray, "V"]) -> UInt8[np.ndarray, "V"]:
    """The row of `color_table` for each value; NaN and infinity as 0."""
    return (np.clip(np.nan_to_num(values) / DISTANCE_LIMIT, 0, 1) * 255).astype(np.uint8)
