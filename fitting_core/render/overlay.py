"""Pictures, contact sheets and videos of motions: over the video, or from the person's side, on a floor."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import StrPath
from fitting_core.keypoints import BONES, GROUPS, Keypoints
from fitting_core.motion import CHUNK, Motion
from fitting_core.render.colors import rgb
from fitting_core.render.renderer import DEFAULT_COLOR, Renderer, scaled_camera
from fitting_core.video.encoding import video_writer

Image = UInt8[np.ndarray, "H W 3"]
"""RGB."""
ViewName = Literal["camera", "side"]
ImageOf = Callable[[int], Image]
"""From a frame of the motion, counted from its first as 0, to the video's image, RGB."""
HEIGHT = 720
_OPACITY = 0.9
_GAP = 4
_PLAIN = 235
"""Grey behind the camera's view without a video."""
_SHOWN_CONFIDENCE = 0.05
_SUBPIXEL_BITS = 4
_ROOM = 0.25
"""Metres around the joints: flesh, hair and shoes."""
_CELL = 0.5
"""Metres between the floor's lines."""
_BEYOND = 1.0
"""Metres of floor around the motions."""
_INK = (210, 210, 210)
_DISTANCE = 8.0
"""Distance of the side view's eye, in extents: limbs nearly keep their lengths wherever they point."""
_SHEET_GAP, _CAPTION_HEIGHT, _CAPTION_INK = 6, 18, (40, 40, 40)
_FONT, _FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.4


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One of the motions that are drawn beside each other."""

    motion: Motion
    color: tuple[float, float, float] = DEFAULT_COLOR
    """Linear RGB, 0 to 1."""
    label: str = ""
    """Caption; empty: none."""


def pictures(
    shown: Sequence[Shown],
    frames: Sequence[int],
    *,
    views: Sequence[ViewName] = ("camera",),
    image: ImageOf | None = None,
    keypoints: Keypoints | None = None,
    height: int = HEIGHT,
) -> Iterator[Image]:
    """Draw frames of motions, one at a time, so that memory does not grow with their number.

    Args:
        shown: Motions of the same frames; each has pictures of its own.
        frames: Counted from the motions' first as 0, in their order.
        views: "camera": as each motion's own camera sees it. "side": from the left of a person who faces the camera
            when the motion begins, upright, in parallel projection, at one scale for all frames.
        image: What lies behind the camera's view; None: grey.
        keypoints: Drawn over the camera's view if given, dimmer where confidence is low.
        height: Of a picture in pixels, at most; the camera's view is not enlarged.

    Yields:
        RGB rows: for each view a picture of each motion.

    Raises:
        InputError: No off-screen OpenGL, or images or keypoints that are not of these motions.
    """
    if keypoints is not None and len(keypoints) != len(shown[0].motion):
        raise InputError(f"There are keypoints of {len(keypoints)} frames for {len(shown[0].motion)}: give the clip's.")
    standing = [replace(one, motion=one.motion.in_axes("y-up")) for one in shown] if "side" in views else []
    if "camera" in views:
        height = _scaled(shown[0].motion.camera, height).size[1]
    side = _Side.of(standing, frames, height) if standing else None
    for start in range(0, len(frames), CHUNK):
        part = list(frames[start : start + CHUNK])
        meshes = [one.motion.mesh(one.motion.params[part]).numpy() for one in shown]
        upright = [one.motion.mesh(one.motion.params[part]).numpy() for one in standing]
        for i, frame in enumerate(part):
            row = []
            for view in views:
                if view == "camera":
                    behind = None if image is None else image(frame)
                    points = None if keypoints is None else (keypoints.xy[frame], keypoints.confidence[frame])
                    row += [
                        _seen(one, mesh[i], behind, points, height) for one, mesh in zip(shown, meshes, strict=True)
                    ]
                elif side is not None:
                    row += [side.picture(one, mesh[i]) for one, mesh in zip(standing, upright, strict=True)]
            yield beside(row, gap=_GAP)


def picture_of(
    motion: Motion, frame: int, view: ViewName = "camera", *, image: Image | None = None, height: int = HEIGHT
) -> Image:
    """One frame of a motion, as RGB.

    Args:
        motion: In any axes.
        frame: Counted from the motion's first as 0.
        view: See `pictures`.
        image: The frame of the video, which lies behind the camera's view.
        height: See `pictures`.

    Raises:
        InputError: There is no such frame or view, or no off-screen OpenGL.
    """
    if not 0 <= frame < len(motion):
        raise InputError(f"There is no frame {frame} to draw: the motion has frames 0 to {len(motion) - 1}.")
    if view not in get_args(ViewName):
        raise InputError(f"There is no view {view!r}; expected {' or '.join(get_args(ViewName))}.")
    shown = Shown(motion=motion.in_axes("camera"))
    behind = None if image is None else lambda _: image
    return next(pictures([shown], [frame], views=(view,), image=behind, height=height))


def write_overlay(
    path: StrPath,
    shown: Sequence[Shown],
    *,
    views: Sequence[ViewName] = ("camera",),
    image: ImageOf | None = None,
    keypoints: Keypoints | None = None,
    height: int = HEIGHT,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write an mp4 of all frames of motions beside each other. It appears only when it is whole; if anything raises, an
    older file of that name stays as it was.

    Args:
        path: The mp4 file to write.
        shown: One or more motions of the same frames; one is an overlay, two a comparison.
        views: See `pictures`; likewise image, keypoints and height.
        image: What lies behind.
        keypoints: Drawn over it.
        height: In pixels.
        progress: Called with the number of frames done, after each.

    Raises:
        InputError: No off-screen OpenGL, no encoder, or images or keypoints that are not of these motions.
    """
    motion = shown[0].motion
    made = pictures(shown, range(len(motion)), views=views, image=image, keypoints=keypoints, height=height)
    first = next(made)
    with video_writer(Path(path), (first.shape[1], first.shape[0]), motion.frame_rate) as video:
        video.write(first)
        for done in range(1, len(motion) + 1):
            if progress is not None:
                progress(done)
            if (picture := next(made, None)) is not None:
                video.write(picture)


# --- from the camera ---


def _seen(
    one: Shown,
    vertices: Float[np.ndarray, "V 3"],
    frame: Image | None,
    points: tuple[np.ndarray, np.ndarray] | None,
    height: int,
) -> Image:
    camera = one.motion.camera
    small = _scaled(camera, height)
    if frame is None:
        background = np.full((small.size[1], small.size[0], 3), _PLAIN, np.uint8)
    else:
        background = scaled_frame(frame, camera, small)
    drawn = Renderer(small).render(
        vertices, one.motion.body.faces, color=one.color, background=background, opacity=_OPACITY
    )
    if points is not None:
        draw_keypoints(drawn, points[0] * (np.array(small.size) / camera.size), points[1])
    return _labelled(drawn, one.label)


def _scaled(camera: Camera, height: int) -> Camera:
    return scaled_camera(camera, min(1.0, height / camera.size[1]))


def scaled_frame(frame: UInt8[np.ndarray, "H W 3"], camera: Camera, small: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """A frame that `camera` filmed in the size of `small`. Raises InputError if it has another size than the camera."""
    if frame.shape[1::-1] != camera.size:
        raise InputError(
            f"The video's frames are {frame.shape[1]} x {frame.shape[0]} pixels, but the camera of the fit is for "
            f"{camera.size[0]} x {camera.size[1]}: give the video that was fitted."
        )
    return frame if small.size == camera.size else cv2.resize(frame, small.size, interpolation=cv2.INTER_AREA)


def draw_keypoints(
    image: UInt8[np.ndarray, "H W 3"], xy: Float[np.ndarray, "137 2"], confidence: Float[np.ndarray, "137"]
) -> None:
    """Draw bones and points of one frame into an RGB image, in place, dimmer where confidence is low."""
    seen = confidence > _SHOWN_CONFIDENCE
    # Coordinates count from the image's corner, OpenCV's from the middle of the first pixel.
    places = np.round((xy - 0.5) * 2**_SUBPIXEL_BITS).astype(int)
    for name, group in GROUPS.items():
        full = rgb(name)
        for a, b in BONES:
            if group.start <= a < group.stop and seen[a] and seen[b]:
                color = _dimmed(full, min(confidence[a], confidence[b]))
                cv2.line(image, places[a].tolist(), places[b].tolist(), color, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
        radius = (3 if name == "body" else 1) * 2**_SUBPIXEL_BITS
        for k in np.flatnonzero(seen[group]) + group.start:
            color = _dimmed(full, confidence[k])
            cv2.circle(image, places[k].tolist(), radius, color, -1, cv2.LINE_AA, _SUBPIXEL_BITS)


def _dimmed(color: tuple[int, int, int], confidence: float) -> tuple[int, ...]:
    return tuple(int(c * (0.4 + 0.6 * min(1.0, confidence))) for c in color)


def _labelled(image: Image, label: str) -> Image:
    """Draw a caption on a dark plate into the upper left corner, in place; OpenCV's font is ASCII."""
    if not label:
        return image
    scale = max(0.4, len(image) / 1100)
    margin = round(14 * scale)
    (width, height), _ = cv2.getTextSize(label, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    plate = image[margin : 3 * margin + height, margin : 3 * margin + width]
    plate[:] = (0.35 * plate).astype(np.uint8)
    origin = (2 * margin, 2 * margin + height)
    cv2.putText(image, label, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return image


# --- from the side ---


@dataclass(frozen=True, kw_only=True)
class _View:
    """A place to look from, in the body's own world: x to the body's left, y up, z forward, metres."""

    center: tuple[float, float, float]
    """The middle of the picture."""
    extent: float = 2.1
    """How many metres the shorter side of the picture shows there."""
    degrees: float = 0.0
    """0 sees the front of a body that faces +z, 90 its left side, 180 its back."""
    size: tuple[int, int] = (240, 320)
    """Width and height in pixels."""

    @property
    def _away(self) -> float:
        """Metres from the eye to the middle."""
        return _DISTANCE * self.extent

    @property
    def camera(self) -> Camera:
        """The camera that belongs to `camera_space`."""
        focal = min(self.size) * self._away / self.extent
        return Camera(focal=(focal, focal), center=(self.size[0] / 2, self.size[1] / 2), size=self.size)

    def camera_space(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
        """Points in the camera's space: x right, y down, z away."""
        turn = math.radians(self.degrees)
        around = np.array([[math.cos(turn), 0, -math.sin(turn)], [0, 1, 0], [math.sin(turn), 0, math.cos(turn)]])
        seen = (np.asarray(points, float) - self.center) @ around.T
        return seen * [1, -1, -1] + [0, 0, self._away]

    def pixels(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 2"]:
        """Where points appear."""
        seen, camera = self.camera_space(points), self.camera
        return seen[:, :2] / seen[:, 2:] * camera.focal + camera.center


@dataclass(frozen=True, eq=False)
class _Side:
    """The view from the side, with its background of half-metre squares on the floor."""

    view: _View
    background: Image

    @staticmethod
    def of(standing: Sequence[Shown], frames: Sequence[int], height: int) -> "_Side":
        """The view that shows all of these frames of motions in y-up, whole."""
        joints = np.concatenate([one.motion.joints()[list(frames)].reshape(-1, 3) for one in standing])
        low, high = joints.min(0) - _ROOM, joints.max(0) + _ROOM
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        length = 2 * round(height / 2)  # video encoders want it even
        view = _View(
            center=tuple((low + high) / 2),
            extent=1.0,
            degrees=90 + _camera_side(standing[0].motion),
            size=(length, length),
        )
        view = replace(view, extent=2 * float(abs(view.camera_space(corners)[:, :2]).max()))
        background = np.full((length, length, 3), 255, np.uint8)
        levels = [one.motion.level for one in standing]
        known = all(level is not None and level.height is not None for level in levels)
        _draw_floor(background, view, low, high, 0.0 if known else float(low[1] + _ROOM / 2))
        return _Side(view, background)

    def picture(self, one: Shown, vertices: Float[np.ndarray, "V 3"]) -> Image:
        """One motion, by its vertices in y-up, metres."""
        renderer, seen = Renderer(self.view.camera), self.view.camera_space(vertices)
        drawn = renderer.render(seen, one.motion.body.faces, color=one.color, background=self.background)
        return _labelled(drawn, one.label)


def _camera_side(motion: Motion) -> float:
    """Degrees about the vertical of y-up, from z, at which the camera stood when the motion began.

    A calibrated camera may stand on any side of its laboratory.
    """
    turn = motion.camera_to_world
    backward = -(turn[0] if turn.ndim == 3 else turn)[:, 2]
    return float(np.degrees(np.arctan2(backward[0], backward[2])))


def _draw_floor(image: Image, view: _View, low: np.ndarray, high: np.ndarray, height: float) -> None:
    """Draw half-metre squares, in place."""
    first = np.floor((low[[0, 2]] - _BEYOND) / _CELL) * _CELL
    last = np.ceil((high[[0, 2]] + _BEYOND) / _CELL) * _CELL
    lines = [[(x, first[1]), (x, last[1])] for x in np.arange(first[0], last[0] + _CELL / 2, _CELL)]
    lines += [[(first[0], z), (last[0], z)] for z in np.arange(first[1], last[1] + _CELL / 2, _CELL)]
    for line in lines:
        ends = view.pixels(np.array([(x, height, z) for x, z in line]))
        a, b = np.round(ends * 2**_SUBPIXEL_BITS).clip(-(2**24), 2**24).astype(int).tolist()
        cv2.line(image, a, b, _INK, max(1, min(view.size) // 480), cv2.LINE_AA, _SUBPIXEL_BITS)


# --- pictures beside each other ---


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """One place in a sheet."""

    picture: Image
    """RGB; all cells of a sheet may differ in size."""
    caption: str = ""


def beside(pictures: Sequence[Image], gap: int = 0) -> Image:
    """Pictures in a row with white between them, and where they are not equally high."""
    height = max(len(picture) for picture in pictures)
    row = [np.pad(_padded(p, height, p.shape[1]), ((0, 0), (gap, 0), (0, 0)), constant_values=255) for p in pictures]
    return np.concatenate(row, 1)[:, gap:]


def sheet(cells: Sequence[Cell], columns: int) -> Image:
    """Cells row by row with their captions below; rows are as high, and columns as wide, as the largest cell."""
    assert cells and columns > 0
    height = max(len(cell.picture) for cell in cells)
    width = max(cell.picture.shape[1] for cell in cells)
    captioned = [_captioned(_padded(cell.picture, height, width), cell.caption) for cell in cells]
    blank = np.full_like(captioned[0], 255)
    captioned += [blank] * (-len(captioned) % columns)
    rows = [np.concatenate(captioned[i : i + columns], 1) for i in range(0, len(captioned), columns)]
    return np.concatenate(rows, 0)


def write_sheet(path: Path, cells: Sequence[Cell], columns: int) -> None:
    """Write a sheet as an image file (PNG by its name's ending). Raises InputError if the file cannot be written."""
    try:
        with replacing(path) as draft:
            written = cv2.imwrite(str(draft), sheet(cells, columns)[..., ::-1])
    except (OSError, cv2.error) as error:
        raise InputError(f"{path}: cannot be written as a picture ({error}). Give a name such as sheet.png.") from error
    if not written:
        raise InputError(f"{path}: cannot be written. Give a name such as sheet.png in a folder that exists.")


def _padded(picture: Image, height: int, width: int) -> Image:
    """The picture in the middle of a white one."""
    below, right = height - picture.shape[0], width - picture.shape[1]
    sides = ((below // 2, below - below // 2), (right // 2, right - right // 2), (0, 0))
    return np.pad(picture, sides, constant_values=255)


def _captioned(picture: Image, caption: str) -> Image:
    """The picture with a caption below it and a gap around both; a long caption is cut."""
    sides = ((_SHEET_GAP // 2, _CAPTION_HEIGHT + _SHEET_GAP // 2), (_SHEET_GAP // 2, _SHEET_GAP // 2), (0, 0))
    framed = np.pad(picture, sides, constant_values=255)
    while caption and cv2.getTextSize(caption, _FONT, _FONT_SCALE, 1)[0][0] > picture.shape[1]:
        caption = caption[:-1]
    cv2.putText(
        framed, caption, (_SHEET_GAP, len(framed) - _SHEET_GAP), _FONT, _FONT_SCALE, _CAPTION_INK, 1, cv2.LINE_AA
    )
    return framed
