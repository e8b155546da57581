"""overlay.mp4: the fit of phase 1 and the final one, side by side over the clip."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fitting_core.body.mesh import Mesh, shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.render.overlay import PANEL_COLORS, Panel, write_overlay
from fitting_core.results.fit_result import FitResult
from fitting_core.video.frames import FrameSource

_CHUNK = 16
"""Frames of which whole meshes are computed together."""
_SIDE_BY_SIDE = PANEL_COLORS[1], PANEL_COLORS[0]
"""A is blue and B orange, as on the screen."""
_PLAIN = 235
"""Grey behind the bodies where there is no video."""


def write_comparison(
    path: Path, fit: FitResult, clip: Clip, body: BodyModel, *, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Write the overlay video, over a plain background where the clip has no video.

    Raises:
        InputError: No off-screen OpenGL or encoder works here (the message says what to install).
    """
    mesh = shared_mesh(body)
    shown = [("phase 1: frame by frame", fit.phases[0].params)]
    if len(fit.phases) > 1:
        shown.append((f"phase {fit.last.phase}: final", fit.last.params))
    panels = [Panel(label=label, vertices=_vertices(mesh, params)) for label, params in shown]
    with tqdm(total=len(clip), desc="Overlay", unit="frame", disable=None) as bar:

        def advance(done: int) -> None:
            bar.update(done - bar.n)
            progress(done / len(clip))

        _write(path, clip, panels, body, fit.camera, advance)


def write_side_by_side(
    path: Path,
    clip: Clip,
    fits: Sequence[tuple[str, BodyParams, BodyModel, Camera]],
    *,
    progress: Callable[[int], None],
) -> None:
    """Write an overlay video of A and B, or of one fit.

    Args:
        path: The mp4 file.
        clip: With its keypoints, which are drawn, too.
        fits: Label, all frames, body and camera of each, two at most.
        progress: Called with the number of frames done; what it raises ends the video, of which nothing is kept.

    Raises:
        InputError: As `write_comparison`, or the bodies have other meshes than each other.
    """
    assert len(fits) <= len(_SIDE_BY_SIDE)
    bodies = [body for _, _, body, _ in fits]
    if any(not np.array_equal(body.faces, bodies[0].faces) for body in bodies):
        kinds = " and ".join(body.kind for body in bodies)
        raise InputError(f"The fits have bodies of different meshes ({kinds}): choose runs of one body model.")
    panels = [
        Panel(label=label, vertices=_seen_by(clip.camera, camera, _vertices(shared_mesh(body), params)), color=color)
        for (label, params, body, camera), color in zip(fits, _SIDE_BY_SIDE, strict=False)
    ]
    _write(path, clip, panels, bodies[0], clip.camera, progress)


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


def _vertices(mesh: Mesh, params: BodyParams) -> Iterator[np.ndarray]:
    """Meshes in camera space, computed as they are asked for."""
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
