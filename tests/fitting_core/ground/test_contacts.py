"""Which foot stands: a walker whose lifter says nothing of contacts, so that the image and the floor decide."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core.ground.contacts import FOOT_POINTS, Contacts, decided
from fitting_core.ground.gravity import gravity_before_fit
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
