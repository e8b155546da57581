"""What is said of a walk before a camera that moves: as of one that stands still."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, CameraPath, path_of
from fitting_core.ground.contacts import Contacts, contacts_of
from fitting_core.ground.gravity import angles_to, gravity_before_fit
from fitting_core.lifting.clip_lifting import LiftedClip, lift
from tests.samples.walkers import CAMERA, RATE, Walker, walker


def path(frames: int, *, metres: float) -> CameraPath:
    """Turns by 20 degrees to either side and goes so far aside, back and forth."""
    swing = np.sin(np.linspace(0, 4 * np.pi, frames))[:, None]
    turns = Rotation.from_rotvec(np.radians(20) * swing * [0.1, 1.0, 0.2]).as_matrix()
    return path_of(turns, -(turns @ (metres * swing * [1.0, 0.2, 0.0])[..., None])[..., 0])


def seen_by(camera: Camera, made: Walker) -> tuple[np.ndarray, np.ndarray]:
    """Points in camera space, and pixels."""
    points = camera.from_still(made.points)
    return points, points[..., :2] / points[..., 2:] * camera.focal + camera.center


def lifted_before(camera: Camera, made: Walker) -> LiftedClip:
    xy = seen_by(camera, made)[1]
    return lift(xy, made.confidence, camera, RATE, calibrated=True)


def test_still_space_and_back():
    made, way = walker(), path(108, metres=1.0)
    moving = replace(CAMERA, path=way)
    points = moving.from_still(made.points)
    rotation, translation = np.array(way.rotation), np.array(way.translation)
    np.testing.assert_allclose(points[7, 3], rotation[7] @ made.points[7, 3] + translation[7], atol=1e-12)
    np.testing.assert_allclose(moving.to_still(points), made.points, atol=1e-12)
    np.testing.assert_allclose(moving[5:9].to_still(points[5:9]), made.points[5:9], atol=1e-12)
    np.testing.assert_allclose(moving[[8, 2]].to_still(points[[8, 2]]), made.points[[8, 2]], atol=1e-12)
    assert CAMERA[3:5] is CAMERA and CAMERA.to_still(points) is points


def test_a_camera_that_turns_is_lifted_as_one_that_stands_still():
    made, moving = walker(), replace(CAMERA, path=path(108, metres=0.0))
    one, other = lifted_before(CAMERA, made), lifted_before(moving, made)
    off = np.linalg.norm(moving.turned_to_still(other.points) - one.points, axis=-1)
    # Between samples rays are interpolated, and the virtual camera is held level against another one.
    assert np.median(off) < 0.02 and np.percentile(off, 95) < 0.08
    blind = lift(seen_by(moving, made)[1], made.confidence, CAMERA, RATE, calibrated=True)
    assert np.median(np.linalg.norm(moving.turned_to_still(blind.points) - one.points, axis=-1)) > 2 * np.median(off)
    ups = [gravity_before_fit(found, made.confidence, c).up for found, c in ((one, CAMERA), (other, moving))]
    assert angles_to(ups[0], ups[1]) < 3


@pytest.mark.parametrize("metres", [0.0, 1.0])
def test_feet_that_stand_are_found(metres: float):
    made = walker()

    def found(camera: Camera, path: CameraPath | None) -> Contacts:
        seen = replace(camera, path=path)
        xy, lifted = seen_by(camera, made)[1], lifted_before(camera, made)
        gravity = gravity_before_fit(lifted, made.confidence, seen)
        return contacts_of(xy, made.confidence, lifted, gravity, seen, RATE, made.feet)

    moving = replace(CAMERA, path=path(108, metres=metres))
    right = [
        (contacts.standing == made.standing).mean()
        for contacts in (found(CAMERA, None), found(moving, moving.path), found(moving, None))
    ]
    assert right[1] > 0.85 and right[1] > right[0] - 0.05 and right[1] > right[2] + 0.1
