"""Fits that mean nothing are told."""

from dataclasses import replace

import numpy as np
import torch

from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.fit.plausibility import doubts
from tests.samples.project_samples import sample_clip


def standing(distance: float) -> BodyParams:
    params = BodyParams.neutral(6)
    params.camera_translation[:, 2] = torch.tensor(distance)
    return params


def shrunk(share: float) -> Clip:
    clip = sample_clip()
    return replace(clip, keypoints=replace(clip.keypoints, xy=300 + share * clip.keypoints.xy))


def test_a_person_is_no_doubt():
    assert doubts(sample_clip(), standing(4.0)) == ()


def test_a_body_that_is_nowhere():
    (far,) = doubts(sample_clip(), standing(3000.0))
    assert far.startswith("the body is 3e+03 m from the camera")
    (behind,) = doubts(sample_clip(), standing(-2.0))
    assert "-2 m" in behind


def test_keypoints_in_one_place():
    (small,) = doubts(shrunk(0.0), standing(4.0))
    assert small.startswith("the keypoints of the person lie within 0 px")
    assert "within 13 px" in doubts(shrunk(0.03), standing(4.0))[0]


def test_nobody_is_seen():
    clip = sample_clip()
    nobody = replace(clip.keypoints, confidence=np.zeros_like(clip.keypoints.confidence))
    assert doubts(replace(clip, keypoints=nobody), standing(4.0)) == ()
