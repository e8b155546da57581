"""Plays motions of the suite in OpenSim, from MOT files, and compares the model's bones with the fit's segments.

pip install opensim
python -m benchmarks.opensim_playback Rajagopal2015.osim

OpenSim's own classes read the files and move the model, which comes with OpenSim and not with tcfit. All coordinates
are unlocked and free of their ranges, and muscles and couplings are left out.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes, Positional

from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.windows import FRAME_RATE, MotionWindow, acted, shipped_windows
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.measure.angles.angle_files import write_mot
from fitting_core.measure.angles.opensim import ARM_FRAMES, opensim_world
from fitting_core.measure.angles.segments import MIRROR_SIDES, Segments
from fitting_core.motion import Motion

_EVERY = 5
"""Frames."""
_BODIES = {"pelvis": "pelvis", "torso": "thorax"} | {
    f"{body}_{side[0]}": f"{side}_{segment}"
    for side in ("right", "left")
    for body, segment in {
        "femur": "thigh", "tibia": "shank", "calcn": "foot", "humerus": "humerus", "radius": "forearm", "hand": "hand",
    }.items()
}  # fmt: skip
_ARMS = ("humerus", "radius", "hand")


@dataclass(frozen=True, kw_only=True)
class PlaybackOptions:
    """What to play."""

    model: Positional[Path]
    """Rajagopal2015.osim."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """One frame: the model's bodies beside the fit's segments."""

    turned: dict[str, float]
    """Degrees by which a body is turned against its segment."""
    leaning: dict[str, float]
    """Degrees between their long axes."""
    hips_off: float
    """Between the midpoints of the hips, millimetres."""


def run(options: PlaybackOptions) -> None:
    """Plays all windows, and prints the table."""
    model, state = _free_model(options.model)
    body, poses = options.common.load_body(), list[Pose]()
    for name, window in shipped_windows().items():
        progress(name)
        poses += _played(model, state, _motion(window, body))
    report(options, {f"{len(poses)} frames": [_row(name, poses) for name in _BODIES], "Hips": [_hips(poses)]})


def _free_model(path: Path) -> tuple[Any, Any]:
    try:
        import opensim  # type: ignore[import-not-found]
    except ImportError as error:
        raise InputError("OpenSim is not installed here: pip install opensim") from error
    if not path.is_file():
        raise InputError(f"{path}: is not there; give OpenSim's Rajagopal2015.osim.")
    opensim.Logger.setLevelString("error")
    model = opensim.Model(str(path))
    model.updForceSet().setSize(0)
    model.updConstraintSet().setSize(0)
    for joint in model.getJointSet():
        for k in range(joint.numCoordinates()):
            coordinate = joint.upd_coordinates(k)
            coordinate.set_locked(False)
            coordinate.set_clamped(False)
    model.finalizeConnections()
    return model, model.initSystem()


def _motion(window: MotionWindow, body: BodyModel) -> Motion:
    camera = Camera(focal=(500.0, 500.0), center=(320.0, 240.0), size=(640, 480), source="as given")
    params = acted(window, body, (0.0,) * 10)
    return Motion(body=body, params=params, camera=camera, frame_rate=FRAME_RATE, name=window.name, axes="y-up")


def _played(model: Any, state: Any, motion: Motion) -> Iterator[Pose]:
    import opensim  # type: ignore[import-not-found]

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motion.mot"
        write_mot(path, motion)
        table = opensim.TimeSeriesTable(str(path))
    model.getSimbodyEngine().convertDegreesToRadians(table)
    coordinates, values = model.getCoordinateSet(), table.getMatrix().to_numpy()
    segments = Segments(motion)
    world = opensim_world(segments).from_y_up
    joints = segments.joints @ world.T
    expected = {body: world @ _model_axes(body, segments.axes[name]) for body, name in _BODIES.items()}
    for t in range(0, len(values), _EVERY):
        for name, value in zip(table.getColumnLabels(), values[t], strict=True):
            coordinates.get(name).setValue(state, float(value), False)
        model.realizePosition(state)
        bodies = {name: model.getBodySet().get(name) for name in _BODIES}
        played = {name: _matrix(body.getTransformInGround(state).R().asMat33()) for name, body in bodies.items()}
        hips = np.mean([bodies[f"femur_{side}"].getPositionInGround(state).to_numpy() for side in "rl"], 0)
        yield Pose(
            turned={b: _degrees(Rotation.from_matrix(played[b].T @ expected[b][t]).magnitude()) for b in _BODIES},
            leaning={b: _degrees(float(np.arccos(min(1.0, played[b][:, 1] @ expected[b][t, :, 1])))) for b in _BODIES},
            hips_off=1e3 * float(np.linalg.norm(hips - joints[t, [JOINT["left_hip"], JOINT["right_hip"]]].mean(0))),
        )


def _model_axes(body: str, axes: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    """The axes of the model's body in a segment."""
    if not body.startswith(_ARMS):
        return axes
    return axes @ (ARM_FRAMES if body.endswith("_r") else MIRROR_SIDES @ ARM_FRAMES @ MIRROR_SIDES)


def _matrix(matrix: Any) -> Float[np.ndarray, "3 3"]:
    return np.array([[matrix.get(i, k) for k in range(3)] for i in range(3)])


def _degrees(radians: float) -> float:
    return float(np.degrees(radians))


def _row(body: str, poses: list[Pose]) -> Row:
    turned, leaning = (np.array([getattr(p, what)[body] for p in poses]) for what in ("turned", "leaning"))
    return {
        "": body,
        "turned, mean °": turned.mean(),
        "turned, most °": turned.max(),
        "long axes, mean °": leaning.mean(),
        "long axes, most °": leaning.max(),
    }


def _hips(poses: list[Pose]) -> Row:
    return {"": "midpoint", "most, mm": max(pose.hips_off for pose in poses)}


if __name__ == "__main__":
    start(PlaybackOptions, run)
