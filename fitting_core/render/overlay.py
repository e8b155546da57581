"""Overlay videos: one or more fits, side by side, drawn over the frames of the clip."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath
from fitting_core.keypoints import BONES, GROUPS, Keypoints
from fitting_core.render.renderer import Renderer, scaled_camera
from fitting_core.video.encoding import VideoWriter, video_writer

MAX_HEIGHT = 720
LABELS = ("SMPLify-X", "temporal")
PANEL_COLORS = ((0.22, 0.52, 0.90), (0.93, 0.45, 0.20), (0.30, 0.65, 0.35), (0.62, 0.40, 0.75))
"""Linear RGB of the first, second, ... panel's body, blue and orange as A and B in the app; they start again after the
last."""
GROUP_COLORS = {
    "body": (250, 215, 60),
    "left_hand": (60, 230, 120),
    "right_hand": (255, 90, 150),
    "face": (120, 220, 255),
}
"""sRGB of the keypoints, by group of fitting_core.keypoints."""
_GAP = 4
_SHOWN_CONFIDENCE = 0.05
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One fit of the clip."""

    label: str
    vertices: Iterable[Float[np.ndarray, "V 3"] | None]
    """For each frame, camera space in metres, made as they are asked for; None where this frame has no fit."""


def write_overlay(
    path: StrPath,
    frames: Iterable[UInt8[np.ndarray, "H W 3"]],
    panels: Sequence[Panel],
    *,
    faces: Int[np.ndarray, "F 3"],
    camera: Camera,
    frame_rate: float,
    keypoints: Keypoints | None = None,
    max_height: int = MAX_HEIGHT,
    opacity: float = 0.9,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Write an mp4 with one panel per fit, each the frame with the body drawn over it and a caption.

    Frames and vertices are asked for one at a time, so memory does not grow with the clip. The file appears only when
    it is whole; if anything raises, an older file of that name stays as it was.

    Args:
        path: The mp4 file to write.
        frames: RGB images of the camera's size.
        panels: One or more fits; one is an overlay, two a comparison.
        faces: Triangles of the body.
        camera: The camera of the fits and the frames.
        frame_rate: Frames per second.
        keypoints: Drawn over every panel when given, dimmer where confidence is low.
        max_height: Panels of taller videos are scaled down to about this many pixels.
        opacity: Of the bodies, 0 to 1.
        progress: Called with the number of frames done, after each.

    Returns:
        The number of frames written.

    Raises:
        InputError: No off-screen OpenGL, no encoder, no frames, frames of another size than the camera's, or frames,
            vertices and keypoints of different number.
    """
    path = Path(path)
    factor = min(1.0, max_height / camera.size[1])
    small = scaled_camera(camera, factor)
    size = (len(panels) * (small.size[0] + _GAP) - _GAP, small.size[1])
    sources = [iter(panel.vertices) for panel in panels]
    count = 0
    renderer = Renderer(small)
    with video_writer(Path(path), size, frame_rate) as video:
        for count, frame in enumerate(frames, 1):
            background = scaled_frame(frame, camera, small)
            points = None if keypoints is None else _points_of(keypoints, count - 1, small.size, camera.size)
            bodies = [_next_body(source, panel.label, count) for source, panel in zip(sources, panels, strict=True)]
            _write_row(video, renderer, panels, bodies, faces, background, points, opacity)
            if progress is not None:
                progress(count)
        _check_end(count, sources, panels, keypoints)
    return count


def scaled_frame(frame: UInt8[np.ndarray, "H W 3"], camera: Camera, small: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """A frame that `camera` filmed in the size of `small`. Raises InputError if it has another size than the camera."""
    if frame.shape[1::-1] != camera.size:
        raise InputError(
            f"The video's frames are {frame.shape[1]} x {frame.shape[0]} pixels, but the camera of the fit is for "
            f"{camera.size[0]} x {camera.size[1]}: give the video that was fitted."
        )
    return frame if small.size == camera.size else cv2.resize(frame, small.size, interpolation=cv2.INTER_AREA)


def _points_of(
    keypoints: Keypoints, frame: int, small: tuple[int, int], full: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Keypoints (137, 2) in the panel's pixels and their confidence (137)."""
    if frame >= len(keypoints):
        raise InputError(f"The video has more frames than the {len(keypoints)} of the keypoints: give the same clip.")
    return keypoints.xy[frame] * (np.array(small) / full), keypoints.confidence[frame]


def _next_body(source: Iterable, label: str, count: int) -> np.ndarray | None:
    for body in source:
        return body
    raise InputError(f'The fit "{label}" ends after {count - 1} frames, before the video does: give the same clip.')


def _check_end(count: int, sources: list, panels: Sequence[Panel], keypoints: Keypoints | None) -> None:
    if count == 0:
        raise InputError("There are no frames to draw on: the video is empty or could not be decoded.")
    longer = [
        panel.label for panel, source in zip(panels, sources, strict=True) if next(source, sources) is not sources
    ]
    if keypoints is not None and len(keypoints) > count:
        longer.append("keypoints")
    if longer:
        raise InputError(f"The video ends after {count} frames, before {', '.join(longer)}: give the same clip.")


def _write_row(
    video: VideoWriter,
    renderer: Renderer,
    panels: Sequence[Panel],
    bodies: list[np.ndarray | None],
    faces: np.ndarray,
    background: np.ndarray,
    points: tuple[np.ndarray, np.ndarray] | None,
    opacity: float,
) -> None:
    row = []
    for i, (panel, body) in enumerate(zip(panels, bodies, strict=True)):
        color = PANEL_COLORS[i % len(PANEL_COLORS)]
        image = background.copy()
        if body is not None:
            image = renderer.render(body, faces, color=color, background=background, opacity=opacity)
        if points is not None:
            draw_keypoints(image, *points)
        draw_caption(image, panel.label if body is not None else f"{panel.label}: no fit")
        row += [np.full((len(image), _GAP, 3), 255, np.uint8), image]
    video.write(np.concatenate(row[1:], axis=1))


def draw_keypoints(
    image: UInt8[np.ndarray, "H W 3"], xy: Float[np.ndarray, "137 2"], confidence: Float[np.ndarray, "137"]
) -> None:
    """Draw bones and points of one frame into an RGB image, in place, dimmer where confidence is low."""
    seen = confidence > _SHOWN_CONFIDENCE
    # Coordinates count from the image's corner, OpenCV's from the middle of the first pixel.
    places = np.round((xy - 0.5) * 2**_SUBPIXEL_BITS).astype(int)
    for name, group in GROUPS.items():
        for a, b in BONES:
            if group.start <= a < group.stop and seen[a] and seen[b]:
                color = _dimmed(GROUP_COLORS[name], min(confidence[a], confidence[b]))
                cv2.line(image, places[a].tolist(), places[b].tolist(), color, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
        radius = (3 if name == "body" else 1) * 2**_SUBPIXEL_BITS
        for k in np.flatnonzero(seen[group]) + group.start:
            color = _dimmed(GROUP_COLORS[name], confidence[k])
            cv2.circle(image, places[k].tolist(), radius, color, -1, cv2.LINE_AA, _SUBPIXEL_BITS)


def _dimmed(color: tuple[int, int, int], confidence: float) -> tuple[int, ...]:
    return tuple(int(c * (0.4 + 0.6 * min(1.0, confidence))) for c in color)


def draw_caption(image: UInt8[np.ndarray, "H W 3"], text: str) -> None:
    """Draw a caption on a dark plate into the upper left corner of an RGB image, in place; OpenCV's font is ASCII."""
    scale = max(0.4, len(image) / 1100)
    margin = round(14 * scale)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    plate = image[margin : 3 * margin + height, margin : 3 * margin + width]
    plate[:] = (0.35 * plate).astype(np.uint8)
    origin = (2 * margin, 2 * margin + height)
    cv2.putText(image, text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
