"""The synthetic suite at a fifth of its frame rate and a quarter of its size: bodies, motions, detections."""

from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch

from evaluation.synthetic import suite
from evaluation.synthetic.acting.script import Hazard, Mishaps, failures
from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.studio import Studio
from evaluation.synthetic.suite import (
    SEQUENCES,
    SuiteClip,
    SuiteSequence,
    make_sequence,
    subject_body,
    world_params,
)
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT
from fitting_core.keypoints import INDEX

pytestmark = pytest.mark.thorough

COMPLEX, SIMPLE = SEQUENCES["complex_1"], SEQUENCES["simple_1"]


def small(sequence: SuiteSequence, rate: float = 5.0) -> SuiteSequence:
    """The same motion in fewer and smaller frames."""
    frames = round(sequence.seconds * rate) + 1
    return replace(sequence, frames=frames, frame_rate=rate, scale=0.25)


@lru_cache
def made(sequence: SuiteSequence) -> SuiteClip:
    return make_sequence(sequence, cached=False)


@lru_cache
def world(sequence: SuiteSequence) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints, y up, the floor at 0."""
    body = subject_body(sequence.subject)
    params = world_params(sequence, body)
    return Mesh(body)(params).numpy(), Mesh(body).joints(params).numpy()


def part(sequence: SuiteSequence, *joints: str) -> np.ndarray:
    """Vertices that mostly follow these joints."""
    weights = subject_body(sequence.subject).skinning_weights[:, [JOINT[j] for j in joints]]
    return weights.sum(1) > 0.6


def test_the_table_has_the_papers_shape() -> None:
    assert Counter(s.motion for s in SEQUENCES.values()) == {"simple": 6, "complex": 6, "signing": 1}
    for name, sequence in SEQUENCES.items():
        low, high = {"simple": (50, 100), "complex": (175, 250), "signing": (75, 250)}[sequence.motion]
        assert sequence.name == name and low <= sequence.frames <= high and sequence.frame_rate == 25
    assert len({(s.view, s.focal) for s in SEQUENCES.values()}) == len({s.seed for s in SEQUENCES.values()}) == 13
    assert all(5 < abs(s.view.azimuth) < 40 for s in SEQUENCES.values())
    people = {s.subject for s in SEQUENCES.values() if s.motion != "signing"}
    assert Counter(person.gender for person in people) == {"male": 3, "female": 3}


@pytest.mark.parametrize("name", ["complex_1", "complex_6"])
def test_people_sit_down_cross_legged_with_a_hand_on_the_floor_and_stand_up_again(name: str) -> None:
    sequence = small(SEQUENCES[name])
    vertices, joints = world(sequence)
    hips = joints[:, JOINT["pelvis"], 1]
    assert hips[0] > 0.8 and hips[-1] > 0.8 and hips.min() < 0.2
    assert -0.012 < vertices[..., 1].min() < 0.0
    middle = len(joints) // 2
    left, right = joints[middle, JOINT["left_ankle"], 0], joints[middle, JOINT["right_ankle"], 0]
    assert left < right, "seated, the ankles are crossed"
    hands = [
        vertices[:, part(sequence, f"{side}_wrist", *list(JOINT)[first : first + 15]), 1].min(1)
        for side, first in (("left", 25), ("right", 40))
    ]
    lowest = np.minimum(*hands)
    for half in (slice(0, middle), slice(middle, None)):
        assert -0.012 < lowest[half].min() < 0.012
    assert lowest[middle] > 0.05


def test_the_truth_is_what_the_camera_sees() -> None:
    clip = made(small(SIMPLE))
    assert clip.clip.camera == clip.truth.camera == clip.sequence.camera and clip.truth.camera.size == (180, 240)
    assert len(clip.clip) == len(clip.truth.params) == clip.sequence.frames
    hip = clip.truth.joints[:, JOINT["left_hip"]]
    pixels = hip[:, :2] / hip[:, 2:] * clip.truth.camera.focal + clip.truth.camera.center
    np.testing.assert_allclose(pixels, clip.truth.keypoints[:, INDEX["left_hip"]], atol=1e-6)
    own, mesh = clip.view.pose(), Mesh(clip.body)(clip.truth.params[[0]])[0].numpy().astype(np.float64)
    studio = Studio(clip.truth.camera, seat_height=None, view=clip.view)
    there = (mesh - own.translation) @ own.rotation
    picture, *_ = studio.draw(there, clip.body.faces, vertex_normals(there, clip.body.faces), Outfit.of(clip.body))
    x, y = clip.truth.keypoints[0, [INDEX["neck"], INDEX["mid_hip"]]].mean(0).astype(int)
    assert picture[y, x, 2] > picture[y, x, 0] + 20, "a blue shirt between neck and hips"


def test_the_truth_is_cached_and_the_same_from_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite.platformdirs, "user_cache_path", lambda *_, **__: tmp_path)
    sequence = small(SIMPLE, rate=2.0)
    first = make_sequence(sequence)

    def fail(*_: object) -> None:
        raise AssertionError("it should be in the cache")

    monkeypatch.setattr(suite, "make_truth", fail)
    second = make_sequence(sequence)
    np.testing.assert_array_equal(first.clip.keypoints.xy, second.clip.keypoints.xy)
    assert torch.equal(first.truth.params.body_pose, second.truth.params.body_pose)
    assert second.truth.camera == first.truth.camera
    with pytest.raises(AssertionError, match="in the cache"):
        make_sequence(replace(sequence, seed=8))


def test_failures_lie_in_their_stretch_and_grow_with_the_chance() -> None:
    hazards = [Hazard("dropped", float(i), i + 0.5, ("left_hand",)) for i in range(40)]
    hazards.append(Hazard("swapped", 50.0, 51.0, ("legs",), likely=0.0))
    few, many = (
        failures(hazards, Mishaps(chance=chance, seconds=(0.1, longest)), np.random.default_rng(1))
        for chance, longest in ((0.4, 0.3), (0.8, 0.9))
    )
    assert 8 < len(few) < 24 < len(many) < 39
    for failure in many:
        assert int(failure.start) <= failure.start <= failure.stop <= int(failure.start) + 0.5 + 1e-9
    assert {int(f.start) for f in few} <= {int(f.start) for f in many}
    assert all(f.kind == "dropped" for f in many)
