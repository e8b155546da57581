"""A fit on disk: runs/<id>.npz, which restores the FitResult except for its configuration.

| key | shape | |
|---|---|---|
| phase1_betas, phase1_body_pose, ... | (T, ...) | BodyParams of each finished phase |
| phase1_frame_cost | (T,) | cost of each frame |
| phase1_objective | (n,) | mean cost by term; names in about |
| phase1_start, phase1_stopped | (T,) | where each frame's fit came from: numbers of `provenance.Start` and `Stopped`; \
runs of earlier versions and imported motions have none |
| phase3_joint_error_bars, phase3_angle_error_bars | (T, 22, 2), (T, 13) | as in fit.npz; missing if unknown |
| observed | (T, 55) | as in FitResult |
| size | () | as in FitResult; missing if unknown |
| start_there, start_points, start_off, start_betas, ... | (T, ...) | the `GivenStart` of phase 1, if any |
| gravity, ground, contacts, ... | | see fitting_core/ground/arrays.py; runs of earlier versions have none |
| about | () | JSON: camera, phases, warnings, pose prior, the given start, format |

Readable with np.load(allow_pickle=False).
"""

from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, is_possible, with_focal_from
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import read_npz
from fitting_core.ground.arrays import grounding_arrays, grounding_from
from fitting_core.results.error_bars import error_bar_arrays, error_bars_from
from fitting_core.results.fit_result import FitResult, PhaseResult, earlier_size, size_from
from fitting_core.results.given_start import GivenStart, StartRecord
from fitting_core.results.provenance import Provenance
from tcfit_app.project.storage.accessing import accessing

FORMAT = "tcfit run 1"
OBSERVED = 55
"""Joints in `FitResult.observed`."""
_NAMES = tuple(f.name for f in fields(BodyParams))
_WIDTHS = {name: tensor.shape[1] for name, tensor in vars(BodyParams.neutral(0)).items()}
_HANDS = ("left_hand_pose", "right_hand_pose")
_START = "start_"
_START_WIDTHS: dict[str, tuple[int, ...]] = {"there": (), "points": (25, 3), "off": (25,)}
"""Arrays of a given start, with their shapes after the frame axis."""


class PhaseRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The data of a phase besides its arrays."""

    phase: int
    terms: tuple[str, ...]
    seconds: float
    notes: tuple[str, ...]

    @staticmethod
    def of(phase: PhaseResult) -> "PhaseRecord":
        """The record of a phase."""
        return PhaseRecord(
            phase=phase.phase, terms=tuple(phase.objective), seconds=float(phase.seconds), notes=phase.notes
        )


class _About(msgspec.Struct, frozen=True, kw_only=True):
    # Unknown fields are ignored: runs of earlier versions have a "sharpness", no longer used.

    format: str
    camera: Camera
    phases: tuple[PhaseRecord, ...]
    warnings: tuple[str, ...]
    pose_prior: str
    start: StartRecord | None = None


def write_run(path: Path, fit: FitResult) -> None:
    """Write a fit; it is on disk when this returns. Raises InputError if the folder cannot be written."""
    phases = tuple(map(PhaseRecord.of, fit.phases))
    about = _About(
        format=FORMAT,
        camera=fit.camera,
        phases=phases,
        warnings=fit.warnings,
        pose_prior=fit.pose_prior,
        start=None if fit.start is None else fit.start.about,
    )
    arrays: dict[str, Any] = {"observed": fit.observed, "about": msgspec.json.encode(about).decode()}
    arrays |= grounding_arrays(fit.grounding) | ({} if fit.size is None else {"size": fit.size})
    if (start := fit.start) is not None:
        arrays |= {_START + name: getattr(start, name) for name in _START_WIDTHS}
        arrays |= {_START + name: getattr(start.params, name).detach().cpu().numpy() for name in _NAMES}
    for p in fit.phases:
        arrays |= phase_arrays(p)
    with accessing(path), replacing(path) as draft:
        np.savez(draft, allow_pickle=False, **{name: np.asarray(value) for name, value in arrays.items()})


def phase_arrays(phase: PhaseResult) -> dict[str, np.ndarray]:
    """The arrays of a phase, by their names in the table above."""
    prefix = f"phase{phase.phase}_"
    arrays = {prefix + name: getattr(phase.params, name).detach().cpu().numpy() for name in _NAMES}
    arrays |= {
        f"{prefix}frame_cost": phase.frame_cost,
        f"{prefix}objective": np.array([*phase.objective.values()], float),
    }
    if phase.provenance is not None:
        arrays |= {f"{prefix}start": phase.provenance.start, f"{prefix}stopped": phase.provenance.stopped}
    arrays |= {prefix + name: values for name, values in error_bar_arrays(phase.error_bars).items()}
    return arrays


def read_run(path: Path, config: FitConfig) -> FitResult:
    """Read a file written by `write_run`. Raises InputError if it is missing, damaged, or not a run of tcfit.

    Args:
        path: The file.
        config: The run's configuration, from the database.
    """
    try:
        arrays = read_npz(path)
        stored = msgspec.json.decode(str(arrays["about"]), type=dict[str, Any])
        about = msgspec.convert(stored | {"camera": with_focal_from(stored.get("camera"))}, _About)
        if about.format != FORMAT:
            raise ValueError(f"it is a {about.format!r}, expected {FORMAT!r}")
        phases = tuple(phase_from(arrays, p) for p in about.phases)
        frames = len(phases[0].params)
        observed = _shaped(arrays, "observed", (frames, OBSERVED)).astype(bool)
        grounding = grounding_from(arrays, frames)
        start, size = _start(arrays, about.start, frames), size_from(arrays) or earlier_size(config)
        if about.camera.path is not None and not (is_possible(about.camera) and len(about.camera.path) == frames):
            raise ValueError("its camera path does not match its frames")
    except FileNotFoundError as error:
        raise InputError(f"{path}: is missing; expected the result of a run. Fit again.") from error
    except (OSError, KeyError, IndexError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not a complete result of a run ({error}). Fit again.") from error
    return FitResult(
        phases=phases,
        camera=about.camera,
        config=config,
        observed=observed,
        warnings=about.warnings,
        pose_prior=about.pose_prior,
        grounding=grounding,
        start=start,
        size=size,
    )


def _params(arrays: dict[str, np.ndarray], prefix: str) -> BodyParams:
    frames, components = map(int, arrays[f"{prefix}{_HANDS[0]}"].shape)
    widths = _WIDTHS | dict.fromkeys(_HANDS, components)
    return BodyParams(**{n: torch.from_numpy(_shaped(arrays, prefix + n, (frames, widths[n]))) for n in _NAMES})


def _start(arrays: dict[str, np.ndarray], about: StartRecord | None, frames: int) -> GivenStart | None:
    if about is None or f"{_START}there" not in arrays:
        return None
    known = {name: _shaped(arrays, _START + name, (frames, *width)) for name, width in _START_WIDTHS.items()}
    params = _params(arrays, _START)
    if len(params) != frames:
        raise ValueError(f"its start has {len(params)} frames, expected {frames}")
    return GivenStart(
        params=params, there=known["there"].astype(bool), points=known["points"], off=known["off"], about=about
    )


def phase_from(arrays: dict[str, np.ndarray], about: PhaseRecord) -> PhaseResult:
    """The inverse of `phase_arrays`. Raises KeyError, IndexError or ValueError if an array is missing or misshapen."""
    prefix = f"phase{about.phase}_"
    params, own = _params(arrays, prefix), {name.removeprefix(prefix): values for name, values in arrays.items()}
    frames = len(params)
    costs = _shaped(arrays, f"{prefix}objective", (len(about.terms),))
    return PhaseResult(
        phase=about.phase,
        params=params,
        objective=dict(zip(about.terms, costs.tolist(), strict=True)),
        frame_cost=_shaped(arrays, f"{prefix}frame_cost", (frames,)),
        seconds=about.seconds,
        notes=about.notes,
        provenance=_provenance(arrays, prefix, frames),
        error_bars=error_bars_from(own, frames),
    )


def _provenance(arrays: dict[str, np.ndarray], prefix: str, frames: int) -> Provenance | None:
    names = [f"{prefix}start", f"{prefix}stopped"]
    if not any(name in arrays for name in names):
        return None
    start, stopped = (_shaped(arrays, name, (frames,)).astype(np.uint8) for name in names)
    return Provenance(start, stopped)


def _shaped(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    array = arrays[name]
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    return array
