"""The networks on this computer: which are there, what is said of those that are not, and running them."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.detect.mediapipe import networks
from fitting_core.detect.mediapipe.networks import NEEDED, NETWORKS, OPTIONAL, Network
from fitting_core.detect.mediapipe.tflite_to_onnx import convert
from fitting_core.errors import InputError
from tests.fitting_core.detect.mediapipe.fake_packages import tiny_network

SIZES = {
    "pose_detection": 224,
    "pose_landmark_full": 256,
    "pose_landmark_heavy": 256,
    "palm_detection_full": 192,
    "hand_landmark_full": 224,
    "hand_recrop": 256,
    "face_detection_short_range": 128,
    "face_landmark": 192,
}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one tiny network, as the environment variable names it."""
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path))
    place = tmp_path / "mediapipe"
    place.mkdir()
    (tmp_path / "a.tflite").write_bytes(tiny_network(0))
    convert(tmp_path / "a.tflite", networks.onnx_path("hand_recrop", place))
    networks.write_list(place)
    return place


def test_which_are_installed(place: Path):
    assert networks.folder() == place
    assert networks.is_installed("hand_recrop") and networks.is_sound("hand_recrop")
    assert networks.missing() == tuple(name for name in NEEDED if name != "hand_recrop")
    assert OPTIONAL == ("pose_landmark_heavy",) and set(NEEDED) | set(OPTIONAL) == set(NETWORKS) == set(SIZES)


def test_a_network_runs_on_any_number_of_images(place: Path):
    network = Network("hand_recrop", outputs=["step 0"])
    images = np.random.default_rng(0).random((5, 4, 4, 3)).astype(np.float32)
    (all_at_once,) = network(images)
    assert network.size == 4 and all_at_once.shape == (5, 4, 4, 2)
    np.testing.assert_allclose(np.concatenate([network(image[None])[0] for image in images]), all_at_once, atol=1e-6)


def test_one_that_is_damaged(place: Path):
    path = networks.onnx_path("hand_recrop", place)
    path.write_bytes(path.read_bytes()[:-1])
    assert networks.is_installed("hand_recrop") and not networks.is_sound("hand_recrop")
    with pytest.raises(InputError, match=r"is damaged.*`tcfit models add mediapipe` replaces it"):
        Network("hand_recrop")
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match=r"is not in|cannot be read"):
        Network("hand_recrop")


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"version": "x", "sha256": {}}', '{"version": 1, "sha256": 3}', "\0"]
)
def test_a_list_that_is_none(place: Path, content: str):
    (place / "networks.json").write_text(content)
    assert networks.missing() == NEEDED


@pytest.mark.parametrize("name", NETWORKS)
def test_the_real_networks(name: str):
    if not networks.is_installed(name):
        pytest.skip(f"{name} is not installed; `tcfit models add mediapipe` fetches it")
    network = Network(name)
    images = np.random.default_rng(0).random((2, SIZES[name], SIZES[name], 3)).astype(np.float32)
    together, alone = network(images), network(images[1:])
    assert network.size == SIZES[name] and networks.is_sound(name)
    for both, one in zip(together, alone, strict=True):
        assert both.shape == (2, *one.shape[1:])
        np.testing.assert_allclose(both[1:], one, atol=2e-3 * np.abs(one).max() + 1e-6)
