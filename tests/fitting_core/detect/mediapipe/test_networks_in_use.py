"""The whole detector on a rendered person: the networks find people of the demo clip as they find real ones."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.clips.demo import demo_clip
from fitting_core.clips.reading import read_clip
from fitting_core.detect.detecting import Detected, Detection, FramesDetected
from fitting_core.detect.detectors import find_detector
from fitting_core.detect.found import found_detections, silhouettes_of
from fitting_core.detect.mediapipe import networks
from fitting_core.detect.second_look import look_again
from fitting_core.detect.stored import StoredDetection
from fitting_core.keypoints import BODY, FACE, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints
from fitting_core.video.frames import FrameSource

pytestmark = [
    pytest.mark.xdist_group("networks in use"),
    pytest.mark.skipif(bool(networks.missing()), reason="the embedded detector's networks are not here: make install"),
]


EVERY = 24
"""Of the demo clip's frames one in so many is looked at."""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrameSource]:
    folder = tmp_path_factory.mktemp("demo")
    with FrameSource(demo_clip().video) as whole:
        for t in range(0, len(whole), EVERY):
            cv2.imwrite(str(folder / f"{t:03}.png"), whole.frame(t)[..., ::-1])
    with FrameSource(folder) as frames:
        yield frames


@pytest.fixture(scope="module")
def drawn() -> Keypoints:
    """What the demo's keypoint files say, with a simulated detector's faults."""
    points = read_clip(demo_clip().video, demo_clip().keypoints).keypoints
    return Keypoints(xy=points.xy[::EVERY], confidence=points.confidence[::EVERY])


@pytest.fixture(scope="module")
def found(source: FrameSource, tmp_path_factory: pytest.TempPathFactory) -> Detected:
    return run(source, tmp_path_factory.mktemp("kept"))


def detection(source: FrameSource, length: int = 60) -> Detection:
    detector = find_detector("mediapipe-fast")
    detector.part_length = lambda size: length  # pyright: ignore[reportAttributeAccessIssue]
    return Detection(source=source, frames=range(len(source)), detector=detector)


def run(source: FrameSource, folder: Path, length: int = 60) -> Detected:
    made = detection(source, length)
    *_, last = made.events(StoredDetection(made.settings(), folder))
    assert isinstance(last, Detected)
    return last


def test_the_rendered_person_is_found_with_hands_and_face(found: Detected, drawn: Keypoints):
    """Within what a person's joints and a detector's points differ by: the person is 500 pixels high."""
    assert [len(people) for people in found.people] == [1] * len(drawn)
    points = np.concatenate(found.people)
    apart = np.linalg.norm(points[..., :2] - drawn.xy, axis=-1)
    both = (points[..., 2] > 0.3) & (drawn.confidence > 0.3)
    for part, most in ((BODY, 12), (LEFT_HAND, 7), (RIGHT_HAND, 7), (FACE, 4)):
        assert both[:, part].mean() > 0.6
        # Of each frame: these are a second apart, so nothing is where it was in the frame before.
        assert max(np.median(off[part][sure[part]]) for off, sure in zip(apart, both, strict=True)) < most
    wrists = [INDEX["left_wrist"], INDEX["right_wrist"]]
    assert np.median(apart[:, wrists][both[:, wrists]]) < 12


def test_the_silhouette_covers_the_person(found: Detected, source: FrameSource):
    masks = silhouettes_of(found, [0] * len(found.people))
    assert masks is not None and masks.size == (192, 256)
    mask, image = masks.mask(0), source.frame(0)
    assert mask is not None
    xy = found.people[0][0, BODY]
    inside = (xy[xy[:, 2] > 0.5, :2] * np.array(masks.size) / source.size).astype(int)
    assert mask[inside[:, 1], inside[:, 0]].mean() > 0.9
    assert 0.05 < mask.mean() < 0.3 and image.shape[:2] == (720, 540)


@pytest.mark.thorough
@pytest.mark.parametrize("after", [1, 2])
def test_a_detection_that_was_ended_comes_out_as_if_it_had_not(source: FrameSource, tmp_path: Path, after: int):
    whole = run(source, tmp_path / "whole", length=3)
    made = detection(source, 3)
    store = StoredDetection(made.settings(), tmp_path / "ended")
    events, parts = made.events(store), 0
    while parts < after:
        parts += isinstance(next(events), FramesDetected)
    events.close()
    again = run(source, tmp_path / "ended", length=3)
    assert all(np.array_equal(a, b) for a, b in zip(whole.people, again.people, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(whole.silhouettes, again.silhouettes, strict=True))


def test_a_second_look_finds_the_hand_in_a_rectangle(source: FrameSource, found: Detected):
    near = np.concatenate(found.people)
    frame = int(near[:, LEFT_HAND, 2].min(1).argmax())
    hand = near[frame, LEFT_HAND, :2]
    low, high = hand.min(0) - 15, hand.max(0) + 15
    again = look_again(source, [frame], part="left_hand", region=(*low.tolist(), *high.tolist()))[0]
    assert (again[LEFT_HAND, 2] > 0.3).all() and not np.delete(again[:, 2], np.r_[LEFT_HAND]).any()
    assert np.median(np.linalg.norm(again[LEFT_HAND, :2] - hand, axis=1)) < 6
    told: list[int] = []
    without = look_again(source, [frame], part="left_hand", near=near[[frame]], tell=told.append)
    assert (without[:, LEFT_HAND, 2] > 0.1).all() and told == [1]


NOISE = np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8)


@pytest.mark.parametrize("images", [[np.zeros_like(NOISE), NOISE], [NOISE[:3, :5]]], ids=["black and noise", "tiny"])
def test_nobody_is_found_where_nobody_is(images: list[np.ndarray], tmp_path: Path):
    (tmp_path / "images").mkdir()
    for t, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "images" / f"{t}.png"), image)
    with FrameSource(tmp_path / "images") as frames:
        found = run(frames, tmp_path / "kept")
    assert [len(people) for people in found.people] == [0] * len(images)


@pytest.mark.thorough
def test_somebody_far_away_is_found(source: FrameSource, tmp_path: Path):
    """A tenth of the image high."""
    (tmp_path / "far").mkdir()
    small = cv2.resize(source.frame(0), None, fx=0.14, fy=0.14, interpolation=cv2.INTER_AREA)
    wide = np.full((720, 1280, 3), source.frame(0)[5, 5], np.uint8)
    wide[300 : 300 + len(small), 800 : 800 + small.shape[1]] = small
    for t in range(6):
        cv2.imwrite(str(tmp_path / "far" / f"{t}.png"), wide[..., ::-1])
    with FrameSource(tmp_path / "far") as frames:
        found = run(frames, tmp_path / "kept")
    assert [len(people) for people in found.people] == [1] * 6
    assert (np.abs(found.people[0][0, INDEX["neck"], :2] - [838, 330]) < 25).all()


@pytest.mark.thorough
def test_two_people_beside_each_other_are_two(source: FrameSource, tmp_path: Path):
    """The person twice in one picture, once mirrored as in a mirror: both are found, and stay who they are."""
    (tmp_path / "two").mkdir()
    for t in range(len(source)):
        image = source.frame(t)
        cv2.imwrite(str(tmp_path / "two" / f"{t:02}.png"), np.hstack([image, image[:, ::-1]])[..., ::-1])
    with FrameSource(tmp_path / "two") as frames:
        found = run(frames, tmp_path / "kept")
        detections = found_detections(found, frames.path)
    assert [len(people) for people in found.people] == [2] * len(source) == [2] * len(detections)
    for person in (0, 1):
        middles = np.array([people[person, INDEX["neck"], 0] for people in found.people])
        assert len({middle < source.size[0] for middle in middles}) == 1
