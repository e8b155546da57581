"""`tcfit render`: a picture, a sheet or a video of a fit, over the video's frames or from any side."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.io.result_files import video_of
from fitting_core.motion import Motion
from fitting_core.render.motion_views import ANGLES, Image, Look, Shown, camera_picture, outside_pictures
from fitting_core.render.overlay import PANEL_COLORS
from fitting_core.render.sheets import Cell, beside, write_sheet
from fitting_core.video.encoding import video_writer
from fitting_core.video.frames import FrameSource
from tcfit_app.cli.export_command import bar, opened
from tcfit_app.cli.json_lines import Step, StepDone, emit, emit_wrote, told
from tcfit_app.exports.from_path import source_of, wished_frames
from tcfit_app.exports.source import ExportSource
from tcfit_app.options.export import ExportOptions
from tcfit_app.options.render import RenderOptions

PHASE1 = "phase1"
"""What --against calls the first phase of the same fit."""
_COLORS = {"white": "#ffffff", "grey": "#808890", "black": "#000000"}
_PLAIN = (0.62, 0.68, 0.76)
_TOGETHER = 16
"""Frames whose meshes are in memory at once."""
_MOST_PIXELS = 8192

Draw = Callable[[int], Image]
"""From which of the frames, from 0, to its picture."""


def run_render(options: RenderOptions) -> None:
    """Draw what the options ask for, and say on the standard output what was written.

    Raises:
        InputError: The options name something that is not there or cannot be drawn, or there is no OpenGL.
        KeyboardInterrupt: Cancelled; nothing was written.
    """
    _check(options)
    torch.set_num_threads(1)
    moving = options.out.suffix.lower() == ".mp4"
    with ExitStack() as opened:
        source, shown = opened.enter_context(_shown(options))
        first, last = _motion(source).first_frame, _motion(source).first_frame + len(_motion(source)) - 1
        inside = _chosen(options, source, moving=moving)
        frames = [first + i for i in inside]
        draw = opened.enter_context(_drawing(options, source, shown, inside))
        emit(Step(step="render", title=f"{len(frames)} of the frames {first} to {last}"))
        with bar(options.out.name, told("render")) as progress:
            pictures = _counted((draw(i) for i in range(len(frames))), len(frames), progress)
            if moving:
                _write_video(options.out, pictures, _motion(source).frame_rate)
            else:
                _write_pictures(options.out, pictures, frames, options.columns)
    emit(StepDone(step="render"))
    emit_wrote(options.out)
    print(f"Wrote {options.out}", flush=True)


def _check(options: RenderOptions) -> None:
    """Raises InputError for options that mean nothing, or not together."""
    if options.path is None:
        raise InputError("tcfit render: no path given; expected a project's folder, or a result of tcfit fit.")
    if options.out.suffix.lower() not in (".png", ".mp4"):
        raise InputError(f"--out {options.out}: expected a name that ends in .png (a picture) or .mp4 (a video).")
    if options.out.exists() and not options.overwrite:
        raise InputError(f"--out {options.out}: is there already. Give --overwrite to replace it, or another name.")
    if any(not 16 <= length <= _MOST_PIXELS for length in options.size):
        width, height = options.size
        raise InputError(f"--size {width} {height}: expected numbers from 16 to {_MOST_PIXELS} pixels.")
    if options.elevation is not None and not -90 <= options.elevation <= 90:
        raise InputError(f"--elevation {options.elevation:g}: expected degrees from -90 (below) to 90 (above).")
    if options.distance is not None and not options.distance > 0:
        raise InputError(f"--distance {options.distance:g}: expected metres, more than 0.")
    for name in ("count", "columns"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} {getattr(options, name)}: expected 1 or more.")
    _color(options.background)


def _color(text: str) -> tuple[int, int, int]:
    match = re.fullmatch(r"#([0-9a-fA-F]{2})([0-9a-fA-F]{2})([0-9a-fA-F]{2})", _COLORS.get(text, text))
    if match is None:
        raise InputError(f"--background {text}: expected {', '.join(_COLORS)}, or #RRGGBB such as #20242c.")
    red, green, blue = (int(part, 16) for part in match.groups())
    return red, green, blue


# --- what is drawn ---


def _motion(source: ExportSource) -> Motion:
    return source.motion("camera")


@contextmanager
def _shown(options: RenderOptions) -> Iterator[tuple[ExportSource, list[Shown]]]:
    """The fit, and before it what it is compared with."""
    assert options.path is not None
    against = None if options.against == PHASE1 else options.against
    wished = ExportOptions(run=options.run, phase=options.phase, against=against, models=options.models)
    with opened(options.path, wished) as source:
        own = _motion(source)
        if options.against is None:
            yield source, [Shown(motion=own, color=_PLAIN)]
            return
        if source.known_motion is None:
            other = source.compared[0].motion(source.clip)
            labels = [fit.shown.title for fit in source.compared]
        else:
            with source_of(options.path, replace(wished, phase=1)) as first:
                other = _motion(first)
            labels = ["phase 1", "final"]
        pairs = zip((other, own), PANEL_COLORS, labels, strict=False)
        yield source, [Shown(motion=motion, color=color, label=label) for motion, color, label in pairs]


def _chosen(options: RenderOptions, source: ExportSource, *, moving: bool) -> list[int]:
    """The frames to draw, counted from the first as 0."""
    count = len(_motion(source))
    if options.frames is None:
        return list(range(count)) if moving else [count // 2]
    inside = range(count)[wished_frames(options.frames, source)]
    if moving:
        return list(inside)
    places = np.linspace(0, len(inside) - 1, min(options.count, len(inside))).round().astype(int)
    return [inside[int(place)] for place in places]


# --- how ---


@contextmanager
def _drawing(
    options: RenderOptions, source: ExportSource, shown: Sequence[Shown], frames: Sequence[int]
) -> Iterator[Draw]:
    """Draws all views of a frame beside each other; frames must come in their order."""
    with _video(options, source) as image:
        has_video = image is not None or (source.known_clip is not None and source.known_clip.source is not None)
        turned = any(value is not None for value in (options.azimuth, options.elevation, options.distance))
        views = options.view or (("picture",) if has_video and not turned else ("front",))
        upright = [Shown(motion=one.motion.in_axes("y-up"), color=one.color, label=one.label) for one in shown]
        outside = {view: outside_pictures(upright, frames, _look(view, options)) for view in views if view != "picture"}
        in_camera = [_vertices(one.motion, frames) for one in shown] if "picture" in views else []
        in_world = [_vertices(one.motion, frames) for one in upright] if outside else []

        def draw(i: int) -> Image:
            seen, standing = [next(v) for v in in_camera], [next(v) for v in in_world]
            row = []
            for view in views:
                if view == "picture":
                    behind = None if image is None else image(frames[i])
                    row.append(camera_picture(behind, shown, seen, height=options.size[1]))
                else:
                    row.append(outside[view](i, standing))
            return beside(row)

        yield draw


def _look(view: str, options: RenderOptions) -> Look:
    azimuth, elevation = ANGLES[view]
    return Look(
        azimuth=azimuth if options.azimuth is None else options.azimuth,
        elevation=elevation if options.elevation is None else options.elevation,
        distance=options.distance,
        turns=1.0 if view == "orbit" else 0.0,
        size=options.size,
        background=_color(options.background),
        floor=options.floor,
    )


@contextmanager
def _video(options: RenderOptions, source: ExportSource) -> Iterator[Draw | None]:
    """From a frame of the fit to the image behind it; None where there is none, or none is wanted."""
    clip, motion = source.known_clip, _motion(source)
    path = options.video_file or (_video_beside(options.path) if clip is None else clip.source)
    if path is None and options.video and "picture" in options.view:
        raise InputError(
            f"--view picture: {source.name} has no video, or not where it was. Name it with --video-file, or give "
            "--no-video for the body alone."
        )
    if path is None or not options.video:
        yield None
        return
    with FrameSource(path, lens=motion.camera.lens) as frames:
        yield lambda i: frames.frame_or_grey(motion.first_frame + i)


def _video_beside(result: Path | None) -> Path | None:
    return None if result is None else video_of(result if result.is_dir() else result.parent)


def _vertices(motion: Motion, frames: Sequence[int]) -> Iterator[np.ndarray]:
    """Of these frames, made as they are asked for, in the motion's own world."""
    for start in range(0, len(frames), _TOGETHER):
        part = list(frames[start : start + _TOGETHER])
        yield from motion.mesh(motion.params[part]).numpy()


# --- files ---


def _counted(pictures: Iterator[Image], count: int, progress: Callable[[float], None]) -> Iterator[Image]:
    for done, picture in enumerate(pictures, 1):
        yield picture
        progress(done / count)


def _write_pictures(path: Path, pictures: Iterator[Image], frames: Sequence[int], columns: int) -> None:
    if len(frames) > 1:
        cells = [Cell(picture=picture, caption=str(frame)) for picture, frame in zip(pictures, frames, strict=True)]
        write_sheet(path, cells, min(columns, len(cells)))
        return
    (picture,) = pictures
    try:
        with replacing(path) as draft:
            draft.write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
    except OSError as error:
        raise InputError(
            f"--out {path}: cannot be written ({error.strerror or error}). Choose another name."
        ) from error


def _write_video(path: Path, pictures: Iterator[Image], frame_rate: float) -> None:
    """An mp4, whose width and height are even, as encoders want them."""
    first = next(pictures)
    height, width = (length + length % 2 for length in first.shape[:2])
    with video_writer(path, (width, height), frame_rate) as video:
        video.write(_padded(first, width, height))
        for picture in pictures:
            video.write(_padded(picture, width, height))


def _padded(picture: Image, width: int, height: int) -> Image:
    sides = ((0, height - picture.shape[0]), (0, width - picture.shape[1]), (0, 0))
    return np.ascontiguousarray(np.pad(picture, sides, mode="edge"))
