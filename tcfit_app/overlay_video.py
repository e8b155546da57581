"""overlay.mp4: the fit of phase 1 and the final one, side by side over the clip."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.overlay import Panel, write_overlay
from fitting_core.result import FitResult
from fitting_core.video import FrameSource

_CHUNK = 16
"""Frames of which whole meshes are computed together."""
_PLAIN = 235
"""Grey behind the bodies where there is no video."""


def write_comparison(path: Path, fit: FitResult, clip: Clip, body: BodyModel) -> None:
    """Write the overlay video, over a plain background where the clip has no video.

    Raises:
        InputError: No off-screen OpenGL or encoder works here (the message says what to install), or a frame is broken.
    """
    mesh = Mesh(body)
    shown = [("phase 1: frame by frame", fit.phases[0].params)]
    if len(fit.phases) > 1:
        shown.append((f"phase {fit.last.phase}: final", fit.last.params))
    panels = [Panel(label=label, vertices=_vertices(mesh, params)) for label, params in shown]
    with _frames(clip) as frames, tqdm(total=len(clip), desc="Overlay", unit="frame", disable=None) as bar:

        def advance(done: int) -> None:
            bar.update(done - bar.n)

        write_overlay(
            path,
            frames,
            panels,
            faces=body.faces,
            camera=fit.camera,
            frame_rate=clip.frame_rate,
            keypoints=clip.keypoints,
            progress=advance,
        )


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
    with FrameSource(clip.source) as source:
        yield (source.frame(clip.first_frame + i) for i in range(len(clip)))
