"""Whether a fit of noise-free keypoints returns the pose: authored hard poses and held-out motion capture.

Every pose is a frame on its own, fitted by phase 1 without key frames and relay: none starts from another one. All
keypoints are given at confidence 1, whatever hides them; the camera is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder
from benchmarks.figures import BACK, CAMERA, VIEWS, before_camera, figure_of, seen_by, views_of
from benchmarks.hard_poses import HARD_POSES
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from build_assets.motion_capture.collections import split
from build_assets.motion_capture.retarget import load
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.metrics import procrustes
from fitting_core.render.renderer import DEFAULT_COLOR
from fitting_core.render.sheets import Cell, beside, write_sheet
from tests.samples.body_pictures import body_picture, fitted_views

RETURNED_MM = 15.0
"""Mean vertex error under which a pose counts as returned."""
_CHUNK = 32
_WORST, _CELL, _TRUTH = 24, (150, 200), (0.55, 0.55, 0.55)
"""Of a sheet: how many fits, pixels of one view, colour of the truth."""


@dataclass(frozen=True, kw_only=True)
class RecoverPoses:
    """What to fit, and how."""

    presets: tuple[str, ...] = ("tcfit",)
    """Which presets."""
    prior: str | None = None
    """Another pose prior than the preset's."""
    authored: bool = True
    """The poses of hard_poses.py, each from three or four sides."""
    mocap: int = 100
    """How many held-out poses of motion capture."""
    mocap_data: Path | None = None
    """Folder with the motion capture; by default the development data's."""
    betas: float = 0.0
    """Standard deviation of random shapes; 0 is the mean shape."""
    seed: int = 0
    from_truth: bool = True
    """Also minimise the last stage from the truth: what a fit without local minima would find."""
    every: int = 1
    """Take every n-th pose only."""
    first: int = 0
    """Where every n-th pose starts: below `every`, for sets of poses that share none."""
    sheet: Path | None = None
    """Write a picture (PNG) of the worst fits: truth and fit from the camera, truth and fit from the side."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posed:
    """Poses before the camera, in groups."""

    params: BodyParams
    names: tuple[str, ...]
    groups: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def every(self, step: int, first: int) -> "Posed":
        """Each `step`-th pose from `first` on."""
        chosen = torch.arange(first, len(self), step)
        return Posed(params=self.params[chosen], names=self.names[first::step], groups=self.groups[first::step])


def joined(parts: Sequence[BodyParams]) -> BodyParams:
    """Frames of several parameters in a row."""
    return BodyParams(**{f.name: torch.cat([getattr(p, f.name) for p in parts]) for f in fields(BodyParams)})


def shaped(figures: BodyParams, spread: float, seed: int) -> BodyParams:
    """The figures with random betas."""
    betas = spread * np.random.default_rng(seed).standard_normal((len(figures), 10))
    return replace(figures, betas=torch.as_tensor(betas))


def authored(body: BodyModel, spread: float, seed: int) -> Posed:
    """Every pose of HARD_POSES from each of its views."""
    seen = [(pose, view) for pose in HARD_POSES for view in views_of(pose)]
    figures = shaped(joined([figure_of(body, pose) for pose, _ in seen]), spread, seed)
    params = before_camera(body, figures, np.array([view.yaw_degrees for _, view in seen]))
    return Posed(
        params=params,
        names=tuple(f"{pose.name}, {view.name}" for pose, view in seen),
        groups=tuple(pose.category for pose, _ in seen),
    )


def captured(body: BodyModel, folder: Path, count: int, spread: float, seed: int) -> Posed:
    """Held-out poses of motion capture, drawn at random, seen from the four views in turn."""
    _, held = split(load(folder))
    poses = np.concatenate([clip.body_pose for clip in held])
    names = [f"{clip.name} #{i}" for clip in held for i in range(len(clip.body_pose))]
    chosen = np.sort(np.random.default_rng(seed).choice(len(poses), count, replace=False))
    body_pose = poses[chosen]
    views = [(*VIEWS, BACK)[i % 4] for i in range(count)]
    figures = shaped(replace(BodyParams.neutral(count), body_pose=torch.as_tensor(body_pose)), spread, seed + 1)
    params = before_camera(body, figures, np.array([view.yaw_degrees for view in views]))
    return Posed(
        params=params,
        names=tuple(f"{names[i]}, {view.name}" for i, view in zip(chosen, views, strict=True)),
        groups=("motion capture",) * count,
    )


def independent(config: FitConfig, prior: str | None) -> FitConfig:
    """The configuration without what looks at several frames."""
    config = replace(config, last_phase=1, unswap_sides=False, key_frames_every=1, relay_rounds=0, limb_flips_every=1)
    return config if prior is None else replace(config, pose_prior=prior)  # pyright: ignore


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """How far fits are from the truth, each a number for every pose."""

    vertex_mm: Float[np.ndarray, "T"]
    """Mean over the vertices, with the pelvis joints on each other."""
    aligned_mm: Float[np.ndarray, "T"]
    """After Procrustes alignment."""
    camera_mm: Float[np.ndarray, "T"]
    """As they are."""
    pixels: Float[np.ndarray, "T"]
    """Mean reprojection error of the keypoints."""

    def __getitem__(self, which: np.ndarray) -> "Errors":
        return Errors(**{f.name: getattr(self, f.name)[which] for f in fields(Errors)})


def errors_of(body: BodyModel, truth: BodyParams, found: BodyParams) -> Errors:
    """Compares meshes and keypoints."""
    mesh = Mesh(body, dtype=torch.float64)
    columns: list[list[np.ndarray]] = [[], [], []]
    for frames in torch.arange(len(truth)).split(_CHUNK):
        a, b = mesh(found[frames]).numpy(), mesh(truth[frames]).numpy()
        roots = (mesh.joints(found[frames])[:, :1] - mesh.joints(truth[frames])[:, :1]).numpy()
        for column, difference in zip(columns, (a - roots - b, procrustes(a, b) - b, a - b), strict=True):
            column.append(1e3 * np.linalg.norm(difference, axis=-1).mean(1))
    vertex, aligned, camera = (np.concatenate(c) for c in columns)
    (a, exists), (b, _) = keypoints_in_space(body, found), keypoints_in_space(body, truth)
    pixels = [p[:, exists, :2] / p[:, exists, 2:] * CAMERA.focal for p in (a, b)]
    off = np.linalg.norm(pixels[0] - pixels[1], axis=-1).mean(1)
    return Errors(vertex_mm=vertex, aligned_mm=aligned, camera_mm=camera, pixels=off)


def from_truth(stages: Stages, truth: BodyParams) -> tuple[Float[np.ndarray, "T"], BodyParams, np.ndarray]:
    """The objective at the truth, and the minimum of the last stage that is reached from there with its objective."""
    parametrisation, frames = stages.parametrisation, stages.all_frames
    known = parametrisation.from_params(truth)
    objective = stages.objective(N_STAGES, known, stages.free(N_STAGES, betas=True))
    at_truth = objective.cost(known, frames)
    solver = make_solver(stages.config.solver, stages.config.settings)
    solution = drained(solver.minimise(IndependentFrames(objective, frames), known, final=True))
    return at_truth.numpy(), parametrisation.to_params(solution.state), solution.cost.numpy()


@dataclass(frozen=True, kw_only=True, eq=False)
class Recovery:
    """What came of one preset."""

    errors: Errors
    cost: Float[np.ndarray, "T"]
    from_truth: Errors | None
    cost_at_truth: Float[np.ndarray, "T"]
    cost_from_truth: Float[np.ndarray, "T"]
    params: BodyParams
    seconds: float

    @property
    def returned(self) -> Float[np.ndarray, "T"]:
        """Whether the vertex error is small."""
        return self.errors.vertex_mm < RETURNED_MM


def recover(body: BodyModel, poses: Posed, config: FitConfig, *, with_truth: bool) -> Recovery:
    """Fits all poses."""
    clip = Clip(keypoints=seen_by(CAMERA, body, poses.params), camera=CAMERA, frame_rate=25.0, name="poses")
    phase = fit_clip(clip, body, config).phases[0]
    stages = Stages.of(clip.keypoints, clip.camera, body, config, frame_rate=clip.frame_rate)
    nothing = np.full(len(poses), np.nan)
    at_truth, cost, best = nothing, nothing, None
    if with_truth:
        at_truth, refined, cost = from_truth(stages, poses.params)
        best = errors_of(body, poses.params, refined)
    return Recovery(
        errors=errors_of(body, poses.params, phase.params),
        cost=phase.frame_cost,
        from_truth=best,
        cost_at_truth=at_truth,
        cost_from_truth=cost,
        params=phase.params,
        seconds=phase.seconds,
    )


def summary(name: str, recovery: Recovery, which: Int[np.ndarray, "n"] | np.ndarray) -> Row:
    """One line for some of the poses."""
    e, r = recovery.errors[which], recovery
    row: dict[str, str | float] = {
        "poses": name,
        "n": str(len(e.vertex_mm)),
        f"under {RETURNED_MM:.0f} mm %": float(100 * (e.vertex_mm < RETURNED_MM).mean()),
        "vertex mm": float(e.vertex_mm.mean()),
        "median": float(np.median(e.vertex_mm)),
        "p90": float(np.percentile(e.vertex_mm, 90)),
        "aligned mm": float(e.aligned_mm.mean()),
        "camera mm": float(e.camera_mm.mean()),
        "px": float(e.pixels.mean()),
    }
    if r.from_truth is None:
        return row
    best = r.from_truth[which]
    worse = r.cost[which] > 1.01 * r.cost_from_truth[which]
    return row | {
        "worse minimum %": float(100 * worse.mean()),
        "from truth: under %": float(100 * (best.vertex_mm < RETURNED_MM).mean()),
        "from truth: vertex mm": float(best.vertex_mm.mean()),
    }


def pose_rows(poses: Posed, recovery: Recovery) -> list[Row]:
    """One line for each pose."""
    rows: list[Row] = []
    for i, name in enumerate(poses.names):
        e = recovery.errors
        row: dict[str, str | float] = {
            "pose": name,
            "category": poses.groups[i],
            "vertex mm": float(e.vertex_mm[i]),
            "aligned mm": float(e.aligned_mm[i]),
            "camera mm": float(e.camera_mm[i]),
            "px": float(e.pixels[i]),
            "objective": float(recovery.cost[i]),
        }
        if recovery.from_truth is not None:
            row |= {
                "at truth": float(recovery.cost_at_truth[i]),
                "from truth": float(recovery.cost_from_truth[i]),
                "from truth: vertex mm": float(recovery.from_truth.vertex_mm[i]),
            }
        rows.append(row)
    return rows


def tables(poses: Posed, recovery: Recovery) -> tuple[list[Row], list[Row]]:
    """By category, with everything at last; and by pose, the worst first."""
    groups = np.array(poses.groups)
    rows = [summary(group, recovery, groups == group) for group in dict.fromkeys(poses.groups)]
    rows.append(summary("all", recovery, np.ones(len(poses), bool)))
    each = sorted(pose_rows(poses, recovery), key=lambda row: -float(row["vertex mm"] or 0))
    return rows, each


def poses_of(options: RecoverPoses, body: BodyModel) -> Posed:
    """What the options ask for."""
    parts = [authored(body, options.betas, options.seed)] if options.authored else []
    if options.mocap:
        folder = options.mocap_data or data_folder() / "mocap"
        parts.append(captured(body, folder, options.mocap, options.betas, options.seed))
    if not parts:
        raise InputError("There is nothing to fit: leave --authored on, or give --mocap a number.")
    everything = Posed(
        params=joined([p.params for p in parts]),
        names=tuple(name for p in parts for name in p.names),
        groups=tuple(group for p in parts for group in p.groups),
    )
    chosen = everything.every(options.every, options.first)
    if not len(chosen):
        raise InputError(
            f"There is no pose {options.first}: of the {len(everything)} poses --first is the number of one."
        )
    return chosen


def worst_cells(body: BodyModel, poses: Posed, recovery: Recovery) -> list[Cell]:
    """The worst fits, truth in grey: both from the camera, then both from the side, with the pelvis in one place."""
    mesh, cells = Mesh(body), []
    for i in np.argsort(-recovery.errors.vertex_mm)[:_WORST]:
        one = torch.tensor([i])
        seen = [mesh(p[one])[0].numpy() - mesh.joints(p[one])[0, 0].numpy() for p in (poses.params, recovery.params)]
        truth, found = (vertices * (1, -1, -1) for vertices in seen)  # camera space to a sheet's y up, z to the eye
        views = fitted_views(np.concatenate([truth, found]), (0.0, 90.0), size=_CELL)
        pictures = [
            body_picture(vertices, body.faces, view, color=color)
            for view in views
            for vertices, color in ((truth, _TRUTH), (found, DEFAULT_COLOR))
        ]
        cells.append(Cell(picture=beside(pictures), caption=f"{poses.names[i]}: {recovery.errors.vertex_mm[i]:.0f} mm"))
    return cells


def run(options: RecoverPoses) -> None:
    """Fits all poses with every preset, and reports."""
    body = options.common.load_body()
    poses = poses_of(options, body)
    found: dict[str, list[Row]] = {}
    for preset in options.presets:
        progress(f"{preset}: {len(poses)} poses")
        config = independent(config_of(preset), options.prior)
        recovery = recover(body, poses, config, with_truth=options.from_truth)
        if options.sheet:
            path = options.sheet.with_stem(f"{options.sheet.stem}-{preset}") if options.presets[1:] else options.sheet
            write_sheet(path, worst_cells(body, poses, recovery), columns=3)
        rows, each = tables(poses, recovery)
        found[f"{preset}, {config.pose_prior}: by category ({recovery.seconds / len(poses):.2f} s a pose)"] = rows
        found[f"{preset}, {config.pose_prior}: each pose, the worst first"] = each
    report(options, found)


if __name__ == "__main__":
    start(RecoverPoses, run)
