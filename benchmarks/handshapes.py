"""Named handshapes fitted to their own keypoints, from the mean hand: how near, and what they look like.

A body raises both hands before it. What a camera of an upper-body clip sees of its 137 keypoints is fitted by stage 5
of phase 1 with everything but the hands at its truth ("hands alone"), or by all of phase 1 ("phase 1"). One image
leaves depth open, so errors in space are told twice: with the wrists in the same place, and with the hands moved and
turned onto each other ("shape").
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from benchmarks.solvers import solved
from evaluation.synthetic.acting.limbs import LIMBS, Figure, hand_rotation
from evaluation.synthetic.acting.performance import standing_root
from fitting_core import keypoints as kp
from fitting_core.body.handshapes import FINGERS, HANDSHAPES, finger_angles
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, POSE_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, default_focal, project
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.fit.events import drained
from fitting_core.fit.phases.independent import fit_frames
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import Free
from fitting_core.keypoints import Keypoints
from fitting_core.render.renderer import Renderer
from fitting_core.world_camera import WorldCamera, in_camera

SIDES: dict[kp.Side, tuple[float, slice]] = {"left": (1.0, kp.LEFT_HAND), "right": (-1.0, kp.RIGHT_HAND)}
VIEWS = {
    "palm": ((0.05, 1.0, 0.1), (-0.1, 0.0, 1.0)),
    "back": ((-0.3, 0.9, 0.1), (0.0, 0.0, -1.0)),
    "edge": ((-0.1, 1.0, 0.25), (-1.0, 0.0, 0.2)),
    "slanted": ((-0.45, 0.55, 0.7), (-0.5, -0.6, 0.3)),
}
"""Directions of the left hand's fingers and palm in the world: x to the person's left, y up, z to the camera."""
_WRIST = (0.17, -0.08, 0.30)
"""From the middle between the shoulders, metres."""
_ELBOW = (0.7, -0.9, -0.2)
_DISTANCE = 2.0
_HEIGHT = 0.18
"""Metres of the camera over the shoulders' middle: below it, so that raised hands are in the image."""
_CELL = 190
_CROP = 0.30  # metres
_BONES = [(a, b) for a, b in kp.BONES if kp.LEFT_HAND.start <= a < kp.LEFT_HAND.stop]


@dataclass(frozen=True, kw_only=True)
class Handshapes:
    """Which handshapes, and how they are seen."""

    out: Positional[Path | None] = None
    """A picture of truth and fit side by side."""
    shapes: tuple[str, ...] = tuple(HANDSHAPES)
    views: tuple[str, ...] = tuple(VIEWS)
    mode: Literal["hands alone", "phase 1"] = "hands alone"
    starts: tuple[float, ...] = (0.0,)
    """hands alone: the shares of a fist from which hands start; each frame keeps its lowest cost."""
    size: tuple[int, int] = (640, 480)
    """Of the image; the hand is about a seventh of its height long."""
    noise: float = 0.0
    """Standard deviation of the keypoints' error in pixels."""
    preset: str = "tcfit"
    drawn: str = "palm"
    """The view that the picture shows; its other half is seen from the side."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One frame for each shape and view."""

    names: list[tuple[str, str]]
    truth: BodyParams
    camera: Camera
    space: Float[np.ndarray, "T 137 3"]
    keypoints: Keypoints


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Of one fit, for each frame and side."""

    pixels: Float[np.ndarray, "T 2"]
    wrist_mm: Float[np.ndarray, "T 2"]
    shape_mm: Float[np.ndarray, "T 2"]


def scene(body: BodyModel, options: Handshapes) -> Scene:
    """The truth and its keypoints."""
    names = [(shape, view) for view in options.views for shape in options.shapes]
    unknown = {s for s, _ in names} - set(HANDSHAPES) | {v for _, v in names} - set(VIEWS)
    if unknown:
        raise InputError(f"There is no {', '.join(sorted(unknown))}; expected shapes of {list(HANDSHAPES)}.")
    focal, (width, height) = default_focal(options.size), options.size
    camera = Camera(focal=(focal, focal), center=(width / 2, height / 2), size=options.size)
    truth = _truth(body, names)
    space, exists = keypoints_in_space(body, truth)
    space = np.where(exists[:, None], space, [0.0, 0.0, 1.0])
    xy = project(camera, torch.as_tensor(space)).numpy()
    inside = exists & ((xy >= 0) & (xy < options.size)).all(-1)
    noise = np.random.default_rng(0).normal(0, options.noise, xy.shape) if options.noise else 0.0
    seen = Keypoints(xy=np.where(inside[..., None], xy + noise, 0.0), confidence=inside.astype(float))
    return Scene(names=names, truth=truth, camera=camera, space=space, keypoints=seen)


def _truth(body: BodyModel, names: list[tuple[str, str]]) -> BodyParams:
    frames = len(names)
    rest, _ = standing_root(body, np.zeros(10).tolist())
    figure = Figure(rest, body.parents, np.tile(rest[0], (frames, 1)))
    middle = (rest[JOINT["left_shoulder"]] + rest[JOINT["right_shoulder"]]) / 2
    for side, (sign, _) in SIDES.items():
        mirror = np.array([sign, 1.0, 1.0])
        fingers, palm = (np.array([VIEWS[view][k] for _, view in names]) * mirror for k in (0, 1))
        pole = np.tile(_ELBOW * mirror, (frames, 1))
        wrist = np.tile(middle + _WRIST * mirror, (frames, 1))
        figure.reach(LIMBS[f"{side}_arm"], wrist, pole, hand_rotation(fingers, palm, side))
        angles = np.stack([finger_angles(HANDSHAPES[shape], side) for shape, _ in names])
        for k, joint in enumerate(f"{side}_{finger}{n}" for finger in FINGERS for n in (1, 2, 3)):
            figure.turn(joint, Rotation.from_rotvec(angles[:, k]).as_matrix())
    pose = Rotation.from_matrix(figure.local.reshape(-1, 3, 3)).as_rotvec().reshape(frames, 55, 3)
    left, right = (torch.as_tensor(pose[:, a : a + 15].reshape(frames, 45)) for a in (25, 40))
    posed = replace(
        BodyParams.neutral(frames, hand_components=45),
        body_pose=torch.as_tensor(pose[:, POSE_JOINTS["body_pose"]].reshape(frames, 63)),
        left_hand_pose=left - torch.as_tensor(body.hand_mean[0]),
        right_hand_pose=right - torch.as_tensor(body.hand_mean[1]),
    )
    before = np.array([0.0, middle[1] - _HEIGHT, _DISTANCE])
    return in_camera(posed, rest[0], WorldCamera(rotation=np.diag([1.0, -1.0, -1.0]), translation=before))


def fit_hands_alone(body: BodyModel, stages: Stages, truth: BodyParams, starts: Sequence[float]) -> BodyParams:
    """Stage 5 of the hands; everything else stays at its truth."""
    solver = make_solver(stages.config.solver, stages.config.settings)
    free = Free(body=False, face=False, betas=False, translation=False)
    best, lowest = None, None
    for share in starts:
        state = stages.parametrisation.from_params(_with_fists(body, truth, share, stages.config.hand_components))
        problem = IndependentFrames(stages.objective(N_STAGES, state, free), stages.all_frames, cold=True)
        found = solved(solver, problem, state, final=True)
        if best is None or lowest is None:
            best, lowest = found.state, found.cost
            continue
        better = found.cost < lowest
        best, lowest = best.put(better, found.state[better]), torch.where(better, found.cost, lowest)
    assert best is not None
    return stages.parametrisation.to_params(best)


def _with_fists(body: BodyModel, params: BodyParams, share: float, components: int) -> BodyParams:
    """With both hands on the way from the mean to a fist."""
    hands = {}
    for i, side in enumerate(SIDES):
        offset = finger_angles(HANDSHAPES["fist"], side).reshape(45) - body.hand_mean[i]
        fist = share * torch.as_tensor(body.hand_components[i, :components] @ offset)
        hands[f"{side}_hand_pose"] = fist.expand(len(params), -1)
    return replace(params, **hands)


def fit_phase_1(stages: Stages) -> BodyParams:
    """Phase 1 without the relay: neighbouring frames have nothing to do with each other here."""
    fits = drained(fit_frames(stages, make_solver(stages.config.solver, stages.config.settings)))
    return stages.parametrisation.to_params(fits.state)


def errors(body: BodyModel, at: Scene, fit: BodyParams) -> Errors:
    """Distances of the hands' 21 keypoints from their truth."""
    space, _ = keypoints_in_space(body, fit)
    pixels, wrist, shape = [], [], []
    for _, points in SIDES.values():
        a, b = at.space[:, points], space[:, points]
        seen, found = (project(at.camera, torch.as_tensor(p)).numpy() for p in (a, b))
        pixels.append(np.linalg.norm(seen - found, axis=-1).mean(1))
        wrist.append(np.linalg.norm((a - a[:, :1]) - (b - b[:, :1]), axis=-1)[:, 1:].mean(1))
        shape.append([_rigid_distance(x, y) for x, y in zip(a, b, strict=True)])
    return Errors(pixels=np.stack(pixels, 1), wrist_mm=1000 * np.stack(wrist, 1), shape_mm=1000 * np.stack(shape, 1))


def _rigid_distance(a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "N 3"]) -> float:
    """Mean distance after the best shift and turn."""
    a, b = a - a.mean(0), b - b.mean(0)
    rotation = Rotation.align_vectors(a, b)[0]
    return float(np.linalg.norm(a - rotation.apply(b), axis=-1).mean())


def rows(at: Scene, found: Errors, by: int) -> list[Row]:
    """Means over sides and views (by = 0: shapes) or over sides and shapes (by = 1: views)."""
    keys = list(dict.fromkeys(name[by] for name in at.names))
    table: list[Row] = []
    for key in [*keys, "all"]:
        rows = [i for i, name in enumerate(at.names) if key in ("all", name[by])]
        means = {f"{n} {side}": float(getattr(found, a)[rows, s].mean()) for n, a in _COLUMNS.items()
                 for s, side in enumerate(SIDES)}  # fmt: skip
        table.append({("shape", "view")[by]: key, **means, "shape mm, worst": float(found.shape_mm[rows].max())})
    return table


_COLUMNS = {"px": "pixels", "mm": "wrist_mm", "shape mm": "shape_mm"}


def picture(body: BodyModel, at: Scene, fit: BodyParams, found: Errors, view: str) -> UInt8[np.ndarray, "H W 3"]:
    """Truth and fit of both hands, as the camera sees them and turned by 80 degrees, one row for each shape."""
    mesh = Mesh(body, dtype=torch.float64)
    frames = [i for i, name in enumerate(at.names) if name[1] == view]
    vertices = [mesh(p[frames]).numpy() for p in (at.truth, fit)]
    cells = []
    for n, i in enumerate(frames):
        hands = []
        for s, (side, (_, points)) in enumerate(SIDES.items()):
            crops = [
                hand_picture(body, v[n], at.space[i, points], side, degrees)
                for degrees in (0.0, 80.0)
                for v in vertices
            ]
            told = f"{found.pixels[i, s]:.1f} px {found.wrist_mm[i, s]:.0f} mm (shape {found.shape_mm[i, s]:.1f})"
            hands.append(captioned(np.concatenate(crops, 1), f"{at.names[i][0]}: truth, fit; turned. {told}"))
        cells.append(np.concatenate(hands, 1))
    half = (len(cells) + 1) // 2
    cells += [np.full_like(cells[0], 255)] * (2 * half - len(cells))
    return np.concatenate([np.concatenate([a, b], 1) for a, b in zip(cells[:half], cells[half:], strict=True)])


def hand_picture(
    body: BodyModel, vertices: Float[np.ndarray, "V 3"], hand: Float[np.ndarray, "21 3"], side: str, degrees: float
) -> UInt8[np.ndarray, "H W 3"]:
    """A hand and its forearm alone, nearly without perspective, turned about the vertical through the true hand."""
    own = [j for name, j in JOINT.items() if name.startswith(f"{side}_") and (name[-1].isdigit() or "wrist" in name)]
    mine = body.skinning_weights[:, [*own, JOINT[f"{side}_elbow"]]].sum(1) > 0.5
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    middle = hand[9]
    seen = (vertices - middle) @ turn.T + [0, 0, 8 * _CROP]
    camera = Camera(focal=(8.0 * _CELL, 8.0 * _CELL), center=(_CELL / 2, _CELL / 2), size=(_CELL, _CELL))
    return Renderer(camera).render(seen, body.faces[mine[body.faces].all(1)])


def captioned(image: UInt8[np.ndarray, "H W 3"], text: str) -> UInt8[np.ndarray, "H W 3"]:
    framed = np.pad(image, ((20, 2), (2, 2), (0, 0)), constant_values=255)
    cv2.putText(framed, text, (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA)
    return framed


def run(options: Handshapes) -> None:
    """Fits, reports, draws."""
    body = options.common.load_body()
    at = scene(body, options)
    config = replace(config_of(options.preset), relay_rounds=0)
    stages = Stages.of(at.keypoints, at.camera, body, config)
    progress(f"{len(at.names)} frames, {options.mode}")
    alone = options.mode == "hands alone"
    fit = fit_hands_alone(body, stages, at.truth, options.starts) if alone else fit_phase_1(stages)
    found = errors(body, at, fit)
    report(options, {f"{options.mode}: by shape": rows(at, found, 0), f"{options.mode}: by view": rows(at, found, 1)})
    if options.out is not None:
        with replacing(options.out) as draft:
            cv2.imwrite(str(draft), picture(body, at, fit, found, options.drawn)[..., ::-1])


if __name__ == "__main__":
    start(Handshapes, run)
