"""Fits drawn over the video of a project."""

from collections.abc import Sequence
from pathlib import Path

from fitting_core.motion import Progress
from tcfit_app.exports.overlay_video import write_side_by_side
from tcfit_app.exports.source import ExportedFit, ExportSource


def write_overlay(source: ExportSource, path: Path, progress: Progress) -> None:
    """The chosen fit over the video."""
    _video(source, [source.fit], path, progress)


def write_a_beside_b(source: ExportSource, path: Path, progress: Progress) -> None:
    """A and B beside each other."""
    _video(source, list(source.compared) or [source.fit], path, progress)


def _video(source: ExportSource, fits: Sequence[ExportedFit], path: Path, progress: Progress) -> None:
    panels = [(fit.shown.title, fit.shown.params, fit.body, fit.shown.camera) for fit in fits]
    write_side_by_side(path, source.clip, panels, progress=lambda frames: progress(frames / len(source.clip)))
