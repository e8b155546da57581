"""Fits drawn over the clip: overlay.mp4 with phase 1 beside the final fit, and the videos of exports."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.motion import Progress
from fitting_core.render.overlay import Panel, write_overlay
from fitting_core.results.fit_result import FitResult
from fitting_core.video.frames import FrameSource
from tcfit_app.exports.source import ExportedFit, ExportSource

_CHUNK = 16
"""Frames of which whole meshes are computed together."""
_PLAIN = 235
"""Grey behind the bodies where there is no video."""


def write_comparison(
    path: Path, fit: FitResult, clip: Clip, body: BodyModel, *, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Write the overlay video, over a plain background where the clip has no video. Raises InputError if no off-screen
    OpenGL or encoder works here (the message says what to install)."""
    shown = [("phase 1: frame by frame", fit.phases[0].params)]
    if len(fit.phases) > 1:
        shown.append((f"phase {fit.last.phase}: final", fit.last.params))
    panels = [Panel(label=label, vertices=_vertices(body, params)) for label, params in shown]
    with tqdm(total=len(clip), desc="Overlay", unit="frame", disable=None) as bar:

        def advance(done: int) -> None:
            bar.update(done - bar.n)
            progress(done / len(clip))

        _write(path, clip, panels, body, fit.camera, advance)


def write_chosen(source: ExportSource, path: Path, progress: Progress) -> None:
    """The chosen fit over the video; raises as `write_side_by_side`."""
    _write_fits(path, source.clip, [source.fit], progress)


def write_side_by_side(source: ExportSource, path: Path, progress: Progress) -> None:
    """A and B beside each other over the video; what `progress` raises ends it, and nothing is kept. Raises InputError
    as `write_comparison` does, or if the bodies have different meshes."""
    _write_fits(path, source.clip, list(source.compared) or [source.fit], progress)


def _write_fits(path: Path, clip: Clip, fits: Sequence[ExportedFit], progress: Progress) -> None:
    bodies = [fit.body for fit in fits]
    if any(not np.array_equal(body.faces, bodies[0].faces) for body in bodies):
        kinds = " and ".join(body.kind for body in bodies)
        raise InputError(f"The fits have bodies of different meshes ({kinds}): choose runs of one body model.")
    panels = []
    for fit in fits:
        vertices = _seen_by(clip.camera, fit.shown.camera, _vertices(fit.body, fit.shown.params))
        panels.append(Panel(label=fit.shown.title, vertices=vertices))
    _write(path, clip, panels, bodies[0], clip.camera, lambda frames: progress(frames / len(clip)))


def _write(
    path: Path, clip: Clip, panels: list[Panel], body: BodyModel, camera: Camera, progress: Callable[[int], None]
) -> None:
    with _frames(clip) as frames:
        write_overlay(
            path,
            frames,
            panels,
            faces=body.faces,
            camera=camera,
            frame_rate=clip.frame_rate,
            keypoints=clip.keypoints,
            progress=progress,
        )


def _seen_by(camera: Camera, own: Camera, bodies: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    """Bodies that `camera` sees at the pixels, and in the depth, at which their own camera sees them."""
    scale = np.array(own.focal) / camera.focal
    shift = (np.array(own.center) - camera.center) / camera.focal
    for vertices in bodies:
        plane = vertices[:, :2] * scale + vertices[:, 2:] * shift
        yield np.concatenate([plane, vertices[:, 2:]], axis=1)


def _vertices(body: BodyModel, params: BodyParams) -> Iterator[np.ndarray]:
    """Meshes in camera space, computed as they are asked for."""
    mesh = shared_mesh(body)
    for start in range(0, len(params), _CHUNK):
        yield from mesh(params[start : start + _CHUNK]).numpy()


@contextmanager
def _frames(clip: Clip) -> Iterator[Iterator[np.ndarray]]:
    """The clip's images, RGB."""
    if clip.source is None:
        blank = np.full((clip.camera.size[1], clip.camera.size[0], 3), _PLAIN, np.uint8)
        yield (blank for _ in range(len(clip)))
        return
    with FrameSource(clip.source, lens=clip.camera.lens) as source:
        yield (source.frame_or_grey(clip.first_frame + i) for i in range(len(clip)))
