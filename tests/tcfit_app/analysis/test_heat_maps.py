"""The heat maps of the timeline."""

from dataclasses import replace

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.ground.contacts import Contacts
from tcfit_app.analysis.body_regions import REGIONS
from tcfit_app.analysis.heat_maps import HEAT_MAPS, heat_map
from tests.samples.posed import displaced, fit_of, still_params, with_keypoints
from tests.samples.project_samples import sample_grounding


def test_an_error_is_that_of_its_part_alone(tiny_body: BodyModel):
    fit = displaced(fit_of(tiny_body, still_params(4)), 1, "left_wrist", (24.0, -7.0))
    fit = displaced(fit, 2, "neck", (50.0, 0.0))  # which no preset fits
    found = heat_map("error_by_part", fit)
    arm, others = found.parts.index("left arm"), [i for i, part in enumerate(found.parts) if part != "left arm"]
    weights = fit.clip.keypoints.confidence[1, list(REGIONS["left arm"])]
    wrist = REGIONS["left arm"].index(kp.INDEX["left_wrist"])
    np.testing.assert_allclose(found.values[:, arm], [0, 25 * weights[wrist] / weights.sum(), 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.nan_to_num(found.values[:, others]), 0, atol=1e-9)
    assert 0 < found.top <= found.values[1, arm]


def test_confidence_counts_what_is_missing_in_a_frame_but_not_what_is_never_there(tiny_body: BodyModel):
    fit = fit_of(tiny_body, still_params(3))
    confidence = np.full(fit.clip.keypoints.confidence.shape, 0.8)
    confidence[1, list(REGIONS["right foot"])] = 0.0
    confidence[:, kp.FACE] = 0.0
    found = heat_map("confidence_by_part", with_keypoints(fit, confidence=confidence))
    by_part = dict(zip(found.parts, found.values.T, strict=True))
    np.testing.assert_allclose(by_part["right foot"], [0.8, 0, 0.8])
    np.testing.assert_allclose(by_part["torso"], 0.8)
    assert found.top == 1.0


@pytest.mark.parametrize("name", [name for name in HEAT_MAPS if name != "contacts"])
def test_a_clip_without_keypoints_has_none(tiny_body: BodyModel, name: str):
    fit = fit_of(tiny_body, still_params(2))
    found = heat_map(name, with_keypoints(fit, confidence=np.zeros(fit.clip.keypoints.confidence.shape)))
    assert found.values.shape == (2, len(HEAT_MAPS[name].parts)) and np.isnan(found.values).all() and found.top > 0


def test_hands_that_stay_have_no_movement(tiny_body: BodyModel):
    found = heat_map("hand_phases", fit_of(tiny_body, still_params(3)))
    assert found.parts == ("left", "right") and found.values.shape == (3, 2)
    assert "movement" not in {HEAT_MAPS["hand_phases"].words[int(level)] for level in found.values.flat}


def test_a_hand_has_no_phase_where_its_wrist_is_not_seen(tiny_body: BodyModel):
    fit = fit_of(tiny_body, still_params(3))
    confidence = np.ones(fit.clip.keypoints.confidence.shape)
    confidence[1, kp.INDEX["left_wrist"]] = 0.0
    found = heat_map("hand_phases", with_keypoints(fit, confidence=confidence))
    assert np.isnan(found.values).tolist() == [[False, False], [True, False], [False, False]]


def test_feet_stand_seem_to_stand_or_are_in_the_air_where_they_are_seen(tiny_body: BodyModel):
    grounding = sample_grounding(1, 3)
    contacts = Contacts(
        probability=np.array([[0.9, 0.1], [0.9, 0.0], [0.2, 0.9]]),
        standing=np.array([[True, False], [False, False], [False, True]]),
        let_go=np.array([[False, False], [True, False], [False, False]]),
    )
    fit = replace(fit_of(tiny_body, still_params(3)), grounding=replace(grounding, contacts=contacts))
    found = heat_map("contacts", fit)
    assert found.parts == ("left foot", "right foot")
    np.testing.assert_array_equal(found.values, [[2, 0], [1, np.nan], [0, 2]])
    assert np.isnan(heat_map("contacts", replace(fit, grounding=None)).values).all()
    np.testing.assert_array_equal(heat_map("contacts", fit[1:]).values, found.values[1:])
