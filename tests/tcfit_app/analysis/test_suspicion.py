"""The review queue."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.fit.evidence.sides import PAIRED
from fitting_core.keypoints import Keypoints
from fitting_core.lifting.clip_lifting import LiftedClip
from fitting_core.metrics import error_figures
from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.curves import curve
from tcfit_app.analysis.findings import FINDINGS, Finding, scores
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.suspicion import Suspect, findings, review_queue, still_checked
from tcfit_app.project.edits.edit_log import LogAction, LogEntry, Redo, Undo, frames_changed
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.storage.marks import Mark, MarkState
from tests.samples.posed import displaced, fit_of, keypoints_of, still_fit, still_params, with_keypoints

WRIST = kp.INDEX["left_wrist"]


def with_confidence(fit: PosedFit, frames: slice, joints: slice | list[int], value: float) -> PosedFit:
    confidence = fit.clip.keypoints.confidence.copy()
    confidence[frames, joints] = value
    return with_keypoints(fit, confidence=confidence)


def queue_of(fit: PosedFit, *, kinds: list[str], **options: Any) -> tuple[Suspect, ...]:
    """The review queue of these kinds of findings alone."""
    chosen = {kind: FINDINGS[kind] for kind in kinds if kind in FINDINGS}
    with patch("tcfit_app.analysis.suspicion.FINDINGS", chosen):
        return review_queue(findings(fit), **options).left


def knowing(body: BodyModel, *, unsure: dict[str, float] | None = None) -> Callable[..., LiftedClip]:
    """A lifter that knows where the still person's keypoints are, to 5 cm or as far as is said."""
    fit = still_fit(body, 1)
    deviation = np.full((1, 25), 0.05)
    for name, metres in (unsure or {}).items():
        deviation[:, kp.INDEX[name]] = metres

    def lifted(keypoints: Keypoints, *_: object) -> LiftedClip:
        frames = (len(keypoints), 1)
        return LiftedClip(
            points=np.tile(fit.points[:, :25] - fit.root[:, None], (*frames, 1)),
            depth_deviation=np.tile(deviation, frames),
            up=np.tile((0.0, -1.0, 0.0), frames),
            contact=np.ones((len(keypoints), 2)),
        )

    return lifted


@pytest.fixture(autouse=True)
def lifter(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    """What a network says of a body that nobody has is chance."""
    monkeypatch.setattr("tcfit_app.analysis.findings.lifted_keypoints", knowing(tiny_body))


@pytest.fixture(scope="module")
def fine(tiny_body: BodyModel) -> PosedFit:
    """Forty frames with nothing to see."""
    return still_fit(tiny_body)


def test_a_keypoint_off_comes_first_with_its_name(fine: PosedFit):
    fit = displaced(displaced(fine, 17, "left_wrist", (32.0, 24.0)), 30, "right_knee", (25.0, 0.0))
    first, second = queue_of(fit, kinds=["reprojection"])
    assert (first.frame, first.frames, first.kind) == (17, range(17, 18), "reprojection")
    assert first.joints == (WRIST,) and first.score > second.score > 1
    subject, pixels = first.reason.removesuffix(" px from its keypoint").rsplit(" ", 1)
    assert subject == "left wrist is" and abs(int(pixels) - 40) <= 4  # the detector's noise is 1 px
    assert second.frame == 30 and second.reason.startswith("right knee")
    assert [s.frame for s in review_queue(findings(fit)).left] == [17, 30], (
        "with all kinds too each frame is there once"
    )


def test_two_keypoints_off_are_both_named(fine: PosedFit):
    fit = displaced(displaced(fine, 8, "left_wrist", (0.0, 40.0)), 8, "left_elbow", (0.0, 30.0))
    (entry,) = queue_of(fit, kinds=["reprojection"])
    assert entry.reason.startswith("left wrist and left elbow are up to 4")


def test_many_keypoints_of_a_hand_are_the_hand(fine: PosedFit):
    hand = list(range(kp.COUNT)[kp.RIGHT_HAND])
    (entry,) = queue_of(displaced(fine, 8, hand[3:12], (0.0, 30.0)), kinds=["reprojection"])
    assert entry.reason.startswith("right hand is up to 3") and set(entry.joints) == set(hand[3:12])


def test_consecutive_frames_are_one_entry_with_the_worst(fine: PosedFit):
    fit = fine
    for frame, pixels in ((20, 30.0), (21, 60.0), (22, 35.0), (24, 30.0), (29, 30.0)):
        fit = displaced(fit, frame, "left_wrist", (pixels, 0.0))
    fit = displaced(fit, 25, "right_ankle", (30.0, 0.0))
    found = sorted(queue_of(fit, kinds=["reprojection"]), key=lambda s: s.frames.start)
    assert [(s.frame, s.frames) for s in found] == [(21, range(20, 25)), (25, range(25, 26)), (29, range(29, 30))]


def test_what_is_off_in_every_frame_is_the_detectors_habit(fine: PosedFit):
    assert review_queue(findings(displaced(fine, slice(None), "left_ear", (20.0, 0.0)))).left == ()


def test_half_of_a_clip_can_be_far_off(fine: PosedFit):
    found = queue_of(displaced(fine, slice(0, 26), "left_wrist", (90.0, 0.0)), kinds=["reprojection"])
    assert [s.frames for s in found] == [range(0, 26)]


def test_keypoints_that_do_not_count_are_not_reported(fine: PosedFit):
    fit = with_confidence(displaced(fine, 17, "left_wrist", (40.0, 0.0)), slice(17, 18), [WRIST], 0.1)
    assert queue_of(fit, kinds=["reprojection", "detection"]) == ()


def test_a_detection_that_jumps_is_told_even_if_the_fit_follows(tiny_body: BodyModel):
    params = still_params(30)
    pose = params.body_pose.clone()
    pose[12, 3 * (JOINT["left_shoulder"] - 1) + 2] += 0.4
    fit = fit_of(tiny_body, replace(params, body_pose=pose))
    found = {kind: queue_of(fit, kinds=[kind]) for kind in FINDINGS}
    assert not found["reprojection"] and not found["swap"] and not found["confidence"]
    (jump,), (detection,) = found["jump"], found["detection"]
    assert jump.frame == detection.frame == 12 and jump.frames == range(11, 14)
    assert "left" in jump.reason and jump.reason.endswith("mm from the frames around it") and WRIST in jump.joints
    assert detection.reason.startswith("detected left") and "px from the frames around it" in detection.reason


def bent_towards_the_camera(fit: PosedFit, frames: slice) -> PosedFit:
    """The left arm swung, and the picture as it was."""
    pose = fit.params.body_pose.clone()
    pose[frames, 3 * (JOINT["left_shoulder"] - 1) + 1] -= 0.7
    return PosedFit.posed(fit.clip, replace(fit.params, body_pose=pose), fit.meshes)


def test_a_limb_that_is_not_where_the_lifter_expects_it(fine: PosedFit):
    fit = bent_towards_the_camera(fine, slice(10, 14))
    (entry,) = queue_of(fit, kinds=["depth"])
    off = 100 * (fine.points - fit.points)[12, WRIST, 2]
    assert entry.frames == range(10, 14) and entry.joints[0] == WRIST and entry.score >= 1
    where = "nearer" if off > 0 else "farther away"
    assert abs(off) > 25 and entry.reason == f"left wrist is {abs(off):.0f} cm {where} than its keypoints suggest"


def test_a_limb_whose_depth_nobody_knows(fine: PosedFit, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    unsure = knowing(tiny_body, unsure={"right_ankle": 0.35, "left_knee": 0.32, "left_elbow": 0.28})
    monkeypatch.setattr("tcfit_app.analysis.findings.lifted_keypoints", unsure)
    entry, other = queue_of(fine, kinds=["depth"])
    assert entry.reason == "depth of the right ankle is uncertain by 35 cm" and len(entry.frames) == len(fine)
    assert (entry.joints, other.joints) == ((kp.INDEX["right_ankle"],), (kp.INDEX["left_knee"],))
    lost = with_confidence(fine, slice(None), [kp.INDEX["right_ankle"], kp.INDEX["left_knee"]], 0.0)
    assert queue_of(lost, kinds=["depth"]) == (), "what is not detected is a guess, as everybody knows"
    depth = np.full(fine.clip.keypoints.confidence.shape, np.nan)
    depth[:, kp.INDEX["right_ankle"]] = 0.1
    told = replace(fine, clip=replace(fine.clip, keypoints=replace(fine.clip.keypoints, depth=depth)))
    (entry,) = queue_of(told, kinds=["depth"])
    assert entry.joints == (kp.INDEX["left_knee"],), "somebody has said the other one"


def test_a_body_that_jumps_as_a_whole(tiny_body: BodyModel):
    params = still_params(30)
    translation = params.camera_translation.clone()
    translation[12] += torch.tensor([0.0, 0.0, 0.2])
    fit = fit_of(tiny_body, replace(params, camera_translation=translation))
    (entry,) = queue_of(fit, kinds=["jump"])
    assert entry.frame == 12 and entry.reason == "whole body jumps up to 200 mm from the frames around it"


def test_the_same_acceleration_is_no_jump_at_a_higher_frame_rate_only(tiny_body: BodyModel):
    params = still_params(30)
    translation = params.camera_translation.clone()
    translation[12] += torch.tensor([0.0, 0.0, 0.015])  # 30 mm/frame^2
    fit = fit_of(tiny_body, replace(params, camera_translation=translation))
    assert queue_of(fit, kinds=["jump"]) == ()  # 19 m/s^2 at 25 frames per second
    faster = replace(fit, clip=replace(fit.clip, frame_rate=60.0))  # 108 m/s^2
    assert [s.frame for s in queue_of(faster, kinds=["jump"])] == [12]


def test_a_region_that_is_lost_for_some_frames(fine: PosedFit):
    fit = with_confidence(fine, slice(20, 23), kp.RIGHT_HAND, 0.12)
    fit = with_confidence(fit, slice(30, 32), kp.FACE, 0.0)
    found = queue_of(fit, kinds=["confidence"])
    assert [(s.frames, s.reason) for s in found] == [
        (range(30, 32), "face is not detected"),
        (range(20, 23), "right hand is detected with confidence 0.12, usually 0.83"),
    ]
    assert set(found[1].joints) <= set(range(kp.COUNT)[kp.RIGHT_HAND]) and found[1].joints


def test_a_wrist_that_is_lost_alone(fine: PosedFit):
    (entry,) = queue_of(with_confidence(fine, slice(20, 32), [WRIST], 0.0), kinds=["confidence"])
    assert (entry.frames, entry.reason, entry.joints) == (range(20, 32), "left wrist is not detected", (WRIST,))
    nose = with_confidence(fine, slice(20, 32), [kp.INDEX["nose"]], 0.0)
    assert queue_of(nose, kinds=["confidence"]) == (), "its neighbours hold it"


def shaken(fit: PosedFit, scale: float = 2.0) -> PosedFit:
    """Detections with new noise in each frame."""
    noise = np.random.default_rng(0).normal(0, scale, fit.clip.keypoints.xy.shape)
    return with_keypoints(fit, xy=fit.clip.keypoints.xy + noise)


def walking(fit: PosedFit) -> PosedFit:
    """The same, with detections that also move across the image."""
    ways = 6.0 * np.arange(len(fit))[:, None, None] * np.array([1.0, 0.0])
    moving = shaken(fit)
    return with_keypoints(moving, xy=moving.clip.keypoints.xy + ways)


def frozen(fit: PosedFit, frames: range, joints: list[int]) -> PosedFit:
    xy = fit.clip.keypoints.xy.copy()
    xy[np.ix_(frames, joints)] = xy[frames.start - 1, joints]
    return with_keypoints(fit, xy=xy)


def test_a_limb_that_stands_still_while_the_others_move(fine: PosedFit):
    arm = [kp.INDEX["left_elbow"], WRIST]
    (entry,) = queue_of(frozen(walking(fine), range(12, 21), arm), kinds=["frozen"])
    assert (entry.frames, set(entry.joints), entry.score) == (range(12, 21), set(arm), 2.0)
    assert (
        entry.reason == "keypoints of the left arm stand still for 10 frames while the body moves" and entry.frame > 15
    )


def test_an_arm_that_lies_beside_its_keypoints_for_a_while_is_one_entry(fine: PosedFit):
    """Each frame's error is below what is worth reviewing alone, and 110 points of hands and face outvote it."""
    xy = shaken(fine, 0.3).clip.keypoints.xy.copy()
    elbows = [kp.INDEX[f"{side}_elbow"] for side in ("left", "right")]
    xy[10:34, elbows] += np.array([1, 0]) * 22 * fine.clip.camera.focal[0] / fine.root[10:34, None, 2:] / 1e3
    seen = fine.clip.keypoints.confidence.copy()
    seen[:, [joint for joint in LIMB_OF if LIMB_OF[joint].endswith("leg")]] = 0  # as of a signer
    fit = with_keypoints(fine, xy=xy, confidence=seen)
    (entry,) = review_queue(findings(fit)).left
    assert (entry.kind, entry.about, set(entry.joints)) == ("steady", ("left arm", "right arm"), set(elbows))
    assert abs(entry.frames.start - 10) < 5 and abs(entry.frames.stop - 34) < 5
    pixels = 22 * fine.clip.camera.focal[0] / fine.root[20, 2] / 1e3
    said = re.fullmatch(r"both elbows stay about (\d+) px from their keypoints", entry.reason)
    assert said and abs(int(said[1]) - pixels) < 2
    off = error_figures(fit.errors)
    assert off["body_p95"] and off["median"]
    assert off["body_p95"] > 0.8 * pixels > 3 * off["median"], "the median alone hides it"
    shows = curve("reprojection", fit).values
    assert np.median(shows[14:30]) > 1.5 * np.median([*shows[:5], *shows[-5:]])


def test_noise_and_single_frames_lie_beside_nothing(fine: PosedFit):
    assert queue_of(shaken(fine, 4.0), kinds=["steady"]) == ()
    few = displaced(displaced(fine, 17, "left_wrist", (90.0, 0.0)), 18, "left_wrist", (90.0, 0.0))
    assert queue_of(few, kinds=["steady"]) == ()


def test_what_may_stand_still(fine: PosedFit):
    everybody = list(range(kp.COUNT))
    assert queue_of(fine, kinds=["frozen"]) == (), "nobody moves"
    assert queue_of(shaken(fine), kinds=["frozen"]) == ()
    assert queue_of(frozen(shaken(fine), range(12, 21), everybody), kinds=["frozen"]) == (), "a person at rest"
    head = [joint for joint in range(25) if LIMB_OF[joint] == "head"]
    assert queue_of(frozen(shaken(fine, 1.0), range(12, 21), head), kinds=["frozen"]) == (), "a person at rest"
    assert queue_of(frozen(walking(fine), range(12, 15), everybody[2:8]), kinds=["frozen"]) == (), "too short to tell"


def test_feet_that_stand_are_not_frozen(fine: PosedFit):
    foot = [kp.INDEX[f"left_{name}"] for name in ("ankle", "big_toe", "small_toe", "heel")]
    leg = [kp.INDEX["left_knee"], *foot]
    other = [kp.INDEX[f"right_{name}"] for name in ("knee", "ankle", "big_toe", "small_toe", "heel")]
    assert queue_of(frozen(shaken(fine), range(12, 21), foot), kinds=["frozen"]) == (), "the knee moves"
    assert queue_of(frozen(shaken(fine), range(12, 21), leg + other), kinds=["frozen"]) == (), "on both legs"
    (entry,) = queue_of(frozen(walking(fine), range(12, 21), leg), kinds=["frozen"])
    assert entry.about == ("left leg",)


def test_entries_about_different_limbs_are_apart_and_looked_at_apart(fine: PosedFit):
    fit = displaced(displaced(fine, 17, "left_wrist", (90.0, 0.0)), 17, "left_knee", (60.0, 0.0))
    wrist, knee = queue_of(fit, kinds=["reprojection"])
    assert (wrist.frame, wrist.about, knee.about) == (17, ("left arm",), ("left leg",)) and wrist.key != knee.key
    found = review_queue(findings(fit), limbs={"left leg": {16, 17, 18}})
    assert [entry.about for entry in found.left] == [("left arm",)] and found.looked_at == 1
    assert review_queue(findings(fit), checked={16, 17, 18}).left == ()


def test_what_is_off_for_a_while_is_one_entry_whatever_else_is_found_meanwhile(fine: PosedFit):
    wrists = (WRIST, kp.INDEX["right_wrist"])
    found = [
        ("steady", Finding(frame=f, score=1.0, reason="both wrists", joints=wrists, lasting=range(10, 21)))
        for f in range(10, 21)
    ]
    found += [
        ("reprojection", Finding(frame=14, score=5.0, reason="left wrist", joints=(WRIST,))),
        ("jump", Finding(frame=17, score=4.0, reason="everything", joints=())),
    ]
    for checked in ((), range(12, 18)):
        left = review_queue(found, checked=checked).left
        assert sum("both wrists" in " ".join((entry.reason, *entry.also)) for entry in left) <= 1
        assert {10, 20} <= {frame for entry in left for frame in entry.frames}
    assert len(review_queue(found).left) == 1


def test_what_is_about_many_limbs_is_about_the_whole_body(fine: PosedFit):
    four = [kp.INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("wrist", "knee")]
    fit = displaced(fine, 17, four, (80.0, 0.0))
    (entry,) = queue_of(fit, kinds=["reprojection"])
    assert entry.about == ("whole body",) and len(entry.joints) == 4


def test_several_parts_that_are_lost_at_once(fine: PosedFit):
    fit = with_confidence(fine, slice(20, 21), kp.HANDS, 0.0)
    fit = with_confidence(fit, slice(30, 31), slice(None), 0.0)
    found = {(s.frame, *s.about): s for s in queue_of(fit, kinds=["confidence"])}
    for side in ("left", "right"):
        hand = found[20, f"{side} arm"]
        assert hand.reason == f"{side} hand is not detected"
        assert {LIMB_OF[joint] for joint in hand.joints} == {f"{side} arm"}
    assert found[30, "whole body"].reason == "no person is detected" and len(found) == 3


def test_what_a_person_marked_as_bad_is_not_missed(fine: PosedFit):
    fit = with_confidence(fine, slice(20, 23), kp.RIGHT_HAND, 0.0)
    bad = np.zeros(fit.bad.shape, bool)
    bad[20:22, kp.RIGHT_HAND] = True
    assert [s.frames for s in queue_of(replace(fit, bad=bad), kinds=["confidence"])] == [range(22, 23)]


def test_a_region_that_is_rarely_seen_is_not_missed(fine: PosedFit):
    assert queue_of(with_confidence(fine, slice(0, 32), kp.HANDS, 0.0), kinds=["confidence"]) == ()


def swapped(places: np.ndarray, pair: str, frames: slice) -> np.ndarray:
    """Points with left and right of a pair exchanged in some frames."""
    left, right, others = PAIRED[pair]
    one, other = [*left, *others[0]], [*right, *others[1]]
    places = places.copy()
    places[frames, one + other] = places[frames, other + one]
    return places


@pytest.mark.parametrize("pair", PAIRED)
def test_swapped_sides_are_the_cause_that_is_told(fine: PosedFit, pair: str):
    left, right, others = PAIRED[pair]
    xy = swapped(fine.clip.keypoints.xy, pair, slice(18, 22))
    fit = displaced(with_keypoints(fine, xy=xy), 30, "nose", (20.0, 10.0))
    first, second = review_queue(findings(fit)).left
    assert first.frame == 30, "what the fit has put right is not as bad as what is off"
    assert second.reason == f"left and right {pair} were swapped; the fit has corrected it" and second.score == 1
    assert second.kind == "swap" and set(second.joints) == {*left, *right, *others[0], *others[1]}
    assert second.frames == range(18, 22) and second.also == ()


@pytest.mark.parametrize("pair", PAIRED)
def test_a_fit_that_followed_swapped_sides(fine: PosedFit, pair: str):
    fit = with_keypoints(fine, xy=swapped(fine.clip.keypoints.xy, pair, slice(18, 22)))
    with patch.object(PosedFit, "projected", swapped(fine.projected, pair, slice(18, 22))):
        (first,) = queue_of(fit, kinds=["swap", "reprojection"])
    assert (
        first.reason == f"left and right {pair} may be swapped" and first.score == 3 and first.frames == range(18, 22)
    )


def test_a_clip_that_is_swapped_throughout_is_seen_from_the_fit(fine: PosedFit):
    xy = swapped(fine.clip.keypoints.xy, "arms", slice(None))
    assert queue_of(with_keypoints(fine, xy=xy), kinds=["swap"])[0].frames == range(len(fine))


def test_a_frame_whose_fit_failed(fine: PosedFit):
    cost = np.full(len(fine), 100.0)
    cost[7] = np.inf
    (entry,) = review_queue(findings(replace(fine, frame_cost=cost))).left
    assert entry.frame == 7 and entry.reason == "the fit failed in this frame"


def test_frames_that_were_checked_are_left_out(fine: PosedFit):
    fit = fine
    for frame, pixels in ((20, 30.0), (21, 60.0), (22, 35.0)):
        fit = displaced(fit, frame, "left_wrist", (pixels, 0.0))
    (entry,) = queue_of(fit, kinds=["reprojection"], checked={21})
    assert entry.frame == 22 and entry.frames == range(20, 23)
    assert queue_of(fit, kinds=["reprojection"], checked={20, 21, 22}) == ()


def test_a_check_holds_until_the_frame_changes():
    time: Any = None  # says nothing: clocks are set back

    def entry(number: int, action: LogAction) -> LogEntry:
        return LogEntry(id=number, time=time, author="", action=action)

    def mark(state: MarkState) -> Mark:
        return Mark(state=state, time=time, author="", last_edit=2, last_moment=5)

    def checked(log: list[LogEntry], **given: Any) -> frozenset[int]:
        return still_checked(marks, frames_changed(log, {1: first, 2: second}.__getitem__), **given)

    marks = {frame: mark("checked") for frame in (1, 2, 3, 4)} | {6: mark("flag")}
    first, second = MarkBad(frames=(1,), joints=(0,)), MarkBad(frames=(2,), joints=(0,))
    log = [entry(1, first), entry(2, second)]
    assert checked(log) == {1, 2, 3, 4}
    log.append(entry(3, MarkBad(frames=(3, 6), joints=(0,))))
    assert checked(log) == {1, 2, 4}
    log += [entry(4, Undo(edit=2)), entry(5, Redo(edit=2))]
    assert checked(log[:4]) == checked(log) == {1, 4}
    assert checked(log, refitted=[(5, range(5)), (6, range(4, 9))]) == {1}


def test_scores_are_in_units_of_the_threshold():
    values = np.array([[1.0, np.nan], [2.0, np.nan], [3.0, np.nan], [2.0, np.nan], [12.0, np.nan]])
    found = scores(values, 5.0)
    sigma = 1.4826  # median 2, median distance from it 1
    np.testing.assert_allclose(found[:, 0], (values[:, 0] - 2) / (5 * sigma))
    assert (found[:, 1] == 0).all()
    np.testing.assert_allclose(scores(values, 10.0)[4, 0], 1)
    np.testing.assert_allclose(scores(np.full((5, 1), 100.0), 10.0), 7)  # at most three times the least is excused


@pytest.mark.parametrize("frames", [1, 2, 3, 40])
def test_a_fine_clip_has_an_empty_queue(tiny_body: BodyModel, frames: int):
    assert review_queue(findings(still_fit(tiny_body, frames))).left == ()


def test_without_any_keypoint(tiny_body: BodyModel):
    params = still_params(5)
    keypoints = keypoints_of(tiny_body, params)
    fit = fit_of(tiny_body, params, replace(keypoints, confidence=np.zeros_like(keypoints.confidence)))
    assert review_queue(findings(fit)).left == ()
