"""Which detections are taken at their word: parts that the image cuts off, and swapped sides."""

from dataclasses import dataclass, field, fields, replace

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.config.schema import PRESETS
from fitting_core.fit.observations import _OF_CLIP, Observations, cut_off, unswapped
from fitting_core.keypoints import Keypoints

SIZE = (640, 480)


@dataclass(frozen=True, kw_only=True, eq=False)
class MoreObservations(Observations):
    """With an array of later days, and a number of the whole clip that is as long as the clip."""

    weight: np.ndarray
    table: np.ndarray = field(metadata=_OF_CLIP)


def test_a_part_slices_every_field_by_itself():
    """Whatever is added, unless it is declared as the whole clip's."""
    clip = Observations.of(standing(), SIZE, PRESETS["tcfit"], dtype=torch.float64, device=torch.device("cpu"))
    more = MoreObservations(**vars(clip), weight=np.arange(20.0), table=np.arange(20))
    part = more[3:7]
    assert type(part) is MoreObservations and len(part) == 4 and part.keypoints.xy.shape[0] == 4
    for f in fields(more):
        whole, sliced = getattr(more, f.name), getattr(part, f.name)
        if f.name in ("shown", "table"):
            assert sliced is whole
        elif f.name != "keypoints":
            assert np.array_equal(np.asarray(sliced), np.asarray(whole)[3:7]), f.name


def test_a_field_of_another_length_is_no_field_of_frames():
    clip = Observations.of(standing(), SIZE, PRESETS["tcfit"], dtype=torch.float64, device=torch.device("cpu"))
    with pytest.raises(AssertionError, match="weight"):
        MoreObservations(**vars(clip), weight=np.arange(19.0), table=np.arange(20))


def test_frames_that_were_swapped_back_are_those_of_the_part():
    crossed = standing()
    for side, other in (("left", "right"), ("right", "left")):
        for part in ("elbow", "wrist"):
            crossed.xy[8:12, kp.INDEX[f"{side}_{part}"]] = standing().xy[8:12, kp.INDEX[f"{other}_{part}"]]
    clip = Observations.of(crossed, SIZE, PRESETS["tcfit"], dtype=torch.float64, device=torch.device("cpu"))
    assert {name: frames.tolist() for name, frames in clip.swaps.items()} == {"arms": [8, 9, 10, 11]}
    assert {name: frames.tolist() for name, frames in clip[10:20].swaps.items()} == {"arms": [0, 1]}
    assert not clip[12:20].swaps


def standing(frames: int = 20) -> Keypoints:
    """A person who waves: arms apart, every body keypoint well inside the image."""
    rng = np.random.default_rng(0)
    xy = np.full((frames, kp.COUNT, 2), 240.0)
    xy[:, kp.BODY] += rng.uniform(-100, 100, (25, 2))
    sway = 20 * np.sin(np.arange(frames) / 4)[:, None]
    for side, x in (("left", 420.0), ("right", 120.0)):
        for k, part in enumerate(("elbow", "wrist", "knee", "ankle")):
            xy[:, kp.INDEX[f"{side}_{part}"]] = (
                np.stack([np.full(frames, x), np.full(frames, 150.0 + 60 * k)], -1) + sway
            )
    confidence = np.zeros((frames, kp.COUNT))
    confidence[:, kp.BODY] = 0.8
    return Keypoints(xy=xy, confidence=confidence)


def changed(keypoints: Keypoints, name: str, *, xy=None, confidence=None) -> Keypoints:
    new_xy, new_confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    if xy is not None:
        new_xy[:, kp.INDEX[name]] = xy
    if confidence is not None:
        new_confidence[:, kp.INDEX[name]] = confidence
    return Keypoints(xy=new_xy, confidence=new_confidence)


def test_points_inside_the_image_are_taken_as_they_are():
    assert not cut_off(standing(), SIZE).any()


@pytest.mark.parametrize(
    ("at", "side"),
    [((300, 477), (0, 1)), ((638, 200), (1, 0)), ((2, 200), (-1, 0)), ((300, 1), (0, -1)), ((300, 470), (0, 0))],
)
def test_points_on_the_border_lie_there_or_beyond(at, side):
    found = cut_off(changed(standing(), "left_wrist", xy=at), SIZE)
    assert (found[:, kp.INDEX["left_wrist"]] == side).all()
    assert not np.delete(found, kp.INDEX["left_wrist"], axis=1).any()


def test_hips_without_knees_lie_there_or_lower():
    clip = changed(changed(standing(), "left_knee", confidence=0.0), "left_hip", confidence=0.3)
    found = cut_off(clip, SIZE)
    assert (found[:, kp.INDEX["left_hip"]] == (0, 1)).all()
    assert not found[:, kp.INDEX["right_hip"]].any()
    assert not found[:, kp.INDEX["mid_hip"]].any(), "the other leg is seen"
    none = changed(changed(clip, "right_knee", confidence=0.0), "right_hip", confidence=0.3)
    assert (cut_off(none, SIZE)[:, kp.INDEX["mid_hip"]] == (0, 1)).all()
    sure = changed(changed(standing(), "left_knee", confidence=0.0), "left_hip", confidence=0.6)
    assert not cut_off(sure, SIZE)[:, kp.INDEX["left_hip"]].any()


def swapped(keypoints: Keypoints, parts: tuple[str, ...], frames: list[int]) -> Keypoints:
    xy, confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    left, right = ([kp.INDEX[f"{side}_{part}"] for part in parts] for side in ("left", "right"))
    for values in (xy, confidence):
        values[np.ix_(frames, left + right)] = values[np.ix_(frames, right + left)]
    return Keypoints(xy=xy, confidence=confidence)


@pytest.mark.parametrize("frames", [[7, 8, 9, 10], [0, 1, 2], [17, 18, 19], [5, 6, 12, 13]])
@pytest.mark.parametrize(
    ("name", "parts"), [("arms", ("elbow", "wrist")), ("legs", ("knee", "ankle", "big_toe", "small_toe", "heel"))]
)
def test_swapped_limbs_are_swapped_back(name: str, parts: tuple[str, ...], frames: list[int]):
    true = standing()
    corrected, swaps = unswapped(swapped(true, parts, frames))
    assert list(swaps) == [name]
    assert swaps[name].tolist() == frames
    np.testing.assert_array_equal(corrected.xy, true.xy)
    np.testing.assert_array_equal(corrected.confidence, true.confidence)


def test_hands_go_with_their_arms():
    true = standing()
    true.confidence[:, kp.HANDS] = 0.7
    true.xy[:, kp.LEFT_HAND] += 50
    xy = true.xy.copy()
    xy[5:8, kp.LEFT_HAND], xy[5:8, kp.RIGHT_HAND] = true.xy[5:8, kp.RIGHT_HAND], true.xy[5:8, kp.LEFT_HAND]
    broken = swapped(Keypoints(xy=xy, confidence=true.confidence), ("elbow", "wrist"), [5, 6, 7])
    corrected, _ = unswapped(broken)
    np.testing.assert_array_equal(corrected.xy, true.xy)


def test_arms_that_really_cross_stay_as_they_are():
    true = standing(40)
    across = np.linspace(0, 1, 40)[:, None]
    for part in ("elbow", "wrist"):
        left, right = kp.INDEX[f"left_{part}"], kp.INDEX[f"right_{part}"]
        a, b = true.xy[:, left].copy(), true.xy[:, right].copy()
        true.xy[:, left], true.xy[:, right] = a + across * (b - a) + [0, 30], b + across * (a - b)
    assert unswapped(true)[1] == {}


@pytest.mark.parametrize("bad", [[8], [6, 7, 8, 9, 10]])
@pytest.mark.parametrize("part", ["elbow", "wrist"])
def test_a_keypoint_marked_bad_hides_no_swap(part: str, bad: list[int]):
    """One of the arms' keypoints missing in the middle of a swap: the others are still swapped back."""
    true, name = standing(), f"left_{part}"
    broken = swapped(true, ("elbow", "wrist"), [6, 7, 8, 9, 10])
    broken.confidence[bad, kp.INDEX[name]] = 0
    corrected, swaps = unswapped(broken)
    assert swaps["arms"].tolist() == [6, 7, 8, 9, 10]
    np.testing.assert_array_equal(corrected.xy, true.xy)
    assert np.flatnonzero(corrected.confidence[:, kp.INDEX[f"right_{part}"]] == 0).tolist() == bad


def test_frames_that_tell_nothing_go_with_their_neighbours():
    true = standing()
    broken = swapped(true, ("elbow", "wrist"), [6, 7, 8, 9, 10])
    for frame in (8, 14):
        broken.confidence[frame, [kp.INDEX["left_elbow"], kp.INDEX["left_wrist"]]] = 0
    corrected, swaps = unswapped(broken)
    assert swaps["arms"].tolist() == [6, 7, 8, 9, 10]
    np.testing.assert_array_equal(corrected.xy, true.xy)


def by_hand(keypoints: Keypoints, names: tuple[str, ...], frames: list[int]) -> Keypoints:
    placed = keypoints.placed.copy()
    placed[np.ix_(frames, [kp.INDEX[name] for name in names])] = True
    return replace(keypoints, by_hand=placed)


def test_a_keypoint_that_a_person_nudged_goes_with_its_limb():
    """Dragged by some pixels in a swapped frame: the keypoint is where it is, and its side is the body's."""
    true = standing()
    broken = swapped(true, ("elbow", "wrist"), [6, 7, 8])
    left, right = kp.INDEX["left_wrist"], kp.INDEX["right_wrist"]
    broken.xy[7, left] += 3
    corrected, swaps = unswapped(by_hand(broken, ("left_wrist",), [7]))
    assert swaps["arms"].tolist() == [6, 7, 8]
    np.testing.assert_array_equal(corrected.xy[7, right], true.xy[7, right] + 3)
    assert np.argwhere(corrected.placed).tolist() == [[7, right]]


def test_sides_that_a_person_swapped_stay():
    """A person insists on what looks like a swap."""
    insisted = by_hand(
        swapped(standing(), ("elbow", "wrist"), [6, 7, 8]),
        ("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
        [6, 7, 8],
    )
    assert unswapped(insisted)[1] == {}
    np.testing.assert_array_equal(unswapped(insisted)[0].xy, insisted.xy)


def test_what_a_person_placed_on_the_border_lies_there():
    clip = changed(standing(), "left_wrist", xy=(638, 200))
    assert cut_off(clip, SIZE).any() and not cut_off(by_hand(clip, ("left_wrist",), list(range(20))), SIZE).any()
