"""Vertices for the views, evaluated only in frames whose parameters have changed."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from tcfit_app.analysis.meshes import FrameByFrame, Meshes
from tests.samples.scenes import random_params


@pytest.fixture
def meshes(tiny_body: BodyModel) -> Meshes:
    return Meshes(tiny_body)


def test_one_frame_is_that_of_the_batch(meshes: Meshes):
    params = random_params(35)
    together = meshes.batch(params)
    assert len(together) == len(params)
    for frame in (0, 15, 16, len(params) - 1):
        np.testing.assert_allclose(meshes.vertices("a", params, frame), together[frame], rtol=0, atol=1e-6)


def test_a_version_is_evaluated_once_and_cannot_be_written(meshes: Meshes):
    first, second = random_params(2, seed=1), random_params(2, seed=2)
    vertices = meshes.vertices("run 1", first, 1)
    assert meshes.vertices("run 1", second, 1) is vertices, "the same version stands for the same parameters"
    assert abs(meshes.vertices("run 2", second, 1) - vertices).max() > 0.01
    with pytest.raises(ValueError, match="read-only"):
        vertices[0] = 0


def test_memory_is_limited(tiny_body: BodyModel):
    size = 12 * len(tiny_body.template)
    meshes, params = Meshes(tiny_body, limit=3 * size), random_params(5)
    found = [meshes.vertices("a", params, frame) for frame in range(5)]
    assert [meshes.vertices("a", params, frame) is found[frame] for frame in (4, 3, 2)] == [True] * 3
    assert meshes.vertices("a", params, 0) is not found[0]
    assert all(vertices.base is None or vertices.base.nbytes == size for vertices in found)


# --- frame by frame ---


class Counting:
    """Sums of betas, and how many frames each call was asked for."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, params: BodyParams) -> np.ndarray:
        self.asked.append(len(params))
        return sum(values.numpy().sum(1) for values in vars(params).values())


def moved(params: BodyParams, frames: list[int], by: float = 0.1) -> BodyParams:
    pose = params.body_pose.clone()
    pose[frames, 3] += by
    return replace(params, body_pose=pose)


@pytest.fixture
def params() -> BodyParams:
    return random_params(12)


@pytest.mark.parametrize("frames", [[], [0], [3, 4, 11], list(range(12))])
def test_only_what_has_changed_is_evaluated(params: BodyParams, frames: list[int]):
    count = Counting()
    known = FrameByFrame(count)
    before = known(params)
    copy = before.copy()
    after = moved(params, frames)
    np.testing.assert_allclose(known(after), Counting()(after))
    assert count.asked == [12, *([len(frames)] if frames else [])]
    np.testing.assert_array_equal(before, copy, "what was handed out stays")
    assert not before.flags.writeable


def test_no_more_is_evaluated_than_has_changed(params: BodyParams):
    """Since the nearest of what is known; other lengths and hands are others, and what is no number is never known."""
    far, broken = moved(params, list(range(10))), moved(params, [5], float("nan"))
    wide = torch.zeros(12, 45, dtype=torch.float64)
    for values, asked in (
        ((params, far, moved(far, [11]), far), [12, 10, 1]),
        ((params, params[2:5], replace(params, left_hand_pose=wide, right_hand_pose=wide)), [12, 3, 12]),
        ((broken, moved(broken, [])), [12, 1]),
    ):
        count = Counting()
        known = FrameByFrame(count)
        for value in values:
            known(value)
        assert count.asked == asked


def test_joints_and_keypoints_of_a_corrected_fit(tiny_body: BodyModel, params: BodyParams):
    one, fresh = Meshes(tiny_body), Meshes(tiny_body)
    one.joints(params), one.keypoints(params)
    after = moved(params, [2, 7], 0.5)
    for found, expected in ((one.joints(after), fresh.joints(after)), (one.keypoints(after), fresh.keypoints(after))):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert not np.allclose(one.joints(after)[2], one.joints(params)[2])
