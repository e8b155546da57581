"""Live correction: a drag's window follows, and ends where a re-run of the same window ends."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.fit.fitting import fit_clip, rerun_events
from tcfit_app.fitting.live import Correction, LiveCorrection
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import finished

FRAMES, FRAME = 9, 4
WRIST, ELBOW = kp.INDEX["right_wrist"], kp.INDEX["right_elbow"]
CONFIG = replace(
    PRESETS["tcfit"],
    pose_prior="relaxed",
    yaws="side_view",
    relay_rounds=0,
    limb_flips=False,
    settings=SolverSettings(sequence_tolerance=1e-8),
)


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return shipped_body()


@pytest.fixture(scope="module")
def clip() -> Clip:
    return clip_of(motion(FRAMES), noise=1.0)


@pytest.fixture(scope="module")
def params(clip: Clip, body: BodyModel) -> BodyParams:
    return fit_clip(clip, body, CONFIG).last.params


def correction(clip: Clip, body: BodyModel, params: BodyParams, *keypoints: int, frame: int = FRAME, **other):
    return Correction(
        **{"config": CONFIG, "reach": 2} | other,
        clip=clip, body=body, params=params, frame=frame, keypoints=keypoints or (WRIST,),
    )  # fmt: skip


def where(clip: Clip, *keypoints: int, by: tuple[float, float], frame: int = FRAME) -> np.ndarray:
    return clip.keypoints.xy[frame, list(keypoints or (WRIST,))] + np.array(by)


def settle(live: LiveCorrection, most: int = 60) -> None:
    for _ in range(most):
        live.resolve()
        if live.settled:
            return
    pytest.fail("a resting pointer's window does not settle")


def joints(body: BodyModel, params: BodyParams) -> Tensor:
    return 1e3 * Mesh(body, dtype=torch.float64).joints(params)


def apart(body: BodyModel, a: BodyParams, b: BodyParams) -> float:
    """Millimetres between two results, the joint and frame that differ most."""
    return float((joints(body, a) - joints(body, b)).norm(dim=-1).max())


def test_the_result_at_release_is_that_of_a_rerun(clip: Clip, body: BodyModel, params: BodyParams):
    """Whatever way the pointer took, and from whatever state it was released."""
    c = correction(clip, body, params)
    live = LiveCorrection(c, where(clip, by=(0, 0)))
    for step in range(1, 11):
        live.move(where(clip, by=(2.0 * step, 9.0 * np.sin(step))))
        live.resolve()
    released = finished(live.release()).params
    plain = finished(rerun_events(c.edited(live.target), body, c.converging, params, c.frames)).params
    assert apart(body, plain, params) > 10
    assert apart(body, released, plain) < 0.5
    settle(live)
    assert apart(body, live.params, plain) < 3


def test_the_window_follows_and_its_surroundings_stay(clip: Clip, body: BodyModel, params: BodyParams):
    c = correction(clip, body, params)
    target = where(clip, by=(25, -15))
    live = LiveCorrection(c, target)
    before = joints(body, params)
    settle(live)
    moved = (joints(body, live.params) - before).norm(dim=-1).amax(1)
    assert moved[FRAME] > 10 and moved[FRAME] >= moved.max()
    assert moved[FRAME - 1] > 0.1 < moved[FRAME + 1]
    outside = [i for i in range(FRAMES) if i not in c.frames]
    assert outside and not moved[outside].any()
    assert len(live.window) == len(c.frames) == 5


@settings(max_examples=8)
@given(
    frame=st.integers(0, FRAMES - 1),
    reach=st.integers(0, 5),
    keypoints=st.lists(st.sampled_from([WRIST, ELBOW, kp.INDEX["neck"]]), min_size=1, unique=True),
    by=st.tuples(*[st.floats(-2000, 2000)] * 2),
)
def test_no_drag_breaks_the_window(clip: Clip, body: BodyModel, params: BodyParams, frame, reach, keypoints, by):
    """Anywhere in the clip, out of the image too, one or several keypoints: finite, and never worse than before."""
    c = correction(clip, body, params, *keypoints, frame=frame, reach=reach)
    live = LiveCorrection(c, where(clip, *keypoints, by=by, frame=frame))
    for _ in range(3):
        live.resolve()
    whole = live.params
    assert all(bool(values.isfinite().all()) for values in vars(whole).values())
    outside = [i for i in range(FRAMES) if i not in c.frames]
    assert torch.equal(whole.body_pose[outside], params.body_pose[outside].double())


@pytest.mark.parametrize("preset", ["paper", "smplifyx"])
def test_every_preset_can_be_corrected(clip: Clip, body: BodyModel, params: BodyParams, preset: str):
    """Collisions wait for the release; windows and stages are the last stage of one window."""
    config = replace(PRESETS[preset], pose_prior="relaxed")
    c = correction(clip, body, params, config=config)
    assert c.following.weights.collision == (0.0,) * 5 and c.converging.weights == config.weights
    live = LiveCorrection(c, where(clip, by=(20, 0)))
    live.resolve()
    assert 5 < apart(body, live.params, params) < 1000


def test_an_undetected_keypoint_can_be_placed(clip: Clip, body: BodyModel, params: BodyParams):
    """A keypoint that no frame shows has no column in the data term before somebody places it."""
    gone = clip.keypoints.confidence.copy()
    gone[:, WRIST] = 0
    blind = replace(clip, keypoints=replace(clip.keypoints, confidence=gone))
    c = correction(blind, body, params)
    assert c.edited(where(clip, by=(0, 0))).keypoints.confidence[FRAME, WRIST] == 1
    ends = []
    for by in ((30, 0), (-30, 0)):
        live = LiveCorrection(c, where(clip, by=by))
        settle(live)
        ends.append(live.params)
    assert apart(body, *ends) > 20


@pytest.fixture(scope="module")
def swapped(clip: Clip) -> Clip:
    """Left and right arm are exchanged in the dragged frame."""
    xy = clip.keypoints.xy.copy()
    pairs = [[kp.INDEX[f"{side}_{n}"] for n in ("elbow", "wrist")] for side in ("left", "right")]
    xy[FRAME, pairs[0] + pairs[1]] = xy[FRAME, pairs[1] + pairs[0]]
    return replace(clip, keypoints=replace(clip.keypoints, xy=xy))


def test_swapped_sides_are_followed_where_the_fit_sees_them(
    clip: Clip, swapped: Clip, body: BodyModel, params: BodyParams
):
    """The fit swaps them back, and the drag with them."""
    left = kp.INDEX["left_wrist"]  # holds the right wrist's position
    plain = LiveCorrection(correction(clip, body, params), where(clip, by=(0, 0)))
    other = LiveCorrection(correction(swapped, body, params, left), where(swapped, left, by=(0, 0)))
    for live in (plain, other):
        live.move(where(clip, by=(12, 6)))
        settle(live)
    assert apart(body, plain.params, params) > 3
    assert apart(body, plain.params, other.params) < 0.1


def depth(body: BodyModel, params: BodyParams, *keypoints: int, frame: int = FRAME) -> np.ndarray:
    """Behind the pelvis, metres."""
    points = keypoints_in_space(body, params)[0][frame, list(keypoints or (WRIST,)), 2]
    return points - joints_in_space(body, params)[frame, 0, 2]


@pytest.mark.parametrize("preset", ["tcfit", pytest.param("paper", marks=pytest.mark.thorough)])
def test_a_drag_in_depth_is_followed_and_ends_as_a_rerun(clip: Clip, body: BodyModel, params: BodyParams, preset: str):
    config = CONFIG if preset == "tcfit" else replace(PRESETS[preset], pose_prior="relaxed", settings=CONFIG.settings)
    c = correction(clip, body, params, WRIST, ELBOW, config=config, in_depth=True)
    start = depth(body, params, WRIST, ELBOW)
    live = LiveCorrection(c, start)
    for share in np.linspace(0, 1, 8):
        live.move(start + share * np.array([0.2, 0.1]))
        live.resolve()
    settle(live)
    assert abs(depth(body, live.params, WRIST, ELBOW) - start - [0.2, 0.1]).max() < 0.04
    released = finished(live.release()).params
    said = c.edited(live.target).keypoints
    assert np.array_equal(said.xy, clip.keypoints.xy) and said.by_hand is None, "its place in the image stays"
    plain = finished(rerun_events(c.edited(live.target), body, c.converging, params, c.frames)).params
    assert apart(body, released, plain) < 0.5 and apart(body, live.params, plain) < 3


def test_a_drag_in_depth_of_a_keypoint_that_the_fit_leaves_out_moves_nothing(
    clip: Clip, body: BodyModel, params: BodyParams
):
    neck = kp.INDEX["neck"]
    assert CONFIG.neck_weight == 0
    start = depth(body, params, neck, WRIST)
    alone = LiveCorrection(correction(clip, body, params, neck, in_depth=True), start[:1] + 0.2)
    settle(alone)
    assert abs(depth(body, alone.params, neck) - start[0]).max() < 0.02
    both = LiveCorrection(correction(clip, body, params, neck, WRIST, in_depth=True), start + 0.15)
    settle(both)
    assert depth(body, both.params) - start[1:] == pytest.approx(0.15, abs=0.04)


def test_a_drag_in_depth_finds_swapped_sides(swapped: Clip, body: BodyModel, params: BodyParams):
    start = depth(body, params)
    live = LiveCorrection(correction(swapped, body, params, kp.INDEX["left_wrist"], in_depth=True), start)
    live.move(start + 0.15)
    settle(live)
    assert depth(body, live.params) - start == pytest.approx(0.15, abs=0.04)
