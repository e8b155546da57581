"""Figures of the limb joints, against values by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.measure.limbs import LIMB_FIGURES, limb_figures, limb_flexion, limb_pa_mpjpe

STANDING = {
    **dict(shoulder=(0.2, 1.4, 0), elbow=(0.2, 1.1, 0), wrist=(0.2, 1.1, 0.3)),
    **dict(hip=(0.1, 0.9, 0), knee=(0.1, 0.5, 0), ankle=(0.1, 0.1, 0)),
}
"""Elbows bent at a right angle, knees straight; hips bent by what the trunk tapers."""


def limbs(**moved: tuple[float, float, float]) -> np.ndarray:
    """One frame, both sides alike."""
    places = STANDING | moved
    sided = {"left": 1, "right": -1}
    names = [kp.BODY_25[i].split("_") for i in kp.LIMBS]
    return np.array([[np.array(places[part]) * [sided[side], 1, 1] for side, part in names]])


def test_flexion_by_hand():
    assert limb_flexion(limbs(), "elbow") == pytest.approx(np.full((1, 2), 90))
    assert limb_flexion(limbs(), "knee") == pytest.approx(np.zeros((1, 2)), abs=1e-9)
    assert limb_flexion(limbs(), "hip") == pytest.approx(np.full((1, 2), np.degrees(np.arctan(0.1 / 0.5))))
    bent = limbs(ankle=(0.1, 0.5 - 0.4 * np.cos(0.5), -0.4 * np.sin(0.5)))
    assert limb_flexion(bent, "knee") == pytest.approx(np.full((1, 2), np.degrees(0.5)))


def test_one_rotation_of_the_clip_is_no_error_and_a_second_one_is():
    rng = np.random.default_rng(0)
    truth = np.tile(limbs(), (6, 1, 1)) + rng.normal(0, 0.1, (6, 12, 3))
    turn = Rotation.from_euler("xyz", [1.0, -0.5, 2.0])
    turned = turn.apply(truth.reshape(-1, 3)).reshape(truth.shape) + rng.normal(0, 1, (6, 1, 3))
    assert limb_figures(turned, truth) == pytest.approx(dict.fromkeys(LIMB_FIGURES, 0.0), abs=1e-9)
    half = np.concatenate([turned[:3], truth[3:]])
    assert limb_figures(half, truth)["turned_mpjpe"] > 100
    assert limb_pa_mpjpe(half, truth) == pytest.approx(np.zeros(6), abs=1e-9)


def test_distances_from_the_middle_of_the_hips_and_root_mean_squares_of_angles():
    truth, found = np.tile(limbs(), (2, 1, 1)), np.tile(limbs(), (2, 1, 1))
    found[:, kp.LIMBS.index(kp.INDEX["left_knee"]), 0] += 0.01
    found[:, kp.LIMBS.index(kp.INDEX["right_knee"]), 0] -= 0.01
    assert limb_figures(found, truth)["turned_mpjpe"] == pytest.approx(20 / 12)
    knees = limbs(ankle=(0.1, 0.5 - 0.4 * np.cos(0.5), -0.4 * np.sin(0.5)))
    found = np.concatenate([truth[:1], knees])
    assert limb_figures(found, truth)["knee_flexion"] == pytest.approx(np.degrees(0.5) / np.sqrt(2))


def test_what_is_not_known_does_not_count():
    truth = np.tile(limbs(), (3, 1, 1))
    found = truth.copy()
    found[1, kp.LIMBS.index(kp.INDEX["left_wrist"])] = np.nan
    found[1, kp.LIMBS.index(kp.INDEX["right_ankle"])] += 0.3
    errors = limb_pa_mpjpe(found, truth)
    assert np.isnan(errors[1]) and errors[[0, 2]] == pytest.approx(0, abs=1e-9)
    figures = limb_figures(found, truth)
    assert figures["turned_mpjpe"] == pytest.approx(0, abs=1e-9) and figures["elbow_flexion"] == pytest.approx(0)
    assert figures["knee_flexion"] > 5
    assert set(limb_figures(np.full_like(truth, np.nan), truth).values()) == {None}
