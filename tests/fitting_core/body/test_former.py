"""Free bodies of before: fits that were made with them keep their joints."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.files.former import former_body, is_former, same_shapes
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.io.known_shape import read_known_shape
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import BodyOf
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.storage.run_record import BodyRecord

NEUTRAL = "b80a4e1a310670de6a96bd076779535d2b09b128d9b51c5383c9a9b3389d8503"
MALE = "68a33223dd840cc2d45984290aefd7e2fd45f965cc19378e6a72c2266b0fd1d1"
JOINTS = {
    "left_hip": (112, -445, 43),
    "left_knee": (132, -829, 50),
    "left_ankle": (144, -1265, 28),
    "left_elbow": (444, 61, 62),
    "left_wrist": (679, 61, 62),
    "right_shoulder": (-183, 61, 62),
}
"""Millimetres, as printed of the former neutral file."""


@pytest.mark.parametrize("name", JOINTS)
def test_a_former_body_has_the_joints_of_its_file(name: str) -> None:
    body = former_body(NEUTRAL)
    assert body is not None and body.hash == NEUTRAL
    np.testing.assert_allclose(1000 * body.rest_joints[JOINT[name]], JOINTS[name], atol=0.6)


def test_its_keypoints_lie_where_todays_joints_do(free_body: BodyModel) -> None:
    body = former_body(NEUTRAL)
    assert body is not None and len(body.keypoint_offsets) == 8
    for name, offset in body.keypoint_offsets.items():
        keypoint = body.rest_joints[JOINT[offset.joint]] + offset.offset
        assert np.linalg.norm(keypoint - free_body.rest_joints[JOINT[name]]) < 0.008


def test_runs_and_references_of_before_find_it() -> None:
    for found in (
        Bodies().of(BodyRecord(kind="smplx", gender="neutral", hash=NEUTRAL, source="/gone/SMPLX_NEUTRAL.npz")),
        body_of(BodyOf(kind="smplx", gender="neutral", hash=NEUTRAL)),
    ):
        assert found is former_body(NEUTRAL)


def test_shapes_carry_over_to_the_body_of_today(free_body: BodyModel, tmp_path: Path) -> None:
    np.savez(tmp_path / "fit.npz", betas=np.linspace(-1, 1, 10), body_hash=NEUTRAL)
    found = read_known_shape(tmp_path / "fit.npz", body_hash=free_body.hash)
    np.testing.assert_array_equal(found.betas, np.linspace(-1, 1, 10))
    assert not same_shapes(MALE, free_body.hash) and not same_shapes("", free_body.hash)
    assert is_former(MALE) and not is_former(free_body.hash) and former_body(free_body.hash) is None
