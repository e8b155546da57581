"""Rehabilitation exercises from markers, and standing knees of figures whose legs are too long."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from build_assets.motion_capture import ui_prmd
from build_assets.motion_capture.collections import captured_motion, split
from build_assets.motion_capture.retarget import MotionClip, load
from build_assets.motion_capture.standing import standing_straight
from fitting_core.body.model import JOINT
from fitting_core.errors import InputError
from fitting_core.files.npz import write_npz

KNEES = [3 * (JOINT[f"{side}_knee"] - 1) for side in ("left", "right")]


def standing(bent: float, *, source: str = "cmu", frames: int = 80) -> MotionClip:
    """Somebody who stands on knees that are bent by so many degrees, and then sits."""
    pose = np.zeros((frames, 63))
    pose[:, KNEES] = np.radians(bent)
    pose[frames // 2 :, KNEES] = np.radians(90)
    rest = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
    return MotionClip(
        name="a",
        subject=f"of {source}",
        source=source,
        fps=30.0,
        body_pose=pose,
        orient=np.tile(np.eye(3), (frames, 1, 1)),
        pelvis=np.zeros((frames, 3)),
        feet=np.tile(rest, (frames, 1, 1)),
        leg=0.8,
        frames=np.arange(frames),
        dropped=0,
    )


def test_who_stands_has_straight_knees_and_who_sits_stays_seated():
    made = standing_straight([standing(20.0)])[0]
    knees = np.degrees(made.body_pose[:, KNEES])
    assert knees[:40] == pytest.approx(5.0, abs=0.1) and (knees[40:] > 85).all() and (knees[40:] < 90).all()
    # Hip and foot turn with the knee: the ankle keeps its direction from the hip, and the foot its rotation.
    bend = made.body_pose.reshape(-1, 21, 3)[0, :, 0]
    hip, knee, ankle = (bend[JOINT[f"left_{name}"] - 1] for name in ("hip", "knee", "ankle"))
    assert hip + knee / 2 == pytest.approx(np.radians(10.0)) and hip + knee + ankle == pytest.approx(np.radians(20.0))


def test_markers_of_ones_own_are_believed():
    clip = standing(20.0, source="ui_prmd")
    assert standing_straight([clip, standing(20.0)])[0] is clip


def test_knees_that_reach_are_left_alone():
    clip = standing(4.0)
    np.testing.assert_allclose(standing_straight([clip])[0].body_pose, clip.body_pose, atol=1e-9)


def test_broken_markers_are_refused(tmp_path: Path):
    write_npz(tmp_path / "ui_prmd_vicon_33fps.npz", {"s01_m01_e01": np.zeros((30, 38, 3), np.int16)})
    with pytest.raises(InputError, match=r"s01_m01_e01 is \(30, 38, 3\), expected \(T, 39, 3\)"):
        list(ui_prmd.read_ui_prmd(tmp_path))
    with pytest.raises(InputError, match="cannot be read"):
        list(ui_prmd.read_ui_prmd(tmp_path / "nowhere"))


@pytest.mark.slow
def test_real_exercises(shared_data: Path):
    clips = load(shared_data / "mocap", ("ui_prmd",))
    assert sum(len(clip.body_pose) for clip in clips) > 50_000
    knees = np.concatenate([clip.body_pose[:3, KNEES] for clip in clips if "_m05" not in clip.name])
    assert np.degrees(np.median(knees)) == pytest.approx(3.7, abs=1.0)
    squats = [np.degrees(clip.body_pose[:, KNEES]).max() for clip in clips if "_m01" in clip.name]
    assert 80 < np.median(squats) < 140
    # Ankles of the figure move as the captured ones: the pelvis' height follows the knees.
    deep = max((clip for clip in clips if "_m01" in clip.name), key=lambda clip: len(clip.body_pose))
    bent = deep.body_pose[:, KNEES].mean(1)
    assert np.corrcoef(np.cos(bent / 2), deep.pelvis[:, 1])[0, 1] > 0.95


def test_subjects_are_held_out():
    subjects = ("cmu01", "cmu05", "deepmimic", "cmu13", "cmu14", "prmd s09", "prmd s10")
    seen, held = split([replace(standing(4.0), subject=subject) for subject in subjects])
    assert [clip.subject for clip in seen] == ["cmu01", "deepmimic", "prmd s09"]
    assert [clip.subject for clip in held] == ["cmu05", "cmu13", "cmu14", "prmd s10"]


@pytest.mark.slow
def test_who_is_held_out_is_not_trained_on(shared_data: Path):
    clips, held = split(captured_motion(shared_data / "mocap"))
    assert {clip.subject for clip in held} == {"cmu05", "cmu13", "cmu14", "prmd s10"}
    assert not {"cmu05", "cmu13", "cmu14", "prmd s10"} & {clip.subject for clip in clips} and len(clips) > 700
