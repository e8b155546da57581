"""The lifter's way from keypoints to depths: rays, windows, its file. What it has learned is judged by benchmarks."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from build_assets.lifter.training import write_lifter
from fitting_core import keypoints as kp
from fitting_core.body.model import other_side
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.lifting.clip_lifting import LiftedClip, lift
from fitting_core.lifting.network import FRAMES, RATE, Lifter, LifterSize, read_lifter
from fitting_core.lifting.rays import N_FEATURES, POINTS, seen

CAMERA = Camera(focal=(900.0, 940.0), center=(410.0, 395.0), size=(800, 800))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("lifter") / "small.npz"
    write_lifter(path, Lifter(LifterSize(width=24, layers=2, heads=3)), error_factor=1.5, notes="random")
    return path


def detections(frames: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A walk of random points, all seen."""
    random = np.random.default_rng(seed)
    xy = 400 + 80 * random.standard_normal((1, POINTS, 2)) + np.cumsum(random.standard_normal((frames, POINTS, 2)), 0)
    return xy, np.full((frames, POINTS), 0.8)


def lifted(
    path: Path, xy: np.ndarray, confidence: np.ndarray, rate: float = RATE, camera: Camera = CAMERA
) -> LiftedClip:
    return lift(xy, confidence, camera, rate, calibrated=camera.calibrated, weights=path)


def test_a_turned_camera_sees_the_same_person():
    """Rays turned about the camera's centre give nearly the same features, but for where the virtual camera looks."""
    random = np.random.default_rng(1)
    points = np.array([0.3, -0.2, 4.0]) + random.normal(0, 0.4, (2, FRAMES, POINTS, 3))
    turned = points @ Rotation.from_euler("y", 12, degrees=True).as_matrix().T
    made = [
        seen(torch.as_tensor(p[..., :2] / p[..., 2:]), torch.ones(2, FRAMES, POINTS), torch.ones(2))
        for p in (points, turned)
    ]
    one, other = (m.features[..., : 2 * POINTS] for m in made)
    assert float((one - other).abs().max()) < 0.1 * float(one.abs().max())
    for m in made:
        torch.testing.assert_close(m.to_virtual @ m.to_virtual.mT, torch.eye(3).double().expand(2, 3, 3))
        assert bool((torch.linalg.det(m.to_virtual) > 0).all()) and float(m.to_virtual[:, 0, 1].abs().max()) < 1e-12


@pytest.mark.parametrize(("frames", "rate"), [(1, 25.0), (2, 60.0), (7, 12.5), (40, 20.0), (130, 60.0)])
def test_every_frame_of_a_clip_is_lifted(weights: Path, frames: int, rate: float):
    found = lifted(weights, *detections(frames), rate)
    assert found.points.shape == (frames, POINTS, 3) and found.up.shape == (frames, 3)
    assert np.isfinite(found.points).all() and (found.depth_deviation > 0).all()
    assert ((found.contact > 0) & (found.contact < 1)).all() and found.contact.shape == (frames, 2)


def test_an_edit_changes_what_is_near_and_nothing_else(weights: Path):
    xy, confidence = detections(400)
    before = lifted(weights, xy, confidence)
    xy = xy.copy()
    xy[200, 4] += 60.0
    after = lifted(weights, xy, confidence)
    changed = np.abs(after.points - before.points).max((1, 2)) > 0
    assert changed[200] and not changed[: 200 - 2 * FRAMES].any() and not changed[200 + 2 * FRAMES :].any()


def test_a_mirror_shows_the_same_person(weights: Path):
    xy, confidence = detections(50)
    sides = [kp.INDEX[other_side(name)] for name in kp.BODY_25]
    mirrored = xy[:, sides] * [-1, 1] + [2 * CAMERA.center[0], 0]
    straight, other = lifted(weights, xy, confidence), lifted(weights, mirrored, confidence[:, sides])
    np.testing.assert_allclose(other.points[:, sides] * [-1, 1, 1], straight.points, atol=1e-5)
    np.testing.assert_allclose(other.depth_deviation[:, sides], straight.depth_deviation, rtol=1e-4)
    np.testing.assert_allclose(other.contact[:, ::-1], straight.contact, atol=1e-5)
    np.testing.assert_allclose(other.up * [-1, 1, 1], straight.up, atol=1e-5)


def test_the_file_holds_the_network(weights: Path):
    network, factor = read_lifter(weights)
    torch.manual_seed(0)
    made = Lifter(LifterSize(width=24, layers=2, heads=3))
    features = torch.randn(1, FRAMES, N_FEATURES)
    with torch.no_grad():
        torch.testing.assert_close(network(features).points, made(features).points, atol=2e-3, rtol=0)
    assert factor == 1.5


@pytest.mark.parametrize("damage", ["about", "shape", "missing", "nan", "no file"])
def test_a_file_that_is_none_is_refused(weights: Path, tmp_path: Path, damage: str):
    arrays = read_npz(weights)
    if damage == "about":
        arrays["about"] = np.array(str(arrays["about"]).replace("tcfit lifter 1", "tcfit lifter 9"))
    elif damage == "shape":
        arrays["place"] = arrays["place"][:5]
    elif damage == "missing":
        del arrays["points.bias"]
    elif damage == "nan":
        arrays["points.bias"][0] = np.nan
    path = tmp_path / f"{damage}.npz"
    if damage != "no file":
        write_npz(path, arrays)
    with pytest.raises(InputError, match=rf"{damage}\.npz"):
        read_lifter(path)
