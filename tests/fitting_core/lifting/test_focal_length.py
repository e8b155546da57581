"""The estimate of a focal length: what is likely, the network's file, and what the shipped one has learned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from evaluation.synthetic.motion_suite import clips
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from fitting_core.camera import Camera, FocalFrom, default_focal
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.keypoints import INDEX
from fitting_core.lifting import focal_length
from fitting_core.lifting.focal_length import FocalEstimate, estimate_focal
from fitting_core.lifting.network import FRAMES, LifterSize
from fitting_core.lifting.perspective import (
    LOG_EXTENTS,
    PerspectiveNet,
    hidden_extent,
    read_perspective,
    write_perspective,
)
from fitting_core.lifting.rays import POINTS

CAMERA = Camera(focal=(1000.0, 1000.0), center=(400.0, 300.0), size=(800, 600), focal_from=FocalFrom.DIAGONAL)
SHARE = torch.full((len(LOG_EXTENTS),), 1 / len(LOG_EXTENTS))


@pytest.fixture(scope="module")
def network() -> PerspectiveNet:
    torch.manual_seed(0)
    return PerspectiveNet(LifterSize(width=24, layers=2, heads=3))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory, network: PerspectiveNet) -> Path:
    path = tmp_path_factory.mktemp("perspective") / "small.npz"
    write_perspective(path, network, seen_share=SHARE, notes="random")
    return path


def somebody(frames: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Random points that walk about, all seen."""
    random = np.random.default_rng(0)
    xy = (
        [400, 300] + 60 * random.standard_normal((1, POINTS, 2)) + random.standard_normal((frames, POINTS, 2)).cumsum(0)
    )
    return xy, np.full((frames, POINTS), 0.8)


# --- what is likely ---


def knowing(extent: float) -> PerspectiveNet:
    """A network that says one extent of everybody, whatever it sees."""
    network = PerspectiveNet(LifterSize(width=24, layers=1, heads=3)).requires_grad_(False)
    last = network.head[2]
    assert isinstance(last, torch.nn.Linear)
    last.weight.zero_()
    last.bias.copy_(-0.5 * ((LOG_EXTENTS - np.log(extent)) / 0.02) ** 2)
    return network


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.2])
def test_a_sure_network_is_believed(tmp_path: Path, factor: float):
    """Who should look smaller by a factor than with the assumed focal length was filmed with a longer one."""
    xy, confidence = somebody()
    rays = torch.as_tensor((xy[None, :FRAMES] - CAMERA.center) / default_focal(CAMERA.size)).float()
    extent = float(hidden_extent(rays, torch.ones(1, FRAMES, POINTS))[1].exp())
    path = tmp_path / "sure.npz"
    write_perspective(path, knowing(extent / factor), seen_share=SHARE, notes="")
    found = estimate_focal(xy, confidence, CAMERA, 20.0, weights=path)
    assert found is not None
    assert found.focal == pytest.approx(factor * default_focal(CAMERA.size), rel=0.1)
    assert found.low < found.focal < found.high < 1.6 * found.low


def test_who_knows_nothing_keeps_to_what_is_usual(
    tmp_path: Path, network: PerspectiveNet, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(focal_length, "_TILT", 0.0)
    silent = PerspectiveNet(network.trunk.size).requires_grad_(False)
    last = silent.head[2]
    assert isinstance(last, torch.nn.Linear)
    last.weight.zero_()
    last.bias.zero_()
    write_perspective(tmp_path / "silent.npz", silent, seen_share=SHARE, notes="")
    found = estimate_focal(*somebody(), CAMERA, 20.0, weights=tmp_path / "silent.npz")
    assert found is not None and found.low < default_focal(CAMERA.size) < found.high
    assert found.high > 3 * found.low


def test_people_who_are_cut_off_tell_nothing(weights: Path):
    xy, confidence = somebody()
    confidence[:, [INDEX["left_ankle"], INDEX["right_ankle"]]] = 0.0
    assert estimate_focal(xy, confidence, CAMERA, 20.0, weights=weights) is None
    assert estimate_focal(xy, 0 * confidence, CAMERA, 20.0, weights=weights) is None


# --- the file ---


def test_other_files_are_refused(tmp_path: Path, weights: Path):
    arrays = read_npz(weights, most=2**26)
    path = tmp_path / "bad.npz"
    with pytest.raises(InputError, match="is not a perspective network"):
        read_perspective(path)
    for wrong, says in (
        ({"about": np.array(str(arrays["about"]).replace("perspective 1", "perspective 0"))}, "expected 'tcfit persp"),
        ({"attention.weight": np.zeros((2, 24), np.float16)}, "not those of its network"),
        ({"attention.bias": np.full(1, np.nan, np.float16)}, "not finite"),
    ):
        write_npz(path, arrays | wrong)
        with pytest.raises(InputError, match=says):
            read_perspective(path)
        read_perspective.cache_clear()


# --- what the shipped network has learned ---


def test_a_near_camera_is_told_from_a_far_one(monkeypatch: pytest.MonkeyPatch):
    """The same motion before a wide lens from near and a long one from afar, equally large in the picture."""
    monkeypatch.setattr(clips, "in_view", lambda body, params, camera: np.ones((len(params), 137), bool))
    sequence = motion_sequences()["13_15_1"]
    found: list[FocalEstimate] = []
    for lens in (26.0, 135.0):
        made = make_motion(replace(sequence, shot=replace(sequence.shot, lens=lens)), cached=False)
        keypoints = made.clip.keypoints
        estimate = focal_length.estimate_focal(keypoints.xy, keypoints.confidence, made.clip.camera, 30.0)
        assert estimate is not None
        found.append(estimate)
    assert found[1].focal > 1.5 * found[0].focal
