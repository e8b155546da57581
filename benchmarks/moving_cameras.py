"""What the path of a moving camera is worth: captured motion filmed by cameras that move, fitted with and without it.

People of the motion suite's tuning half before a lens of 35 mm, with the suite's measured detector. The camera stands
still, turns after the person, goes around or past them, or is held in the hand; the last one also with the lens of an
action camera. A fit is told the path, or the path without its scale, which is estimated then, or takes the camera for
one that stands where it was in the first frame. Joints are compared in the world, whose floor is level: where an export
with `--axes world` has them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes, arg

from benchmarks.lenses import LENSES
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import motion_sequences
from evaluation.synthetic.motion_suite.measured_detector import detected
from evaluation.synthetic.motion_suite.windows import FRAME_RATE, MotionWindow, acted, shipped_windows
from evaluation.synthetic.suite import in_view, subject_body
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, CameraPath, Lens, World, path_of, project
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.ground.path_scale import estimate_path_scale
from fitting_core.lens import filmed, straightened_keypoints
from fitting_core.metrics import jitter, mpjpe, pa_mpjpe
from fitting_core.motion import OWN_WORLD, Motion
from fitting_core.render.renderer import DEFAULT_COLOR, DrawnMesh, Renderer
from fitting_core.render.sheets import View

WINDOWS = ("05_02_1", "14_07_1", "13_30_1")
"""A dance, reaching and sport. In the last one no foot rests."""
_FOCAL, _SIZE = 1250.0, (1280, 720)
_DISTANCE, _HEIGHT = 5.0, 1.5
"""Metres of the camera from the person, and above the floor."""
_BODY = slice(0, JOINT["right_wrist"] + 1)
_FEET = [JOINT["left_foot"], JOINT["right_foot"]]
_UNIT = 0.23
"""Metres of a path's unit, where its scale is not told."""
_TRUTH_COLOR = (0.75, 0.75, 0.75)
Poses = tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]
"""x_camera = rotation x_world + translation."""


def _looking(places: Float[np.ndarray, "T 3"], at: Float[np.ndarray, "T 3"]) -> Poses:
    """Held upright."""
    ahead = at - places
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotation = np.stack([right, np.cross(ahead, right), ahead], 1)
    return rotation, -np.einsum("tij,tj->ti", rotation, places)


def _around(person: Float[np.ndarray, "T 3"], degrees: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T 3"]:
    angle = np.radians(degrees)
    away = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], 1)
    return person.mean(0) * [1, 0, 1] + [0, _HEIGHT, 0] + _DISTANCE * away


def _still(person: Float[np.ndarray, "T 3"]) -> Poses:
    return _looking(_around(person, np.full(len(person), 30.0)), np.tile(person.mean(0), (len(person), 1)))


def _pan(person: Float[np.ndarray, "T 3"]) -> Poses:
    """Turns after the person, and swings by 15 degrees to either side."""
    places = _around(person, np.full(len(person), 30.0))
    swing = 0.25 * np.sin(np.linspace(0, 2 * np.pi, len(person)))[:, None] * _DISTANCE * np.array([[0.87, 0, -0.5]])
    return _looking(places, gaussian_filter1d(person, 8, axis=0) + swing)


def _orbit(person: Float[np.ndarray, "T 3"]) -> Poses:
    """A quarter of a circle about the person."""
    return _looking(_around(person, np.linspace(-15, 75, len(person))), gaussian_filter1d(person, 8, axis=0))


def _dolly(person: Float[np.ndarray, "T 3"]) -> Poses:
    """Two metres past the person, looking ahead all the time."""
    places = _around(person, np.full(len(person), 30.0))
    aside = np.linspace(-1.0, 1.0, len(person))[:, None] * np.array([[0.87, 0, -0.5]])
    return _looking(places + aside, np.tile(person.mean(0), (len(person), 1)) + aside)


def _hand(person: Float[np.ndarray, "T 3"]) -> Poses:
    """Held in the hand of somebody who goes a step: it sways by some centimetres and shakes by a degree."""
    rng, count = np.random.default_rng(5), len(person)

    def wandering(seconds: float) -> Float[np.ndarray, "T 3"]:
        noise = gaussian_filter1d(rng.standard_normal((count, 3)), seconds * FRAME_RATE, axis=0, mode="wrap")
        return noise / noise.std(0)

    walk = np.linspace(-0.3, 0.3, count)[:, None] * np.array([[0.87, 0, -0.5]])
    places = _around(person, np.full(count, 30.0)) + walk + 0.05 * wandering(0.4) + 0.008 * wandering(0.08)
    rotation, _ = _looking(places, gaussian_filter1d(person, 12, axis=0))
    shake = Rotation.from_rotvec(np.radians(1.5 * wandering(0.35) + 0.4 * wandering(0.06))).as_matrix()
    rotation = shake @ rotation
    return rotation, -np.einsum("tij,tj->ti", rotation, places)


CAMERAS: dict[str, Callable[[Float[np.ndarray, "T 3"]], Poses]] = {
    "still": _still,
    "pan": _pan,
    "orbit": _orbit,
    "dolly": _dolly,
    "hand": _hand,
}


@dataclass(frozen=True, kw_only=True)
class MovingCameras:
    """How much is fitted."""

    windows: tuple[str, ...] = WINDOWS
    """Of the motion suite."""
    cameras: tuple[str, ...] = tuple(CAMERAS)
    """Of CAMERAS."""
    told: tuple[str, ...] = ("path", "path without scale", "nothing")
    """What the fit knows."""
    sheets: Annotated[Path | None, arg(metavar="FOLDER")] = None
    """Where pictures go in which fit and truth are seen from aside, in the world."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shot:
    """A person before a camera, and the truth."""

    clip: Clip
    """Whose camera knows its path."""
    body: BodyModel
    world: BodyParams
    window: MotionWindow
    pixels: Float[np.ndarray, "T K 2"]
    """Without noise."""


def run(options: MovingCameras) -> None:
    """Fit all, and report."""
    ready.use(threads=options.common.threads)
    rows: list[Row] = []
    ways: list[tuple[str, str, tuple[float, ...] | None]] = [(name, name, None) for name in options.cameras]
    if "hand" in options.cameras:
        ways.append(("hand, action camera", "hand", LENSES["action camera"]))
    for title, name, distortion in ways:
        found: dict[str, list[dict[str, float]]] = {}
        for window in options.windows:
            shot = _filmed(window, CAMERAS[name], distortion)
            for told in options.told if name != "still" else ("nothing",):
                fit = _fitted(shot, told)
                found.setdefault(told, []).append(_figures(shot, fit))
                progress(f"{title} {window} {told} {found[told][-1]}")
                if options.sheets is not None:
                    _write_sheet(options.sheets / f"{title.replace(', ', '_')}_{window}_{told}.jpg", shot, fit)
        for told, figures in found.items():
            means = {key: float(np.nanmean([f[key] for f in figures])) for key in figures[0]}
            rows.append({"camera": title, "told": told} | means)
    report(options, {"Moving cameras": rows})


def _filmed(name: str, moves: Callable[..., Poses], distortion: tuple[float, ...] | None) -> _Shot:
    sequence, window = motion_sequences()[name], shipped_windows()[name]
    body = subject_body(sequence.subject)
    world = acted(window, body, sequence.subject.betas)
    rotation, translation = moves(joints_in_space(body, world)[:, JOINT["pelvis"]])
    camera = _camera(rotation, translation, distortion)
    motion = Motion(body=body, params=world, camera=camera, frame_rate=FRAME_RATE, name=name, axes=OWN_WORLD)
    params = motion.in_axes("camera").params
    points, exists = keypoints_in_space(body, params)
    straight = np.nan_to_num(project(camera, torch.as_tensor(points)).numpy())
    seen = straight if camera.lens is None else filmed(camera.lens, straight)
    keypoints = detected(
        seen,
        exists & in_view(body, params, camera),
        np.asarray(((seen >= 0) & (seen < camera.size)).all(-1)),
        camera.focal[0] / np.maximum(np.nan_to_num(points[..., 2], nan=_DISTANCE), 0.1),
        frame_rate=FRAME_RATE,
        rng=np.random.default_rng([sequence.seed, 2]),
    )
    keypoints, _ = straightened_keypoints(keypoints, camera.lens)
    clip = Clip(keypoints=keypoints, camera=camera, frame_rate=FRAME_RATE, name=name)
    return _Shot(clip=clip, body=body, world=world, window=window, pixels=straight[:, :25])


def _camera(
    rotation: Float[np.ndarray, "T 3 3"], translation: Float[np.ndarray, "T 3"], distortion: tuple[float, ...] | None
) -> Camera:
    turns = rotation @ rotation[0].T
    path = path_of(turns, translation - turns @ translation[0])
    (one, two, three), (x, y, z) = rotation[0].tolist(), translation[0].tolist()
    center = (_SIZE[0] / 2, _SIZE[1] / 2)
    lens = Lens(focal=(_FOCAL, _FOCAL), center=center, distortion=distortion) if distortion else None
    world = World(rotation=(tuple(one), tuple(two), tuple(three)), translation=(x, y, z), up="y")
    moves = bool(np.ptp(rotation, axis=0).max() > 1e-9 or np.ptp(translation, axis=0).max() > 1e-9)
    return Camera(
        focal=(_FOCAL, _FOCAL), center=center, size=_SIZE, lens=lens, world=world, path=path if moves else None
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Of a shot."""

    camera: BodyParams
    world: Motion


def _fitted(shot: _Shot, told: str) -> _Fit:
    clip = replace(shot.clip, camera=replace(shot.clip.camera, path=_told(shot.clip, told)))
    params = fit_clip(clip, shot.body, PRESETS["tcfit"]).last.params
    motion = Motion(body=shot.body, params=params, camera=clip.camera, frame_rate=FRAME_RATE, name=clip.name)
    return _Fit(camera=params, world=motion.in_axes(OWN_WORLD))


def _told(clip: Clip, told: str) -> CameraPath | None:
    path, camera = clip.camera.path, clip.camera
    if path is None or told == "nothing":
        return None
    if told == "path":
        return path
    in_units = _scaled(path, 1 / _UNIT)
    found = estimate_path_scale(
        clip.keypoints.xy, clip.keypoints.confidence, replace(camera, path=in_units), clip.frame_rate
    )
    progress(f"{clip.name}: one unit is {_UNIT} m; estimated {found}")
    return in_units if found is None else _scaled(in_units, found.metres)


def _scaled(path: CameraPath, factor: float) -> CameraPath:
    return replace(path, translation=tuple((factor * x, factor * y, factor * z) for x, y, z in path.translation))


def _figures(shot: _Shot, fit: _Fit) -> dict[str, float]:
    """Against the truth, in the world."""
    joints, true = fit.world.joints()[:, _BODY], joints_in_space(shot.body, shot.world)[:, _BODY]
    points, exists = keypoints_in_space(shot.body, fit.camera)
    pixels = project(shot.clip.camera, torch.as_tensor(points[:, :25][:, exists[:25]])).numpy()
    return {
        "in the world mm": float(1e3 * np.linalg.norm(joints - true, axis=-1).mean()),
        "aligned over the clip mm": float(1e3 * np.linalg.norm(_aligned(joints, true) - true, axis=-1).mean()),
        "MPJPE mm": float(mpjpe(joints, true, [JOINT["pelvis"]]).mean()),
        "PA-MPJPE mm": float(pa_mpjpe(joints, true).mean()),
        "slide mm/s": _slide(joints, shot.window.standing),
        "slide of the truth mm/s": _slide(true, shot.window.standing),
        "jitter mm/frame2": jitter(joints),
        "jitter of the truth mm/frame2": jitter(true),
        "in the picture px": float(np.linalg.norm(pixels - shot.pixels[:, exists[:25]], axis=-1).mean()),
    }


def _aligned(joints: Float[np.ndarray, "T 22 3"], true: Float[np.ndarray, "T 22 3"]) -> Float[np.ndarray, "T 22 3"]:
    """Turned and moved as a whole, all frames alike (WA-MPJPE without a scale)."""
    a, b = joints.reshape(-1, 3), true.reshape(-1, 3)
    turn = Rotation.align_vectors(b - b.mean(0), a - a.mean(0))[0]
    return turn.apply(a - a.mean(0)).reshape(joints.shape) + b.mean(0)


def _slide(joints: Float[np.ndarray, "T 22 3"], standing: Bool[np.ndarray, "T 2"]) -> float:
    """Speed of the balls of the feet that truly rest."""
    speed = 1e3 * FRAME_RATE * np.linalg.norm(np.gradient(joints[:, _FEET], axis=0), axis=-1)
    return float(speed[standing].mean()) if standing.any() else math.nan


def _write_sheet(path: Path, shot: _Shot, fit: _Fit) -> None:
    """Five moments of truth (grey) and fit in one world, seen from the front and from aside, with the floor's line."""
    mesh, chosen = shared_mesh(shot.body), np.linspace(0, len(shot.world) - 1, 5).astype(int)
    middle = joints_in_space(shot.body, shot.world)[:, JOINT["pelvis"]].mean(0)
    rows = []
    for degrees in (0.0, 90.0):
        view = View(
            center=(float(middle[0]), 0.85, float(middle[2])), extent=3.4, degrees=degrees, above=4.0, size=(300, 300)
        )
        cells = []
        for frame in chosen.tolist():
            surfaces = [
                DrawnMesh(
                    vertices=view.camera_space(mesh(params[[frame]])[0].numpy().astype(float)),
                    faces=shot.body.faces,
                    color=color,
                )
                for params, color in ((shot.world, _TRUTH_COLOR), (fit.world.params, DEFAULT_COLOR))
            ]
            blank = Renderer(view.camera).draw(surfaces).over()
            ends = view.pixels(middle * [1, 0, 1] + np.array([[-1.7, 0, 0], [1.7, 0, 0], [0, 0, -1.7], [0, 0, 1.7]]))
            for a, b in ((0, 1), (2, 3)):
                cv2.line(blank, ends[a].astype(int).tolist(), ends[b].astype(int).tolist(), (40, 140, 40), 1)
            cells.append(blank)
        rows.append(np.hstack(cells))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1])


if __name__ == "__main__":
    start(MovingCameras, run)
