"""A clip of several people: one clip for each, of one camera."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core import read_people
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.people import people_of
from tests.fitting_core.io.cameras.camera_files import moving_npz

Figure = Callable[..., np.ndarray]
SIZE = (1280, 720)
FRAMES = 40


@pytest.fixture
def keypoints(figure: Figure, write_people: Callable[..., Path]) -> Path:
    """Files 3 to 42: somebody small walks from the right, listed first; from the tenth on a larger one stands left."""
    frames = {}
    for t in range(FRAMES):
        people = [figure(1000 - 3 * t, 300, height=150)]
        if t >= 10 and t != 20:
            people.append(figure(300, 300, height=300))
        frames[f"walk_{t + 3:04d}"] = people
    return write_people(frames, "walk")


def test_each_has_the_frames_from_first_to_last(keypoints: Path):
    one, other = read_people(
        None, keypoints, clip=ClipOptions(image_size=SIZE, frame_rate=25), camera=CameraOptions(focal_length=900)
    )
    assert (one.about.name, one.about.folder, one.about.frames) == ("person 1", "person-1", (3, 42))
    assert (other.about.name, other.about.folder, other.about.frames) == ("person 2", "person-2", (13, 42))
    assert other.clip.first_frame == 13 and len(other.clip) == 30 and other.clip.name == "walk person 2"
    assert (one.clip.keypoints.xy[:, 0, 0] == 1000 - 3 * np.arange(FRAMES)).all()
    assert (other.clip.keypoints.confidence.max(1) > 0).tolist() == [t != 10 for t in range(30)]
    assert "Person 2 of 2, in frames 13 to 42, not found in frames 23." in other.clip.notes
    assert people_of([one, other]).name == "walk" and people_of([one, other]).people == (one.about, other.about)


def test_the_estimated_camera_is_one_for_all(keypoints: Path, monkeypatch: pytest.MonkeyPatch):
    """And comes from whoever is largest and surest."""
    asked = []

    def noted(camera, points, *_, estimate):
        asked.append(points)
        return camera

    monkeypatch.setattr("fitting_core.ground.from_pictures.camera_from_pictures", noted)
    one, other = read_people(
        None, keypoints, clip=ClipOptions(image_size=SIZE, frame_rate=25), camera=CameraOptions(focal_length="auto")
    )
    assert one.clip.camera == other.clip.camera and len(asked) == 1
    assert asked[0].xy[15, 0, 0] == 300


def test_a_camera_that_moves_is_cut_as_the_person_is(keypoints: Path, tmp_path: Path):
    turns = np.stack([np.eye(3)] * FRAMES)
    way = np.stack([np.linspace(0, 1, FRAMES), np.zeros(FRAMES), np.zeros(FRAMES)], 1)
    matrix = np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]])
    file = moving_npz(tmp_path / "c.npz", turns, way, K=matrix, size=np.array(SIZE))
    one, other = read_people(
        None, keypoints, clip=ClipOptions(image_size=SIZE, frame_rate=25), camera=CameraOptions(camera=file)
    )
    assert one.clip.camera.path is not None and other.clip.camera.path is not None
    assert len(other.clip.camera.path) == 30
    assert np.allclose(other.clip.camera.path.places, one.clip.camera.path.places[10:])


def test_who_may_have_been_exchanged_is_noted(figure: Figure, write_people: Callable[..., Path]):
    frames = {}
    for t in range(60):
        both = [figure(100 + 12 * t, 300), figure(820 - 12 * t, 300)]
        frames[f"cross_{t:04d}"] = both[:1] if 24 <= t < 36 else both
    for one in read_people(
        None,
        write_people(frames, "cross"),
        clip=ClipOptions(image_size=SIZE, frame_rate=25),
        camera=CameraOptions(focal_length=900),
    ):
        assert one.about.uncertain
        assert any("confused with another" in note for note in one.clip.notes)
        first, last = one.about.frames
        assert all(first <= start <= end <= last for start, end in one.about.uncertain)
