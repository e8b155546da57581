"""The unit of a moving camera's path, from people who stand and walk."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.camera import CameraPath, PathScale, path_of
from fitting_core.ground.path_scale import estimate_path_scale
from tests.samples.walkers import CAMERA, RATE, Walker, walker

FRAMES = 108


def path(*, metres: float) -> CameraPath:
    """Goes so far aside and back, twice, and turns as it goes."""
    swing = np.sin(np.linspace(0, 4 * np.pi, FRAMES))[:, None]
    turns = Rotation.from_rotvec(np.radians(8) * swing * [0.1, 1.0, 0.2]).as_matrix()
    return path_of(turns, -(turns @ (metres * swing * [1.0, 0.2, 0.0])[..., None])[..., 0])


def in_units(true: CameraPath, metres: float) -> CameraPath:
    """The same path in units of that length."""
    return replace(true, translation=tuple((x / metres, y / metres, z / metres) for x, y, z in true.translation))


def estimate(made: Walker, true: CameraPath, metres: float, *, hidden: np.ndarray | None = None) -> PathScale | None:
    points = replace(CAMERA, path=true).from_still(made.points)
    xy = points[..., :2] / points[..., 2:] * CAMERA.focal + CAMERA.center
    confidence = made.confidence.copy()
    if hidden is not None:
        confidence[:, hidden] = 0
    return estimate_path_scale(xy, confidence, replace(CAMERA, path=in_units(true, metres)), RATE)


def standing() -> Walker:
    """The walker of one moment, for all the time."""
    made = walker(FRAMES)
    still = np.zeros(FRAMES, int) + 6
    return replace(made, points=made.points[still], xy=made.xy[still], confidence=made.confidence[still])


@pytest.mark.parametrize("metres", [0.05, 1.0, 40.0])
@pytest.mark.parametrize("person", [walker(FRAMES), standing()], ids=["walks", "stands"])
def test_a_unit_of_any_length_is_found_by_the_feet(person: Walker, metres: float):
    found = estimate(person, path(metres=0.8), metres)
    assert found is not None and found.by == "feet that stand"
    # A figure of sticks is not of the size that the lifter takes people for; all units give the same.
    assert abs(np.log(found.metres / metres)) < 2 * found.deviation
    assert found.deviation < 0.2


def test_one_who_walks_with_the_camera_does_not_hide_its_way():
    made = walker(FRAMES)
    pelvis = made.points[:, kp.INDEX["mid_hip"]]
    beside = path_of(np.tile(np.eye(3), (FRAMES, 1, 1)), -(pelvis - pelvis[0]))
    found = estimate(made, beside, 3.0)
    assert found is not None and abs(np.log(found.metres / 3.0)) < 0.25


@pytest.mark.parametrize(
    ("true", "hidden"),
    [
        (path(metres=0.0), None),
        (path(metres=0.002), None),
        (path(metres=0.8), np.arange(25)),
    ],
    ids=["it only turns", "two millimetres", "nobody is seen"],
)
def test_where_nothing_tells_nothing_is_said(true: CameraPath, hidden: np.ndarray | None):
    assert estimate(walker(FRAMES), true, 1.0, hidden=hidden) is None
