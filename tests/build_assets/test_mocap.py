"""Readers of motion capture against poses whose geometry is known, and which collections are trained on."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.collections import split
from build_assets.motion_capture.mocap import SourceMotion, read_motions
from fitting_core.errors import InputError
from tests.build_assets.captured import (
    CMU_JOINTS,
    cmu_channels,
    deepmimic_frames,
    write_cmu,
    write_deepmimic,
)


def only(folder: Path) -> SourceMotion:
    (motion,) = read_motions(folder)
    return motion


def test_a_cmu_clip_at_rest_stands_on_its_offsets(tmp_path: Path):
    motion = only(write_cmu(tmp_path, {"07_01": cmu_channels(frames=4)}))
    assert (motion.name, motion.subject, motion.source, motion.fps) == ("07_01", "cmu07", "cmu", 30.0)
    assert motion.description == "made up, for a test"
    assert len(motion) == 3, "the first frame is the figure's own T-pose"
    expected, joint = np.zeros(3), "lHand"
    while joint is not None:
        parent, offset = CMU_JOINTS[joint]
        expected, joint = expected + np.array(offset) / 100, parent
    hand = motion.positions[0, motion.skeleton.index("lHand")]
    np.testing.assert_allclose(hand, expected, atol=1e-12)
    np.testing.assert_array_equal(motion.rotations, np.broadcast_to(np.eye(3), motion.rotations.shape))


def test_cmu_channels_turn_in_their_order(tmp_path: Path):
    """BVH: the first channel is the outermost, and the root has another order than the other joints."""
    channels = cmu_channels({"hip": (30, 40, 50), "lShldr": (10, 20, 70)})
    channels[:, :3] = [100, 200, 300]
    motion = only(write_cmu(tmp_path, {"07_01": channels}))
    z, y, x = (Rotation.from_euler(axis, a, degrees=True).as_matrix() for axis, a in (("z", 30), ("y", 40), ("x", 50)))
    np.testing.assert_allclose(motion.world("hip")[0], z @ y @ x, atol=1e-12)
    local = [Rotation.from_euler(axis, a, degrees=True).as_matrix() for axis, a in (("z", 10), ("x", 20), ("y", 70))]
    np.testing.assert_allclose(motion.world("lForeArm")[0], z @ y @ x @ np.linalg.multi_dot(local), atol=1e-12)
    np.testing.assert_allclose(motion.positions[0, 0], [1, 2, 3], atol=1e-12)


@pytest.mark.parametrize("side, sign", [("left", 1), ("right", -1)])
def test_a_deepmimic_figure_bends_its_limbs_as_people_do(tmp_path: Path, side: str, sign: int):
    frames = deepmimic_frames({f"{side}_knee": [-1.2], f"{side}_elbow": [1.2]})
    motion = only(write_deepmimic(tmp_path, {"sit": frames}))
    at = {name: motion.positions[0, i] for i, name in enumerate(motion.skeleton.joints)}
    assert at[f"{side}_hip"][0] * sign > 0.05, "the left is at +x"
    assert at["neck"][1] > at["chest"][1] > at["root"][1]
    assert at[f"{side}_ankle"][2] < at[f"{side}_knee"][2] - 0.3, "shanks fold backward"
    assert at[f"{side}_wrist"][2] > at[f"{side}_elbow"][2] + 0.2, "forearms fold forward"


def test_a_deepmimic_figure_walks_towards_positive_z(tmp_path: Path):
    """Its axes: x forward, y up, z to the right."""
    frames = deepmimic_frames()
    frames[:, 1:4] = [[0, 1, 0], [1, 1, 0], [1, 1, 1]]
    motion = only(write_deepmimic(tmp_path, {"walk": frames}))
    np.testing.assert_allclose(motion.positions[:, 0], [[0, 1, 0], [0, 1, 1], [-1, 1, 1]], atol=1e-12)
    assert motion.fps == pytest.approx(30)


def test_a_folder_without_motion_capture_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="holds no motion capture"):
        list(read_motions(tmp_path / "missing"))
    (tmp_path / "deepmimic").mkdir()
    with pytest.raises(InputError, match="humanoid3d_walk"):
        list(read_motions(tmp_path))


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("cmu/skeleton.json", "\xff nonsense"),
        ("cmu/manifest.csv", "\xff nonsense"),
        ("cmu/clips/07_01.npz", "\xff nonsense"),
        ("deepmimic/humanoid3d_walk.txt", json.dumps([1, 2])),
        ("deepmimic/humanoid3d_walk.txt", json.dumps({"Frames": [[0.0] * 44, [0.0] * 3]})),
        ("deepmimic/humanoid3d_walk.txt", json.dumps({"Frames": []})),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, file: str, content: str):
    write_cmu(tmp_path, {"07_01": cmu_channels()})
    write_deepmimic(tmp_path, {"walk": deepmimic_frames()})
    (tmp_path / file).write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=Path(file).name):
        list(read_motions(tmp_path))


HELD = {"cmu05", "cmu13", "cmu14"}


@dataclass
class Clip:
    """What `split` looks at."""

    subject: str


def test_subjects_are_held_out():
    seen, held = split([Clip(subject) for subject in ("cmu01", "cmu05", "deepmimic", "cmu13", "cmu14")])  # pyright: ignore[reportArgumentType]
    assert [clip.subject for clip in seen] == ["cmu01", "deepmimic"]
    assert {clip.subject for clip in held} == HELD
