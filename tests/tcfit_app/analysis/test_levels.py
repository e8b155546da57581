"""Levels of hands and feet in the timeline."""

from dataclasses import replace

import numpy as np

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.ground.contacts import Contacts
from tcfit_app.analysis.levels import LEVELS, level_spans
from tests.samples.posed import fit_of, still_params, with_keypoints
from tests.samples.project_samples import sample_grounding


def test_hands_that_stay_have_no_movement(tiny_body: BodyModel):
    by_hand = level_spans("hand_phases", fit_of(tiny_body, still_params(3)))
    assert len(by_hand) == 2
    for spans in by_hand:
        assert not spans[LEVELS["hand_phases"].words.index("movement")] and ((0, 2),) in spans


def test_a_hand_has_no_phase_where_its_wrist_is_not_seen(tiny_body: BodyModel):
    fit = fit_of(tiny_body, still_params(3))
    confidence = np.ones(fit.clip.keypoints.confidence.shape)
    confidence[1, kp.INDEX["left_wrist"]] = 0.0
    left, right = level_spans("hand_phases", with_keypoints(fit, confidence=confidence))
    assert ((0, 0), (2, 2)) in left and ((0, 2),) in right


def test_feet_stand_seem_to_stand_or_are_in_the_air_where_they_are_seen(tiny_body: BodyModel):
    grounding = sample_grounding(1, 3)
    contacts = Contacts(
        probability=np.array([[0.9, 0.1], [0.9, 0.0], [0.2, 0.9]]),
        standing=np.array([[True, False], [False, False], [False, True]]),
        let_go=np.array([[False, False], [True, False], [False, False]]),
    )
    fit = replace(fit_of(tiny_body, still_params(3)), grounding=replace(grounding, contacts=contacts))
    assert LEVELS["contacts"].parts == ("left foot", "right foot")
    left, right = level_spans("contacts", fit)
    assert left == (((2, 2),), ((1, 1),), ((0, 0),)) and right == (((0, 0),), (), ((2, 2),)), "unseen in frame 1"
    assert level_spans("contacts", replace(fit, grounding=None)) == (((), (), ()),) * 2
