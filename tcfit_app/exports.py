"""What of a project can be downloaded: one function for each kind of file, and the table of them."""

import csv
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.openpose import write_openpose
from fitting_core.io.result_files import fit_arrays
from fitting_core.io.summary import summary
from fitting_core.result import FitResult
from tcfit_app.curves import CURVES
from tcfit_app.fits import Shown
from tcfit_app.meshes import Meshes
from tcfit_app.overlay_video import write_side_by_side
from tcfit_app.posed_fit import PosedFit

Progress = Callable[[float], None]
"""Takes the share that is done, 0 to 1; raises if the export was cancelled."""


@dataclass(frozen=True, kw_only=True)
class ExportedFit:
    """A run that is exported."""

    shown: Shown
    fit: FitResult
    meshes: Meshes

    @property
    def body(self) -> BodyModel:
        """With which it was fitted."""
        return self.meshes.body


@dataclass(frozen=True, kw_only=True)
class ExportSource:
    """What there is to export, as it was when the user asked for it."""

    clip: Clip
    """With the keypoints as they stand."""
    a: ExportedFit | None
    b: ExportedFit | None

    @property
    def fit(self) -> ExportedFit:
        """B. Raises InputError without one."""
        if self.b is None:
            raise InputError("There is no fit to export yet: fit everything first.")
        return self.b


@dataclass(frozen=True, kw_only=True)
class Export:
    """A kind of file."""

    title: str
    suffix: str
    """Behind the clip's name."""
    hint: str
    write: Callable[[ExportSource, Path, Progress], None]
    """Writes the file; what it raises leaves nothing that is offered."""
    needs_fit: bool = True


def _fit(source: ExportSource, path: Path, progress: Progress) -> None:
    fit = source.fit
    np.savez_compressed(path, allow_pickle=False, **fit_arrays(fit.fit, source.clip, fit.body))


def _summary(source: ExportSource, path: Path, progress: Progress) -> None:
    fit = source.fit
    content = summary(
        fit.fit, source.clip, fit.body, complete=fit.shown.run.state == "finished", command="tcfit review"
    )
    path.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")


def _overlay(source: ExportSource, path: Path, progress: Progress) -> None:
    fits = [fit for fit in (source.a, source.b) if fit is not None]
    panels = [(fit.shown.title, fit.shown.params, fit.body, fit.shown.camera) for fit in fits]
    write_side_by_side(path, source.clip, panels, progress=lambda frames: progress(frames / len(source.clip)))


def _keypoints(source: ExportSource, path: Path, progress: Progress) -> None:
    folder = path.with_suffix("")
    files = write_openpose(folder, source.clip.keypoints, name=source.clip.name, first_frame=source.clip.first_frame)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for done, file in enumerate(files, 1):
            archive.write(file, file.name)
            progress(done / len(files))


def _figures(source: ExportSource, path: Path, progress: Progress) -> None:
    columns: dict[str, np.ndarray] = {"frame": source.clip.first_frame + np.arange(len(source.clip))}
    fits = {name: fit for name, fit in (("A", source.a), ("B", source.b)) if fit is not None}
    for done, (name, fit) in enumerate(fits.items()):
        posed = _posed(source.clip, fit)
        for step, kind in enumerate(CURVES.values()):
            progress((done + step / len(CURVES)) / len(fits))
            columns[f"{name} {kind.title}{f' [{kind.unit}]' if kind.unit else ''}"] = kind.values(posed)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([_cell(value) for value in row] for row in zip(*columns.values(), strict=True))


def _posed(clip: Clip, fit: ExportedFit) -> PosedFit:
    if fit.shown.result is None:
        raise InputError(f"{fit.shown.run.name} is still being fitted: export its figures when it is done.")
    return PosedFit.of(clip, fit.fit, fit.meshes, phase=fit.shown.result)


def _cell(value: float) -> str:
    """Empty for what is not known."""
    return "" if not np.isfinite(value) else f"{value:.6g}" if isinstance(value, float) else str(value)


EXPORTS: dict[str, Export] = {
    "fit": Export(
        title="SMPL-X parameters (npz)",
        suffix=".fit.npz",
        hint="All frames of run B: SMPL-X's keys as AMASS has them, joints, camera",
        write=_fit,
    ),
    "overlay": Export(
        title="Overlay video A | B (mp4)",
        suffix=".overlay.mp4",
        hint="Both fits side by side over the video, with the keypoints",
        write=_overlay,
    ),
    "figures": Export(
        title="Figures by frame (csv)",
        suffix=".figures.csv",
        hint="The curves of the timeline, of A and B",
        write=_figures,
    ),
    "summary": Export(
        title="Summary (json)", suffix=".summary.json", hint="Figures and settings of run B", write=_summary
    ),
    "keypoints": Export(
        title="Corrected keypoints (zip)",
        suffix=".keypoints.zip",
        hint="OpenPose's JSON, a file for each frame, with all corrections",
        write=_keypoints,
        needs_fit=False,
    ),
}
"""In the order of their buttons."""
