"""Where limbs go in depth: worked out by hand, and with the image unchanged."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from fitting_core.body.geometry import unit
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, INDEX, Keypoints
from tcfit_app.review.gestures.correcting_depth import LimbPoints, SeenBody, Way, limbs_of

CAMERA = Camera(focal=(1e5, 1e5), center=(500.0, 500.0), size=(1000, 1000))
PELVIS, DISTANCE = 399.0, 400.0
"""Metres: so far away that all rays are parallel."""
CLOSE = 1e-3
LEFT_ARM: LimbPoints = (INDEX["left_shoulder"], INDEX["left_elbow"], INDEX["left_wrist"])
RIGHT_ARM: LimbPoints = (INDEX["right_shoulder"], INDEX["right_elbow"], INDEX["right_wrist"])
LEFT_LEG: LimbPoints = (INDEX["left_hip"], INDEX["left_knee"], INDEX["left_ankle"])
ROOT = DISTANCE - PELVIS
"""Depth of the shoulders, metres behind the pelvis."""
WAYS: tuple[Way, ...] = get_args(Way)


def arm(elbow: tuple[float, float], wrist: tuple[float, float]) -> list[tuple[float, float, float]]:
    """From a shoulder straight before the camera: to the side, and behind the shoulder, metres."""
    return [(0.0, 0.0, DISTANCE), *((x, 0.0, DISTANCE + z) for x, z in (elbow, wrist))]


def seen(left: list, right: list | None = None, *, confidence: float = 1.0, swapped: tuple[str, ...] = ()) -> SeenBody:
    """One frame, with the keypoints where the body is."""
    points = np.full((1, COUNT, 3), np.nan)
    points[0, LEFT_ARM], points[0, RIGHT_ARM] = left, right or left
    xy = 500 + 250 * np.nan_to_num(points[..., :2])
    keypoints = Keypoints(xy=xy, confidence=np.full((1, COUNT), confidence))
    return SeenBody(points=points, pelvis=np.array([PELVIS]), keypoints=keypoints, camera=CAMERA, swapped=[swapped])


def test_limbs_of_keypoints():
    assert limbs_of([LEFT_ARM[2]]) == limbs_of([LEFT_ARM[1]]) == (LEFT_ARM,)
    assert limbs_of([INDEX["left_heel"], RIGHT_ARM[2], 30]) == (LEFT_LEG, RIGHT_ARM)
    with pytest.raises(InputError, match="select an elbow"):
        limbs_of([LEFT_ARM[0], INDEX["nose"], 30])


@pytest.mark.parametrize(
    ("elbow", "wrist", "front"),
    [
        (0.2, 0.4, (-0.2, -0.4)),
        (-0.2, -0.4, (-0.2, -0.4)),
        (0.2, 0.1, (-0.2, -0.1)),  # the forearm comes back, as steep as before
        (0.2, -0.15, (-0.2, -0.55)),  # in front of the shoulder it cannot come back by 35 cm
        (0.3, -0.2, (-0.3, -0.8)),
        (-0.2, 0.02, (-0.2, -0.42)),  # the wrist is on neither side: as deep as it can be
    ],
)
def test_in_front_and_behind_are_mirror_images(elbow: float, wrist: float, front: tuple[float, float]):
    body = seen(arm((0.15, elbow), (0.3, wrist)))
    np.testing.assert_allclose(body.sent(LEFT_ARM, "front"), [ROOT + np.array(front)], atol=CLOSE)
    np.testing.assert_allclose(body.sent(LEFT_ARM, "behind"), [ROOT - np.array(front)], atol=CLOSE)
    np.testing.assert_allclose(body.sent(LEFT_ARM, "mirror"), [[ROOT - elbow, ROOT - wrist]], atol=CLOSE)


@pytest.mark.parametrize("way", WAYS)
def test_limbs_keep_their_bones_and_their_place_in_the_image(way: Way):
    """Near the camera too, and at the edge of a wide view, where rays are far from parallel."""
    random, apart, level = np.random.default_rng(0), 0, 0
    for _ in range(200):
        root = random.uniform((-1.5, -1.5, 2.5), (1.5, 1.5, 4))
        bones = unit(random.normal(size=(2, 3))) * [[0.28], [0.25]]
        limb = root + np.cumsum([np.zeros(3), *bones], 0)
        if (abs(limb[1:, 2] - root[2]) < 0.05).any():
            continue
        points = np.full((1, COUNT, 3), np.nan)
        points[0, LEFT_ARM] = limb
        body = replace(seen(arm((0, 0), (0, 0))), points=points, pelvis=np.array([3.0]))
        depth = 3 + body.sent(LEFT_ARM, way)[0]
        if way != "mirror":
            assert ((depth - root[2]) * (1 if way == "behind" else -1) >= -1e-9).all()
            if np.isclose(depth, root[2]).any():
                level += 1
                continue
        found = limb / limb[:, 2:] * np.array([root[2], *depth])[:, None]
        upper, lower = np.linalg.norm(np.diff(found, axis=0), axis=1)
        assert upper == pytest.approx(0.28) and lower > 0.25 - 1e-9
        apart += not np.isclose(lower, 0.25)
        if way == "mirror":
            assert not np.isclose(depth[0], limb[1, 2])
    assert apart < 50, "rays part: the lower bone does not always reach the other one"
    assert level < 50, "at the edge of a wide view, a limb cannot always be on the asked side"


def test_a_limb_in_the_plane_is_as_deep_as_its_image_is_short():
    """The body has bones of 30 and 25 cm across the view; the image shows 18 and 15 cm of them."""
    flat = arm((0.3, 0.0), (0.55, 0.0))
    short = seen(flat)
    short.keypoints.xy[0, LEFT_ARM, 0] = 500 + 250 * np.array([0, 0.18, 0.33])
    np.testing.assert_allclose(short.sent(LEFT_ARM, "front"), [[ROOT - 0.24, ROOT - 0.44]], atol=CLOSE)
    np.testing.assert_allclose(short.sent(LEFT_ARM, "behind"), [[ROOT + 0.24, ROOT + 0.44]], atol=CLOSE)
    np.testing.assert_allclose(seen(flat).sent(LEFT_ARM, "front"), [[ROOT, ROOT]], atol=0.01)
    np.testing.assert_allclose(short.sent(LEFT_ARM, "mirror"), [[ROOT, ROOT]], atol=0.01)
    short.keypoints.confidence[0] = 0
    np.testing.assert_allclose(short.sent(LEFT_ARM, "front"), [[ROOT, ROOT]], atol=0.01, err_msg="nothing is seen")


def test_swapped_sides_are_those_of_the_fit():
    """What is detected as the left arm is the right one, as the fit has found."""
    left, right = arm((0.15, 0.2), (0.3, 0.4)), arm((0.15, 0.1), (0.3, 0.3))
    assert seen(left, right).sent(LEFT_ARM, "mirror")[0].tolist() == pytest.approx([ROOT - 0.2, ROOT - 0.4], abs=CLOSE)
    swapped = seen(left, right, swapped=("arms",))
    assert swapped.sent(LEFT_ARM, "mirror")[0].tolist() == pytest.approx([ROOT - 0.1, ROOT - 0.3], abs=CLOSE)
    assert seen(left, right, swapped=("legs",)).sent(LEFT_ARM, "mirror")[0, 1] == pytest.approx(ROOT - 0.4, abs=CLOSE)
