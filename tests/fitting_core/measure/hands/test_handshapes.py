"""The nearest named handshape: on other bodies, turned hands, hands between two shapes, and the user's own set."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.handshapes import HANDSHAPES, Handshape, finger_angles
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import SIDES, Side
from fitting_core.measure.hands.handshapes import FARTHEST, HandshapeSet, finger_bones, read_handshapes
from fitting_core.shipped import FREE_FOLDER


def posed(body: BodyModel, shapes: list[Handshape], side: Side, jitter: float = 0.0) -> np.ndarray:
    """Keypoints of a body whose hand has these shapes, turned anyhow in space; jitter in degrees."""
    rng = np.random.default_rng(0)
    angles = np.stack([finger_angles(shape, side).reshape(45) for shape in shapes])
    angles += np.radians(jitter) * rng.standard_normal(angles.shape) - body.hand_mean[0 if side == "left" else 1]
    turned = torch.as_tensor(Rotation.random(len(shapes), rng=rng).as_rotvec())
    neutral = replace(BodyParams.neutral(len(shapes), hand_components=45), global_orient=turned)
    return keypoints_in_space(body, replace(neutral, **{f"{side}_hand_pose": torch.as_tensor(angles)}))[0]


@pytest.mark.parametrize("side", SIDES)
def test_every_shape_is_found_on_another_body(free_body: BodyModel, side: Side):
    other = load_body(find_body(gender="male", search=FREE_FOLDER))
    bones = finger_bones(posed(other, list(HANDSHAPES.values()), side), side)
    found = [HandshapeSet(free_body).nearest(bones[[i]]) for i in range(len(bones))]
    assert [f.name for f in found if f] == list(HANDSHAPES)
    assert all(f.degrees < 2 and f.near for f in found if f)


def test_the_distance_grows_with_the_difference(free_body: BodyModel):
    shapes = HandshapeSet(free_body)
    near, far = (
        [
            shapes.nearest(bones[None])
            for bones in finger_bones(posed(free_body, list(HANDSHAPES.values()), "right", degrees), "right")
        ]
        for degrees in (4.0, 8.0)
    )
    assert np.mean([a.degrees for a in near if a]) < np.mean([b.degrees for b in far if b])
    assert np.mean([a.name == name for a, name in zip(near, HANDSHAPES, strict=True) if a]) > 0.9


def test_what_is_like_none_is_far(free_body: BodyModel):
    backwards = replace(HANDSHAPES["flat"], index=(-40, -40, 0), pinky=(90, 0, 90), middle=(0, 100, 0))
    found = HandshapeSet(free_body).nearest(finger_bones(posed(free_body, [backwards], "left"), "left"))
    assert found is not None and found.degrees > FARTHEST and not found.near


def test_a_body_without_fingers_has_no_shape(free_body: BodyModel):
    bones = finger_bones(np.full((2, 137, 3), np.nan), "left")
    assert HandshapeSet(free_body).nearest(bones) is None


OWN = """
[B]
like = "flat"
spread = 0
[claw5]
like = "claw"
index = [10, 60, 40]
thumb_like = "flat"
[almost]
like = "claw5"
"""


def test_the_user_s_own_set(free_body: BodyModel, tmp_path: Path):
    (tmp_path / "own.toml").write_text(OWN)
    own = read_handshapes(tmp_path / "own.toml")
    assert list(own) == ["B", "claw5", "almost"]
    assert own["claw5"] == replace(HANDSHAPES["claw"], index=(10, 60, 40), thumb=HANDSHAPES["flat"].thumb)
    assert own["almost"] == own["claw5"] and own["B"].spread == 0
    found = HandshapeSet(free_body, own).nearest(finger_bones(posed(free_body, [HANDSHAPES["flat"]], "left"), "left"))
    assert found is not None and found.name == "B"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[B", "is not readable TOML"),
        ("", "has no handshapes"),
        ('[B]\nlike = "flet"', r"\[B\]: there is no handshape 'flet'; expected one of relaxed, flat"),
        ("[B]\nspread = 1", r"\[B\]: .*like"),
        ('[B]\nlike = "flat"\nspread = "wide"', r"\[B\]: .*spread"),
        ('[B]\nlike = "flat"\ncurl = 3', r"\[B\]: .*curl"),
        ("B = 3", r"\[B\]"),
    ],
)
def test_sets_that_make_no_sense(tmp_path: Path, text: str, says: str):
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(InputError, match=says):
        read_handshapes(tmp_path / "own.toml")
