"""Pictures of a moving body as its camera saw it, or from anywhere around it, on a floor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.io.motion.fitted_motion import Motion
from fitting_core.render.overlay import draw_caption, scaled_frame
from fitting_core.render.renderer import DEFAULT_COLOR, Renderer, scaled_camera
from fitting_core.render.sheets import Image, View, beside

ViewName = Literal["picture", "front", "side", "back", "top", "orbit"]
ANGLES: dict[str, tuple[float, float]] = {
    "front": (0.0, 0.0),
    "side": (90.0, 0.0),
    "back": (180.0, 0.0),
    "top": (0.0, 90.0),
    "orbit": (0.0, 15.0),
}
"""Azimuth and elevation in degrees. The front is where the camera stood; orbit turns once around while time goes on."""
_ROOM = 0.25
"""Metres around the joints: flesh, hair and shoes."""
_CELL = 0.5
"""Metres between the floor's lines."""
_BEYOND = 1.0
"""Metres of floor around what moves."""
_NEAR = 0.05
"""Metres: lines nearer to the eye, or behind it, are not drawn."""
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a motion is looked at from outside."""

    azimuth: float = 0.0
    """Degrees: 0 is the side of the camera, 90 the left of a person who faces it."""
    elevation: float = 0.0
    """Degrees above the horizon, -90 to 90."""
    distance: float | None = None
    """Metres from the eye to the middle; None: so far that lines stay parallel."""
    turns: float = 0.0
    """Times that the eye goes around while the motion goes on."""
    size: tuple[int, int] = (720, 720)
    """Pixels."""
    background: tuple[int, int, int] = (255, 255, 255)
    """RGB."""
    floor: bool = True
    """Draw a floor of half-metre squares."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One of the motions that are drawn beside each other."""

    motion: Motion
    color: tuple[float, float, float] = DEFAULT_COLOR
    """Linear RGB, 0 to 1."""
    label: str = ""
    """Written into its pictures; empty: nothing."""


def outside_pictures(
    shown: Sequence[Shown], frames: Sequence[int], look: Look
) -> "Callable[[int, Sequence[Float[np.ndarray, 'V 3']]], Image]":
    """What draws a frame of motions in y-up as seen from outside, in one scale for all frames.

    Args:
        shown: What is drawn, each in a picture of its own, in a row.
        frames: All frames that will be drawn, for which there must be room.
        look: From where.

    Returns:
        Takes which of `frames`, from 0, and the vertices of each motion in y-up (metres); gives an RGB picture.

    Raises:
        InputError: No off-screen OpenGL, or the eye would stand within the body.
    """
    joints = np.concatenate([s.motion.in_axes("y-up").joints()[list(frames)].reshape(-1, 3) for s in shown])
    low, high = joints.min(0) - _ROOM, joints.max(0) + _ROOM
    levels = [one.motion.level for one in shown]
    floor_is_known = all(level is not None and level.height is not None for level in levels)
    height = 0.0 if floor_is_known else float(low[1] + _ROOM / 2)
    look = replace(look, azimuth=look.azimuth + _camera_side(shown[0].motion))
    view = _framed(low, high, look)
    Renderer(view.camera)  # told before anything is drawn

    def draw(place: int, vertices: Sequence[np.ndarray]) -> Image:
        turned = look.azimuth + 360 * look.turns * place / max(1, len(frames))
        seen = replace(view, degrees=turned)
        background = np.full((look.size[1], look.size[0], 3), look.background, np.uint8)
        if look.floor:
            _draw_floor(background, seen, low, high, height)
        row = []
        for one, points in zip(shown, vertices, strict=True):
            renderer = Renderer(seen.camera)
            image = renderer.render(
                seen.camera_space(points), one.motion.body.faces, color=one.color, background=background
            )
            row.append(_labelled(image, one.label))
        return beside(row)

    return draw


def camera_picture(
    frame: Image | None, shown: Sequence[Shown], vertices: Sequence[Float[np.ndarray, "V 3"]], *, height: int
) -> Image:
    """Motions as their camera saw them, in a row.

    Args:
        frame: The image of the video, which lies behind; None: white.
        shown: What is drawn, each in a picture of its own.
        vertices: Of each in camera space, metres.
        height: Pixels.
    """
    row = []
    for one, points in zip(shown, vertices, strict=True):
        camera = one.motion.camera
        small = scaled_camera(camera, height / camera.size[1])
        background = None if frame is None else scaled_frame(frame, camera, small)
        image = Renderer(small).render(points, one.motion.body.faces, color=one.color, background=background)
        row.append(_labelled(image, one.label))
    return beside(row)


def picture_of(
    motion: Motion, frame: int, view: ViewName = "front", *, image: Image | None = None, look: Look | None = None
) -> Image:
    """One frame of a motion, as RGB.

    Args:
        motion: In any axes.
        frame: Counted from the motion's first as 0.
        view: "picture" as the camera saw it; or a name of ANGLES.
        image: What lies behind the picture: the frame of the video, RGB.
        look: From where, and how large; None: the view's angles, at 720 x 720 pixels.

    Raises:
        InputError: There is no such frame or view, or no off-screen OpenGL.
    """
    if not 0 <= frame < len(motion):
        raise InputError(f"There is no frame {frame} to draw: the motion has frames 0 to {len(motion) - 1}.")
    if view != "picture" and view not in ANGLES:
        raise InputError(f"There is no view {view!r}; expected picture, {', '.join(ANGLES)}.")
    chosen = look or Look()
    if view == "picture":
        seen = Shown(motion=motion.in_axes("camera"))
        return camera_picture(image, [seen], [_vertices(seen.motion, frame)], height=chosen.size[1])
    if look is None:
        azimuth, elevation = ANGLES[view]
        chosen = replace(chosen, azimuth=azimuth, elevation=elevation)
    standing = Shown(motion=motion.in_axes("y-up"))
    return outside_pictures([standing], [frame], chosen)(0, [_vertices(standing.motion, frame)])


def _vertices(motion: Motion, frame: int) -> Float[np.ndarray, "V 3"]:
    return motion.mesh(motion.params[frame : frame + 1])[0].numpy()


def _labelled(image: Image, label: str) -> Image:
    if label:
        draw_caption(image, label)
    return image


def _camera_side(motion: Motion) -> float:
    """Degrees about the vertical of y-up, from z, at which the camera stood when the motion began.

    A calibrated camera may stand on any side of its laboratory.
    """
    turn = motion.in_axes("y-up").camera_to_world
    backward = -(turn[0] if turn.ndim == 3 else turn)[:, 2]
    return float(np.degrees(np.arctan2(backward[0], backward[2])))


def _framed(low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], look: Look) -> View:
    """A view that shows a box whole, from wherever around it the eye goes."""
    center = (low + high) / 2
    turns = np.linspace(0, 360, 24, endpoint=False) if look.turns else np.zeros(1)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    view = View(center=tuple(center), extent=1.0, above=look.elevation, size=look.size, distance=look.distance)
    aspect = np.array(look.size) / min(look.size)
    spread = 0.0
    for turn in turns:
        seen = replace(view, degrees=look.azimuth + turn).camera_space(corners)
        if look.distance is not None and seen[:, 2].min() < _NEAR:
            needed = look.distance - float(seen[:, 2].min())
            raise InputError(
                f"--distance {look.distance:g}: the eye would stand within what is shown; expected more than "
                f"{needed:.1f} metres."
            )
        # What is nearer than the middle is larger there.
        larger = 1.0 if look.distance is None else look.distance / seen[:, 2:]
        spread = max(spread, float((abs(seen[:, :2]) * larger / aspect).max()))
    return replace(view, extent=2 * spread)


def _draw_floor(image: Image, view: View, low: np.ndarray, high: np.ndarray, height: float) -> None:
    """Half-metre squares, in place, in a tone between the background's and its opposite."""
    ink = tuple(int(0.82 * c + 0.18 * (255 - c)) for c in image[0, 0].tolist())
    first = np.floor((low[[0, 2]] - _BEYOND) / _CELL) * _CELL
    last = np.ceil((high[[0, 2]] + _BEYOND) / _CELL) * _CELL
    lines = [[(x, first[1]), (x, last[1])] for x in np.arange(first[0], last[0] + _CELL / 2, _CELL)]
    lines += [[(first[0], z), (last[0], z)] for z in np.arange(first[1], last[1] + _CELL / 2, _CELL)]
    for line in lines:
        ends = np.array([(x, height, z) for x, z in line])
        depth = view.camera_space(ends)[:, 2]
        if depth.max() < _NEAR:
            continue
        if depth.min() < _NEAR:  # cut where it passes the eye
            share = (_NEAR - depth.min()) / (depth.max() - depth.min())
            near = int(depth.argmin())
            ends[near] += share * (ends[1 - near] - ends[near])
        a, b = np.round(view.pixels(ends) * 2**_SUBPIXEL_BITS).clip(-(2**24), 2**24).astype(int).tolist()
        cv2.line(image, a, b, ink, max(1, min(view.size) // 480), cv2.LINE_AA, _SUBPIXEL_BITS)
