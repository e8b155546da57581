"""Pictures of fits: one frame, a sheet of frames, and videos, from the camera over the video or from the side."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.io.motion_files import motion_of
from fitting_core.keypoints import Keypoints
from fitting_core.motion import Progress
from fitting_core.render.colors import linear
from fitting_core.render.overlay import Cell, ImageOf, Shown, pictures, write_overlay, write_sheet
from fitting_core.results.fit_result import FitResult
from fitting_core.video.frames import FrameSource
from tcfit_app.exports.source import ExportedFit, ExportSource

_CELLS, _COLUMNS, _CELL_HEIGHT = 12, 4, 360
"""Pictures of a sheet at most, evenly spaced in time; how many in a row; and their height in pixels."""

_FIT = linear("fit")


def write_comparison(
    path: Path, fit: FitResult, clip: Clip, body: BodyModel, *, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Write the overlay video of phase 1 and the final fit side by side, on grey if the clip has no video. Raises
    InputError if no off-screen OpenGL or encoder works here (the message says what to install)."""
    phases = [(fit.phases[0], "phase 1: frame by frame")]
    if len(fit.phases) > 1:
        phases.append((fit.last, f"phase {fit.last.phase}: final"))
    shown = [
        Shown(motion=motion_of(fit, clip, body, phase=phase.phase), color=_color(phases, k), label=label)
        for k, (phase, label) in enumerate(phases)
    ]
    with (
        tqdm(total=len(clip), desc="Overlay", unit="frame", disable=None) as bar,
        _images(clip.source, shown[0]) as image,
    ):

        def advance(done: int) -> None:
            bar.update(done - bar.n)
            progress(done / len(clip))

        write_overlay(path, shown, image=image, keypoints=clip.keypoints, progress=advance)


def write_chosen(source: ExportSource, path: Path, progress: Progress) -> None:
    """A video of the chosen fit. What `progress` raises ends it, and nothing is kept. Raises InputError as
    `write_comparison` does."""
    _write_video(source, path, [_shown(source)], progress)


def write_side_by_side(source: ExportSource, path: Path, progress: Progress) -> None:
    """A video of A and B beside each other; raises as `write_chosen`."""
    fits = list(source.compared) or [source.fit]
    shown = [_of_fit(source, fit, _color(fits, k)) for k, fit in enumerate(fits)]
    _write_video(source, path, shown, progress)


def write_picture(source: ExportSource, path: Path, progress: Progress) -> None:
    """The middle frame. Raises InputError if no off-screen OpenGL works here."""
    shown = _shown(source)
    with _images(source.video, shown) as image:
        made = pictures(
            [shown], [len(shown.motion) // 2], views=source.views, image=image, keypoints=_keypoints(source)
        )
        path.write_bytes(cv2.imencode(".png", next(made)[..., ::-1])[1].tobytes())


def write_frames_sheet(source: ExportSource, path: Path, progress: Progress) -> None:
    """Frames evenly spaced in time, with their numbers in the video; raises as `write_picture`."""
    shown = _shown(source)
    count = min(_CELLS, len(shown.motion))
    frames = np.linspace(0, len(shown.motion) - 1, count).round().astype(int).tolist()
    cells: list[Cell] = []
    with _images(source.video, shown) as image:
        points = _keypoints(source)
        made = pictures([shown], frames, views=source.views, image=image, keypoints=points, height=_CELL_HEIGHT)
        for frame, picture in zip(frames, made, strict=True):
            cells.append(Cell(picture=picture, caption=str(shown.motion.first_frame + frame)))
            progress(len(cells) / count)
    write_sheet(path, cells, min(_COLUMNS, count))


def _write_video(source: ExportSource, path: Path, shown: Sequence[Shown], progress: Progress) -> None:
    count = len(shown[0].motion)
    with _images(source.video, shown[0]) as image:
        write_overlay(
            path,
            shown,
            views=source.views,
            image=image,
            keypoints=_keypoints(source),
            progress=lambda done: progress(done / count),
        )


def _shown(source: ExportSource) -> Shown:
    """The chosen fit, or the motion of a result."""
    if source.known_motion is None:
        return _of_fit(source, source.fit, _FIT)
    return Shown(motion=source.known_motion.in_axes("camera"), color=_FIT, label=source.name)


def _color(fits: Sequence[object], place: int) -> tuple[float, float, float]:
    """The last of the fits is the one that the others are compared with, as in the app."""
    return _FIT if place == len(fits) - 1 else linear("beside")


def _of_fit(source: ExportSource, fit: ExportedFit, color: tuple[float, float, float]) -> Shown:
    return Shown(motion=fit.motion(source.clip), color=color, label=fit.shown.title)


def _keypoints(source: ExportSource) -> Keypoints | None:
    return None if source.known_clip is None else source.known_clip.keypoints


@contextmanager
def _images(video: Path | None, shown: Shown) -> Iterator[ImageOf | None]:
    """The video's images, by frames of a motion."""
    if video is None:
        yield None
        return
    first = shown.motion.first_frame
    with FrameSource(video, lens=shown.motion.camera.lens) as frames:
        yield lambda frame: frames.frame_or_grey(first + frame)
