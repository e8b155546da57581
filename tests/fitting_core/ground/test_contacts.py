"""Which foot stands: a walker whose lifter says nothing of contacts, before a camera that stands and one that moves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import Camera, CameraPath, path_of
from fitting_core.ground.contacts import FOOT_POINTS, Contacts, contacts_of, decided
from fitting_core.ground.gravity import angles_to, gravity_before_fit
from fitting_core.lifting.clip_lifting import LiftedClip, lift
from tests.samples.before_fit import contacts_before_fit
from tests.samples.walkers import CAMERA, RATE, Walker, walker


def contacts(made: Walker, *, contact: float = 0.5, rate: float = RATE) -> Contacts:
    lifted = made.lifted(contact=contact)
    return contacts_before_fit(
        made.xy, made.confidence, lifted, gravity_before_fit(lifted, made.confidence, CAMERA), CAMERA, rate
    )


@pytest.mark.parametrize("noise", [0.0, 1.5])
def test_the_foot_that_does_not_move_stands(noise: float):
    made = walker(noise=noise)
    found = contacts(made)
    assert found.seen.all()
    assert (found.standing == made.standing).mean() > 0.85
    assert found.probability[made.standing].mean() > found.probability[~made.standing].mean() + 0.5


def test_speeds_are_per_second():
    """The same frames three times as slow: nothing moves fast enough to be sure that it does not stand."""
    made = walker()
    slow = contacts(made, rate=RATE / 6)
    assert slow.probability[~made.standing].mean() > contacts(made).probability[~made.standing].mean() + 0.2


def test_the_lifter_has_a_say():
    made = walker()
    yes, no = contacts(made, contact=0.95), contacts(made, contact=0.05)
    assert (yes.probability > no.probability).all() and yes.share > no.share


def test_a_foot_out_of_the_image_has_no_contact():
    made = walker()
    confidence = made.confidence.copy()
    confidence[:, FOOT_POINTS[0]] = 0.1
    found = contacts(replace(made, confidence=confidence), contact=0.95)
    assert not found.seen[:, 0].any() and not found.standing[:, 0].any() and (found.probability[:, 0] == 0).all()
    assert found.seen[:, 1].all() and found.standing[:, 1].any()


def test_a_foot_held_up_still_stands_less():
    """A flamingo: both feet rest, the left one half a metre above the right one."""
    made = walker(30)
    points = np.repeat(made.points[:1], 30, axis=0)
    points[:, FOOT_POINTS[0]] += 0.5 * made.up
    xy = points[..., :2] / points[..., 2:] * CAMERA.focal + CAMERA.center
    found = contacts(replace(made, points=points, xy=xy))
    assert (found.probability[:, 0] < found.probability[:, 1] - 0.1).all()


def test_short_gaps_are_closed_and_flicker_left_out():
    probability = np.full((40, 2), 0.1)
    probability[5:20, 0] = probability[22:30, 0] = 0.9
    probability[20:22, 0] = 0.2
    probability[10:12, 1] = 0.9
    found = decided(probability, 30.0)
    assert np.flatnonzero(found[:, 0]).tolist() == list(range(5, 30))
    assert not found[:, 1].any()


def test_one_frame_is_no_evidence_of_speed():
    found = contacts(walker(1))
    assert found.probability.shape == (1, 2) and np.isfinite(found.probability).all()


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize(("speed", "stays"), [(0.0, True), (0.01, True), (0.05, False), (0.2, False)])
def test_a_foot_that_goes_on_in_the_image_is_let_go(noise: float, speed: float, stays: bool):
    """Metres per second across the image, of somebody who stands for three seconds."""
    made = walker(90)
    points = np.repeat(made.points[:1], 90, axis=0)
    points[..., 0] += speed * np.arange(90)[:, None] / RATE
    xy = points[..., :2] / points[..., 2:] * CAMERA.focal + CAMERA.center
    xy += noise * np.random.default_rng(1).standard_normal(xy.shape)
    found = contacts(replace(made, points=points, xy=xy), contact=0.95)
    assert (found.standing == stays).all() and (found.let_go != stays).all()
    assert found.let_go_in_words(7) == ("" if stays else "left 7-96, right 7-96")


# --- a camera that moves ---


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
