"""What both modes draw: bodies and video frames, as values. No viser here."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.camera import Camera

RGB = tuple[int, int, int]
"""0 to 255, sRGB."""

RUN_COLORS: tuple[RGB, RGB] = (90, 160, 255), (255, 150, 60)
"""Of run A and run B: blue and orange, apart for every kind of colour vision."""
OTHER_COLOR: RGB = (168, 142, 222)
"""Of people who are not the one on show: violet, which neither grey clothes nor skin swallow, as they did pale grey."""
OTHER_OPACITY = 0.5
"""Of these, at most."""
MOST_OTHERS = 9
"""Other people that are drawn; those that come first."""
OPACITY = 0.6
"""Of bodies at first: fingers and seams of clothes in the video are seen through it, and shading on it."""
DISTANCE_LIMIT = 0.1
"""Metres at the top end of the colours; larger values look the same."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyLayer:
    """A body of one frame.

    The arrays are compared by identity: to change one, give a new array and leave the old one as it is.
    """

    vertices: Float[np.ndarray, "V 3"]
    """Camera space: x right, y down, z away from the camera, metres."""
    faces: Int[np.ndarray, "F 3"]
    """Corners counter-clockwise as seen from outside; the same array for all frames."""
    color: RGB = RUN_COLORS[0]
    opacity: float = OPACITY
    wireframe: bool = False
    outline: bool = False
    """On a poster: as lines where it turns from the viewer, with the video between them."""
    values: Float[np.ndarray, "V"] | None = None
    """Metres at each vertex, such as the distance to another run. They are drawn as colours, instead of `color`."""
    camera: Camera | None = None
    """What it was fitted with; None: the poster's own."""

    @cached_property
    def problem(self) -> str | None:
        """Why this body cannot be drawn, for the user; None if it can."""
        if not np.isfinite(self.vertices).all():
            return "the mesh has coordinates that are not numbers"
        if np.median(self.vertices[:, 2]) < NEAREST:
            return "the body lies behind the camera"
        return None


NEAREST = 0.05
"""Metres from the camera within which nothing is projected: vertices nearer than that are put there."""


@dataclass(frozen=True, kw_only=True)
class FrameImage:
    """An encoded image, handed to the browser as it is."""

    data: bytes
    """JPEG."""

    @classmethod
    def encode(cls, rgb: UInt8[np.ndarray, "H W 3"], *, quality: int = 85) -> "FrameImage":
        """A JPEG of an RGB array."""
        done, data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        assert done, "OpenCV has no JPEG encoder"
        return cls(data=data.tobytes())

    @classmethod
    @cache
    def uniform(cls, color: RGB) -> "FrameImage":
        """A plate of one colour, of any size."""
        return cls.encode(np.full((8, 8, 3), color, np.uint8))


def css(color: RGB) -> str:
    """A colour as browsers write it."""
    return "#" + "".join(f"{channel:02x}" for channel in color)


@cache
def color_table() -> UInt8[np.ndarray, "256 3"]:
    """The colours of values from 0 to the limit, RGB: OpenCV's inferno, perceptually uniform, dark to light."""
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    # The darkest fifth would look like shadow on a shaded body.
    ramp = (48 + ramp * (207 / 255)).astype(np.uint8)
    return cv2.applyColorMap(ramp, cv2.COLORMAP_INFERNO)[:, 0, ::-1].copy()


def color_index(values: Float[np.ndarray, "V"]) -> UInt8[np.ndarray, "V"]:
    """Which line of `color_table` each value has; what is not a number is drawn as 0."""
    return (np.clip(np.nan_to_num(values) / DISTANCE_LIMIT, 0, 1) * 255).astype(np.uint8)


def drawable(bodies: Sequence[BodyLayer]) -> tuple[list[BodyLayer | None], list[str]]:
    """The bodies with None for those that cannot be drawn, and why."""
    problems = [body.problem for body in bodies]
    shown = [None if problem else body for body, problem in zip(bodies, problems, strict=True)]
    return shown, [problem for problem in problems if problem]
