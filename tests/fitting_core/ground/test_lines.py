"""Focal length and vertical from straight edges: known cameras, drawn rooms, and pictures that tell nothing."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.camera import Camera, CameraPath, FocalFrom, Lens, World, focal_from_35mm
from fitting_core.ground.from_pictures import camera_from_pictures, straight_lines
from fitting_core.ground.gravity import Gravity, angles_to
from fitting_core.ground.lines import POSSIBLE_FOCALS, bend_of, edges_of, line_evidence, unbent
from fitting_core.keypoints import Keypoints
from fitting_core.lens import filmed
from fitting_core.video.frames import FrameSource
from fitting_core.video.sampled import SampledPictures
from tests.samples.walkers import CAMERA, RATE, walker

SIZE = CAMERA.size
CENTER = CAMERA.center
VIEWS = {
    "a phone's lens": (26.0, (0.0, 12.0, 30.0)),
    "rolled": (35.0, (20.0, 8.0, 50.0)),
    "a long lens that looks up": (60.0, (-3.0, -15.0, 20.0)),
}
"""35 mm equivalent; roll, tilt down and heading in degrees."""


def view(roll: float, tilt: float, heading: float) -> np.ndarray:
    """From a room, whose y axis points up, to camera axes."""
    turned = Rotation.from_euler("zxy", [roll, tilt, heading], degrees=True).as_matrix()
    return turned @ np.diag([1.0, -1.0, -1.0])


def edges_in(focal: float, turn: np.ndarray, rng: np.random.Generator, *, of_room: int) -> Float[np.ndarray, "n 4"]:
    """Edges along the room's axes, with half a pixel of noise, and 40 that run anywhere."""
    found = list[np.ndarray]()
    while len(found) < of_room:
        pixel = rng.uniform(0, SIZE)
        middle = np.array([*(pixel - CENTER) / focal, 1.0]) * rng.uniform(3, 8)
        ends = middle + np.outer([-0.5, 0.5], turn[:, len(found) % 3] * rng.uniform(0.6, 2.0))
        if (ends[:, 2] > 0.5).all():
            xy = ends[:, :2] / ends[:, 2:] * focal + CENTER
            if np.hypot(*(xy[1] - xy[0])) > 40:
                found.append(xy.ravel() + rng.normal(0, 0.5, 4))
    begin, angle, length = rng.uniform(0, SIZE, (40, 2)), rng.uniform(0, np.pi, 40), rng.uniform(40, 120, 40)
    anywhere = np.concatenate([begin, begin + length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)], 1)
    return np.concatenate([*([edge] for edge in found), anywhere])


@pytest.mark.parametrize("lens, angles", VIEWS.values(), ids=VIEWS)
def test_a_room_tells_lens_and_vertical(lens: float, angles: tuple[float, float, float]):
    rng, focal, turn = np.random.default_rng(3), focal_from_35mm(lens, SIZE), view(*angles)
    up = turn[:, 1]
    off = Rotation.from_rotvec(np.radians(5) * np.cross(up, [0.6, 0, 0.8])).apply(up)
    edges = edges_in(focal, turn, rng, of_room=90)
    found = line_evidence(edges, POSSIBLE_FOCALS * max(SIZE), CENTER, Gravity(up=off, deviation=5.0))
    assert found is not None
    best = int(np.argmax(found.log_likelihood))
    assert abs(np.log(found.focals[best] / focal)) < 0.08
    assert angles_to(found.ups[best], up) < 1.0 and found.deviations[best] < 1.5


def test_edges_that_run_anywhere_tell_little():
    edges = edges_in(900.0, np.eye(3), np.random.default_rng(1), of_room=0)
    found = line_evidence(
        edges, POSSIBLE_FOCALS * max(SIZE), CENTER, Gravity(up=np.array([0.0, -1.0, 0.0]), deviation=5.0)
    )
    assert found is None or np.ptp(found.log_likelihood) < 3 or found.deviations.min() > 2


def test_without_edges_nothing_is_told():
    up = Gravity(up=np.array([0.0, -1.0, 0.0]), deviation=5.0)
    assert line_evidence(np.zeros((0, 4)), POSSIBLE_FOCALS * max(SIZE), CENTER, up) is None


# --- from pictures ---


def walking() -> Keypoints:
    """The walker's BODY_25 points among all."""
    made = walker(24)
    xy, confidence = np.zeros((24, kp.COUNT, 2)), np.zeros((24, kp.COUNT))
    xy[:, :25], confidence[:, :25] = made.xy, made.confidence
    return Keypoints(xy=xy, confidence=confidence)


def film(folder: Path, *, moving: bool = False, k1: float = 0.0) -> Path:
    """Five pictures of a room, from the walker's camera; a moving one shows other parts of it in the last."""
    folder.mkdir()
    lens = Lens(focal=CAMERA.focal, center=CENTER, distortion=(k1, 0.0, 0.0, 0.0))
    turn = np.column_stack([[1.0, 0, 0], walker(2).up, np.cross([1.0, 0, 0], walker(2).up)])
    for number in range(5):
        heading = Rotation.from_euler("y", 30 + 20 * (number == 4) * moving, degrees=True).as_matrix()
        edges = edges_in(
            CAMERA.focal[0], turn @ heading, np.random.default_rng(5 + (number == 4) * moving), of_room=90
        )[:90]
        picture = np.full((SIZE[1], SIZE[0]), 90, np.uint8)
        for edge in edges:
            points = filmed(lens, np.linspace(edge[:2], edge[2:], 30))
            cv2.polylines(picture, [(points * 16).astype(np.int32)], False, 230, 5, cv2.LINE_AA, 4)
        cv2.imwrite(str(folder / f"{number}.png"), picture)
    return folder


UNKNOWN = replace(CAMERA, focal=(1469.0, 1469.0), focal_from=FocalFrom.DIAGONAL, source="unknown")


def read_camera(video: Path | None, camera: Camera = UNKNOWN, *, estimate: bool = True) -> Camera:
    pictures = video and SampledPictures(video, range(5), camera)
    return camera_from_pictures(camera, walking(), RATE, pictures, estimate=estimate)


def test_pictures_tell_lens_and_vertical(tmp_path: Path):
    found = read_camera(film(tmp_path / "room"))
    assert abs(np.log(found.focal[0] / CAMERA.focal[0])) < 0.1 and found.calibrated
    assert found.focal_from is FocalFrom.ESTIMATED and "from straight lines in the picture" in found.source
    assert found.vertical is not None and angles_to(np.array(found.vertical.up), walker(2).up) < 1.5


def test_pictures_taken_while_decoding_are_those_decoded_later(tmp_path: Path):
    video = film(tmp_path / "room")
    taken, later = (SampledPictures(video, range(5), CAMERA) for _ in range(2))
    with FrameSource(video, on_frame=taken.take) as source:
        assert sum(1 for _ in source) == 5
    found = later.stacked()
    shutil.rmtree(video)
    assert np.array_equal(taken.stacked(), found)


def test_a_known_focal_length_is_kept(tmp_path: Path):
    found = read_camera(film(tmp_path / "room"), CAMERA, estimate=False)
    assert found.vertical is not None and replace(found, vertical=None) == CAMERA
    assert angles_to(np.array(found.vertical.up), walker(2).up) < 1.5


def test_a_calibrated_pose_is_kept(tmp_path: Path):
    placed = replace(CAMERA, world=World(rotation=((1, 0, 0), (0, 0, -1), (0, 1, 0)), translation=(0, 0, 0), up="z"))
    assert read_camera(film(tmp_path / "room"), placed, estimate=False) == placed


@pytest.mark.parametrize("k1", [-0.25, -0.1])
def test_a_lens_that_bends_is_found_and_tells_as_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, k1: float):
    video = film(tmp_path / "room", k1=k1)
    picture = SampledPictures(video, range(5), UNKNOWN).stacked()[0]
    bend, deviation = bend_of(picture, edges_of(picture), CENTER)
    corner = np.hypot(*CENTER) / CAMERA.focal[0]
    assert abs(bend - k1 * corner**2) < 0.25 * abs(k1) * corner**2 and deviation < 0.2 * abs(bend)
    found = read_camera(video)
    off = abs(np.log(found.focal[0] / CAMERA.focal[0]))
    assert off < 0.06 and found.focal_deviation is not None and found.focal_deviation < 0.1
    assert found.vertical is not None and angles_to(np.array(found.vertical.up), walker(2).up) < 1.5
    monkeypatch.setattr("fitting_core.ground.from_pictures._BENT", 9.0)
    bent = read_camera(video)
    assert abs(np.log(bent.focal[0] / CAMERA.focal[0])) > off + 0.02


def test_a_straight_lens_bends_nothing(tmp_path: Path):
    picture = SampledPictures(film(tmp_path / "room"), range(5), UNKNOWN).stacked()[0]
    edges = edges_of(picture)
    bend, deviation = bend_of(picture, edges, CENTER)
    assert abs(bend) < 0.01 and deviation < 0.01
    assert bend_of(picture, edges[:0], CENTER) == (0.0, np.inf)
    np.testing.assert_array_equal(unbent(edges, 0.0, CENTER, SIZE), edges)


def test_round_things_in_one_half_of_the_picture_are_no_bent_lens(tmp_path: Path):
    bent, straight = (
        SampledPictures(film(tmp_path / f"{k1}", k1=k1), range(5), UNKNOWN).stacked()[0] for k1 in (-0.25, 0.0)
    )
    middle = int(CENTER[0])
    picture = np.hstack([bent[:, :middle], straight[:, middle:]])
    bend, deviation = bend_of(picture, edges_of(picture), CENTER)
    assert bend_of(bent, edges_of(bent), CENTER)[1] < 0.02 < abs(bend) / 3 < deviation


def test_pictures_of_a_camera_that_moves_tell_the_lens_but_no_vertical(tmp_path: Path):
    """Even if it stands for most of the clip."""
    found = read_camera(film(tmp_path / "turned", moving=True))
    assert abs(np.log(found.focal[0] / CAMERA.focal[0])) < 0.1 and "from straight lines" in found.source
    assert found.vertical is None and found.focal_deviation is not None and 0.1 <= found.focal_deviation < 0.2
    known = read_camera(tmp_path / "turned", CAMERA, estimate=False)
    assert known == CAMERA


@pytest.mark.parametrize("scene", ["path", "grey", "no video", "no pictures"])
def test_without_lines_a_usual_lens_is_assumed(tmp_path: Path, scene: str):
    video: Path | None = tmp_path / "film"
    camera = UNKNOWN
    if scene == "path":
        video, still = film(tmp_path / "film"), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        camera = replace(UNKNOWN, path=CameraPath(rotation=(still,) * 24, translation=((0.0, 0.0, 0.0),) * 24))
    elif scene == "grey":
        (tmp_path / "film").mkdir()
        for number in range(5):
            cv2.imwrite(str(tmp_path / f"film/{number}.png"), np.full((SIZE[1], SIZE[0]), 90, np.uint8))
    elif scene == "no video":
        video = None
    found = read_camera(video, camera)
    assert found.focal[0] == pytest.approx(focal_from_35mm(32, SIZE)) and found.vertical is None
    assert not found.calibrated and found.focal_from is FocalFrom.ESTIMATED
    assert "typical of phones and cameras, with 80 % confidence between 788 and 1496 px" in found.source


def test_lines_are_shown_as_they_count(tmp_path: Path):
    room, turned = film(tmp_path / "room"), film(tmp_path / "turned", moving=True)
    camera = read_camera(room)
    found, blind = straight_lines(camera, room, range(5)), straight_lines(UNKNOWN, room, range(5))
    assert len(found.edges) > 60 and found.along.mean() > 0.8
    assert len(blind.edges) == len(found.edges) and not blind.along.any(), "no vertical is known"
    assert not len(straight_lines(camera, turned, range(5)).edges)
