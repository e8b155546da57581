"""Whole fits of short clips with known truth: what is recovered, what is kept, and what no input may break."""

import threading
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, ShapeSample, SolverSettings, Temporal, Weights
from fitting_core.errors import InputError
from fitting_core.fit.events import Finished, FitEvent, FramesFitted, Iteration, PhaseFinished, PhaseStarted
from fitting_core.fit.evidence.observations import Stances
from fitting_core.fit.evidence.sides import PAIRED
from fitting_core.fit.fitting import _on_one_thread, fit_clip, fit_events, rerun_events
from fitting_core.fit.grounded import holding_feet
from fitting_core.fit.phase_figures import evaluate_objective, patched
from fitting_core.fit.phases import consistency
from fitting_core.fit.stages import Stages
from fitting_core.keypoints import Keypoints
from fitting_core.results.fit_result import FitResult
from fitting_core.results.provenance import Start, Stopped
from tests.samples.scenes import arms_in_motion, clip_of, finished, hidden, keypoints_of, noisy
from tests.samples.told_twist import with_told_twist

NO_COLLISION = replace(Weights(), collision=(0.0,) * 5)
QUICK = FitConfig(
    weights=NO_COLLISION,
    pose_prior="relaxed",
    hip_weight=1.0,
    shape_sample=ShapeSample(size=4, stages=(5,)),
    temporal=Temporal(mode="global", stages=(5,)),
    settings=SolverSettings(iterations=15),
)
"""All phases with few steps each."""
WEAK = 0.05
EXACT = replace(
    QUICK,
    # Priors pull even exact keypoints off the truth by 5 to 12 mm; that weak they only settle what nothing shows.
    weights=replace(
        NO_COLLISION,
        body_pose=(404, 404, 57.4, 4.78, WEAK),
        hand_pose=(404, 404, 57.4, 4.78, WEAK),
        shape=(100, 50, 10, 5, WEAK),
        expression=(100, 50, 10, 5, WEAK),
        jaw_open=(63.6, 63.6, 24, 6.9, WEAK),
        jaw_sideways=(201, 201, 75.7, 21.9, WEAK),
        bending=(35.8, 35.8, 13.5, 3.9, WEAK),
    ),
    neck_weight=1.0,
    yaws="four",
    relay_rounds=2,
    temporal=Temporal(mode="global", stages=(5,), weight=1.0),
    settings=SolverSettings(iterations=40, final_tolerance=1e-9, sequence_tolerance=1e-9),
)


def body_only(body: BodyModel, frames: int, *, noise: float = 2.0) -> Keypoints:
    return hidden(noisy(keypoints_of(body, arms_in_motion(frames)), noise), kp.HANDS, kp.FACE)


@pytest.fixture(scope="module")
def short_clip(free_body: BodyModel) -> Clip:
    return clip_of(body_only(free_body, 8))


@pytest.fixture(scope="module")
def events(free_body: BodyModel, short_clip: Clip) -> list[FitEvent]:
    return list(fit_events(short_clip, free_body, QUICK))


@pytest.fixture(scope="module")
def quick(events: list[FitEvent]) -> FitResult:
    last = events[-1]
    assert isinstance(last, Finished)
    return last.result


def vertex_errors(body: BodyModel, params: BodyParams, truth: BodyParams) -> Tensor:
    """Distance of every vertex from where it truly is in camera space, (T, V) millimetres."""
    mesh = Mesh(body, dtype=torch.float64)
    return 1e3 * (mesh(params) - mesh(truth)).norm(dim=2)


def same(a: BodyParams, b: BodyParams) -> bool:
    return all(torch.equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(BodyParams))


def all_finite(result: FitResult) -> bool:
    tensors = [getattr(p.params, f.name) for p in result.phases for f in fields(BodyParams)]
    return all(bool(t.isfinite().all()) for t in tensors)


def test_known_parameters_are_recovered_from_exact_keypoints(free_body: BodyModel):
    """Pose, hands, face, shape and depth: vertices under 5 mm, nothing aligned."""
    free_body = with_told_twist(free_body)
    truth = arms_in_motion(2)
    result = fit_clip(clip_of(keypoints_of(free_body, truth)), free_body, EXACT)
    assert float(vertex_errors(free_body, result.phases[0].params, truth).mean(1).max()) < 5
    final = result.last.params
    assert float(vertex_errors(free_body, final, truth).max()) < 5
    assert float((final.betas - truth.betas).abs().max()) < 0.05
    assert float((final.left_hand_pose - truth.left_hand_pose).abs().max()) < 0.05
    assert float((final.expression - truth.expression).abs().max()) < 0.05
    assert float((final.jaw_pose - truth.jaw_pose).abs().max()) < 0.02
    assert result.observed[:, JOINT["left_pinky3"]].all()


def test_sliding_window_gives_every_frame_once_and_smooths(free_body: BodyModel, short_clip: Clip, quick: FitResult):
    window = replace(QUICK.temporal, mode="sliding_window", window_size=4)
    events = list(fit_events(short_clip, free_body, replace(QUICK, temporal=window)))
    windows = [e for e in events if isinstance(e, FramesFitted) and e.phase == 3]
    assert [list(w.frames) for w in windows] == [[0], [1], [2], [3], [4, 5, 6, 7]]
    last = events[-1]
    assert isinstance(last, Finished)
    for w in windows:
        assert same(w.params, last.result.last.params[w.frames.start : w.frames.stop])
    mesh = Mesh(free_body, dtype=torch.float64)

    def acceleration(params: BodyParams) -> float:
        joints = mesh.joints(params) - params.camera_translation[:, None]
        return float((joints[2:] - 2 * joints[1:-1] + joints[:-2]).square().sum())

    before, after = acceleration(last.result.phases[1].params), acceleration(last.result.last.params)
    assert after < 0.5 * before
    assert acceleration(quick.last.params) < 0.5 * before


def test_events_come_in_order(events: list[FitEvent], quick: FitResult):
    frame = [e for e in events if not isinstance(e, Iteration)]
    expected = [PhaseStarted, FramesFitted, PhaseFinished] + [PhaseStarted, PhaseFinished] * 2 + [Finished]
    assert [type(e) for e in frame] == expected
    assert [e.phase for e in frame if isinstance(e, PhaseStarted | PhaseFinished)] == [1, 1, 2, 2, 3, 3]
    running = 0
    for event in events:
        running = event.phase if isinstance(event, PhaseStarted) else running
        if isinstance(event, Iteration):
            assert event.phase == running and 0 <= event.share <= 1 and np.isfinite(event.cost) and event.label
    for phase in (1, 2, 3):
        shares = [e.share for e in events if isinstance(e, Iteration) and e.phase == phase]
        assert len(shares) > 1 and all(a <= b for a, b in pairwise(shares))
    assert [p.phase for p in quick.phases] == [1, 2, 3]


def test_same_seed_same_result(free_body: BodyModel, short_clip: Clip, quick: FitResult):
    again = fit_clip(short_clip, free_body, QUICK)
    for a, b in zip(again.phases, quick.phases, strict=True):
        assert same(a.params, b.params) and a.objective == b.objective and np.array_equal(a.frame_cost, b.frame_cost)


def test_phase_2_gives_phase_1_one_shape_and_phase_3_keeps_it(quick: FitResult):
    first, second, third = (p.params for p in quick.phases)
    assert float((first.betas - first.betas[:1]).abs().max()) > 1e-3
    assert torch.equal(second.betas, second.betas[:1].expand(8, -1))
    assert torch.equal(third.betas, second.betas)
    assert torch.equal(first.body_pose, second.body_pose) and not torch.equal(second.body_pose, third.body_pose)


def test_every_phase_tells_where_its_frames_came_from(quick: FitResult):
    """The start is phase 1's; why a frame's solver stopped is the phase's own."""
    first, second, third = (p.provenance for p in quick.phases)
    assert first is not None and second is not None and third is not None
    assert set(first.start.tolist()) <= {Start.TURNED_0, Start.TURNED_180} and len(first) == 8
    assert set(first.stopped.tolist()) <= {Stopped.CONVERGED, Stopped.ITERATIONS}
    for later in (second, third):
        assert later.start.tolist() == first.start.tolist()
    assert second.stopped.tolist() == first.stopped.tolist()
    assert len(set(third.stopped.tolist())) == 1 and third.stopped[0] != Stopped.UNKNOWN


def test_frames_that_are_fitted_again_come_from_the_result_before(
    free_body: BodyModel, short_clip: Clip, quick: FitResult
):
    refit = finished(rerun_events(short_clip, free_body, QUICK, quick.last.params, range(2, 5)))
    again = patched(quick.last, Stages.of_clip(short_clip, free_body, QUICK), refit.params, [range(2, 5)],
                    provenance=refit.provenance, note="")  # fmt: skip
    assert again.provenance is not None and quick.last.provenance is not None
    before = quick.last.provenance.start.tolist()
    assert again.provenance.start.tolist() == [*before[:2], *[Start.AGAIN] * 3, *before[5:]]
    assert Stopped.UNKNOWN not in again.provenance.stopped


def test_cancelling_after_phase_1_keeps_it(free_body: BodyModel, short_clip: Clip, quick: FitResult):
    events = fit_events(short_clip, free_body, QUICK)
    kept = next(e for e in events if isinstance(e, PhaseFinished))
    next(events), next(events)  # into phase 2
    events.close()
    assert [p.phase for p in kept.so_far.phases] == [1]
    assert same(kept.result.params, quick.phases[0].params)
    with pytest.raises(StopIteration):
        next(events)


def test_gradients_are_as_the_caller_left_them(free_body: BodyModel, short_clip: Clip):
    """The generator changes no global state between its steps, and what leaves it hangs on no graph."""
    events = fit_events(short_clip, free_body, replace(QUICK, last_phase=1))
    for event in events:
        assert torch.is_grad_enabled()
        if isinstance(event, PhaseFinished):
            assert not any(getattr(event.result.params, f.name).requires_grad for f in fields(BodyParams))


def test_two_fits_that_overlap_give_the_threads_back():
    """Each in a thread of its own: the second begins while the first runs, and ends after it."""
    order = [threading.Barrier(2, timeout=30) for _ in range(3)]

    @_on_one_thread
    def first(*_: object) -> Generator[FitEvent, None, None]:
        order[0].wait()
        order[1].wait()
        yield from ()

    @_on_one_thread
    def second(*_: object) -> Generator[FitEvent, None, None]:
        order[1].wait()
        order[2].wait()
        yield from ()

    def threads_of_a_new_one() -> int:
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(torch.get_num_threads).result()

    def run(fit: Callable[..., Generator[FitEvent, None, None]]) -> None:
        list(fit(None, None, replace(QUICK, solver="lbfgs")))  # no kernels are compiled for this one

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with ThreadPoolExecutor(2) as pool:
            one = pool.submit(run, first)
            order[0].wait()
            other = pool.submit(run, second)
            one.result(timeout=30)
            order[2].wait()
            other.result(timeout=30)
        assert torch.get_num_threads() == threads_of_a_new_one() == 2
    finally:
        torch.set_num_threads(before)


def test_stops_after_the_chosen_phase(free_body: BodyModel, short_clip: Clip, quick: FitResult):
    result = fit_clip(short_clip, free_body, replace(QUICK, last_phase=2))
    assert [p.phase for p in result.phases] == [1, 2]
    assert same(result.last.params, quick.phases[1].params)
    assert result.phase(2) is result.last and result.phase(3) is None


def test_empty_frames_are_filled_and_reported(free_body: BodyModel, short_clip: Clip):
    gaps = hidden(short_clip.keypoints, slice(None), frames=slice(3, 5))
    gaps = hidden(gaps, slice(None), frames=slice(0, 1))
    result = fit_clip(clip_of(gaps), free_body, QUICK)
    assert any("filled from their neighbours: 0, 3-4" in note for note in result.phases[0].notes)
    assert set(result.phases[0].notes) <= set(result.warnings)
    assert not result.observed[[0, 3, 4]].any() and result.observed[1, JOINT["left_elbow"]]
    for phase in result.phases:
        translation, pose = phase.params.camera_translation, phase.params.body_pose
        assert bool(pose.isfinite().all())
        middle = translation[2] + (translation[5] - translation[2]) / 3
        assert float((translation[3] - middle).norm()) < 0.1
    first = result.phases[0].params
    assert torch.equal(first.body_pose[0], first.body_pose[1])
    came_from = result.phases[0].provenance
    assert came_from is not None and (came_from.start == Start.FILLED).nonzero()[0].tolist() == [0, 3, 4]
    assert (came_from.stopped == Stopped.EMPTY).nonzero()[0].tolist() == [0, 3, 4]
    torch.testing.assert_close(first.body_pose[3], (2 * first.body_pose[2] + first.body_pose[5]) / 3)


def test_notes_count_frames_as_the_video_does(free_body: BodyModel, short_clip: Clip):
    """A clip from frame 100 on, with nobody in its fourth frame, and left and right legs swapped in two later ones."""
    seen = hidden(short_clip.keypoints, slice(None), frames=slice(3, 4))
    xy, confidence = seen.xy.copy(), seen.confidence.copy()
    legs = [[kp.INDEX[f"{side}_{joint}"] for joint in ("knee", "ankle")] for side in ("left", "right")]
    for values in (xy, confidence):
        values[5:7, [*legs[0], *legs[1]]] = values[5:7, [*legs[1], *legs[0]]]
    clip = replace(clip_of(Keypoints(xy=xy, confidence=confidence)), first_frame=100)
    sample = ShapeSample(size=7, stages=(5,))
    result = fit_clip(clip, free_body, replace(QUICK, last_phase=2, unswap_sides=True, shape_sample=sample))
    ends = [note.rpartition("frames ")[2] for note in result.warnings]
    assert "105-106" in ends and "100, 101, 102, 104, 105, 106, 107" in ends
    assert any(note.endswith("filled from their neighbours: 103") for note in result.warnings)
    again = next(rerun_events(clip, free_body, QUICK, result.last.params, range(2, 4)))
    assert isinstance(again, PhaseStarted) and again.title == "frames 102 to 103 again"
    with pytest.raises(InputError, match=r"Frames 104 to 108 cannot .* the clip has frames 100 to 107\."):
        next(rerun_events(clip, free_body, QUICK, result.last.params, range(4, 9)))


def test_a_clip_without_a_person_is_refused(free_body: BodyModel):
    blank = Keypoints(xy=np.zeros((4, 137, 2)), confidence=np.zeros((4, 137)))
    with pytest.raises(InputError, match=r"No frame of test clip shows a person.*at least 4 body keypoints"):
        fit_clip(clip_of(blank), free_body, QUICK)
    three = np.zeros((4, 137))
    three[:, :3] = 1
    with pytest.raises(InputError):
        fit_clip(clip_of(replace(blank, confidence=three)), free_body, QUICK)


def test_half_body_stands_upright(free_body: BodyModel):
    """Hips and all below are out of the image: the torso stands within 10 degrees, legs are told not to be observed."""
    legs = [i for i, n in enumerate(kp.BODY_25) if any(w in n for w in ("hip", "knee", "ankle", "toe", "heel"))]
    detections = hidden(body_only(free_body, 5), *legs)
    config = replace(PRESETS["tcfit"], relay_rounds=1, settings=SolverSettings(iterations=25))
    result = fit_clip(clip_of(detections), free_body, config)
    orient = rotations.exp(result.last.params.global_orient)
    lean = torch.acos((-orient[:, 1, 1]).clamp(-1, 1)).rad2deg()  # of the body's y axis against the image's up
    assert float(lean.max()) < 10
    below = [JOINT[f"{side}_{part}"] for side in ("left", "right") for part in ("hip", "knee", "ankle", "foot")]
    assert not result.observed[:, below].any()
    assert result.observed[:, [JOINT["left_elbow"], JOINT["neck"]]].all()
    assert any("hips not seen" in note for note in result.warnings)


def disturbed(params: BodyParams, frames: slice) -> BodyParams:
    pose = params.body_pose.clone()
    pose[frames] += 0.15
    return replace(params, body_pose=pose)


def test_a_rerun_leaves_other_frames_alone_and_makes_no_seam(free_body: BodyModel, short_clip: Clip):
    """Frames 3 to 5 pushed off the optimum come back to it; the others are the same to the last bit."""
    config = replace(QUICK, settings=SolverSettings(iterations=120, final_tolerance=1e-8, sequence_tolerance=1e-8))
    best = fit_clip(short_clip, free_body, config).last.params
    start = disturbed(best, slice(3, 6))
    again = finished(rerun_events(short_clip, free_body, config, start, range(3, 6))).params
    outside = [0, 1, 2, 6, 7]
    assert same(again[outside], best[outside])
    mesh = Mesh(free_body, dtype=torch.float64)
    optimum, pushed, returned = (mesh.joints(p) for p in (best, start, again))
    assert float((pushed - optimum).norm(dim=2).max()) > 0.1
    assert float((returned - optimum).norm(dim=2)[3:6].mean()) < 0.005

    def seam(joints: Tensor) -> Tensor:
        """Mean acceleration of the joints at each frame but the ends."""
        return (joints[2:] - 2 * joints[1:-1] + joints[:-2]).norm(dim=2).mean(1)

    assert (seam(returned) < seam(optimum) + 0.003).all()


def mostly_swapped(body: BodyModel) -> Clip:
    """60 frames whose arms and legs are swapped from 15 to 44, and whose hands are seen in the first frames alone."""
    seen = hidden(keypoints_of(body, arms_in_motion(60, depth=3.5)), kp.HANDS, frames=slice(5, 60))
    xy, confidence = seen.xy.copy(), seen.confidence.copy()
    left, right = ([i for pair in PAIRED.values() for i in pair[side]] for side in (0, 1))
    for values in (xy, confidence):
        values[15:45, left + right] = values[15:45, right + left]
    return clip_of(Keypoints(xy=xy, confidence=confidence))


@pytest.mark.parametrize("window", [range(28, 32), range(0, 3), range(12, 20), range(59, 60)])
def test_costs_of_changed_frames_are_those_of_the_whole_clip(tiny_body: BodyModel, window: range):
    """In the middle of the swapped frames nothing but the whole clip tells that they are, nor that it shows hands."""
    clip, config = mostly_swapped(tiny_body), replace(PRESETS["tcfit"], pose_prior="relaxed")
    params = replace(arms_in_motion(60, depth=3.5), left_hand_pose=torch.full((60, 12), 4.0, dtype=torch.float64))
    whole = evaluate_objective(clip, tiny_body, config, params)
    before = replace(whole, frame_cost=np.full(60, np.nan))
    stages = Stages.of_clip(clip, tiny_body, config)
    after = patched(before, holding_feet(stages, params) or stages, params, [window], note="")
    changed = slice(window.start, window.stop)
    np.testing.assert_allclose(after.frame_cost[changed], whole.frame_cost[changed], rtol=1e-9)
    assert np.isnan(np.delete(after.frame_cost, range(window.start, window.stop))).all()


@pytest.mark.parametrize(
    ("mode", "frames"), [("global", 1), ("global", 2), ("sliding_window", 1), ("sliding_window", 3)]
)
def test_the_shortest_clips(free_body: BodyModel, mode: str, frames: int):
    config = replace(QUICK, temporal=replace(QUICK.temporal, mode=mode), relay_rounds=1)
    result = fit_clip(clip_of(body_only(free_body, frames)), free_body, config)
    assert all_finite(result) and len(result.last.params) == frames


def absurd(kind: str) -> Keypoints:
    rng = np.random.default_rng(3)
    xy, confidence = rng.uniform(0, 800, (2, 137, 2)), rng.uniform(0, 1, (2, 137))
    if kind == "far away":
        xy *= 1e6
    elif kind == "one place":
        xy[:], confidence[:] = 0.0, 1.0
    elif kind == "one line":
        xy[..., 1], confidence[:] = 400.0, 1.0
    elif kind == "confidence":
        confidence *= 1e4
    return Keypoints(xy=xy, confidence=confidence)


def few_steps(preset: str) -> FitConfig:
    weights = replace(PRESETS[preset].weights, collision=(0.0,) * 5)
    config = replace(PRESETS[preset], weights=weights, settings=SolverSettings(iterations=3))
    return replace(config, temporal=replace(config.temporal, window_size=2))


@pytest.mark.parametrize("kind", ["far away", "one place"])
def test_a_person_beyond_the_image_is_refused(tiny_body: BodyModel, kind: str):
    """Where cut-off parts are told apart, keypoints that all lie at or beyond the border show nobody."""
    with pytest.raises(InputError, match="shows a person"):
        fit_clip(clip_of(absurd(kind)), tiny_body, few_steps("tcfit"))


@pytest.mark.parametrize(
    ("preset", "kind"),
    [
        *(("tcfit", kind) for kind in ("random pixels", "one line", "confidence")),
        *(("paper", kind) for kind in ("far away", "one place")),
    ],
)
def test_absurd_keypoints_give_numbers(tiny_body: BodyModel, preset: str, kind: str):
    result = fit_clip(clip_of(absurd(kind)), tiny_body, few_steps(preset))
    assert all_finite(result)
    assert all(np.isfinite(list(p.objective.values())).all() for p in result.phases)


def test_one_senseless_frame_stops_no_phase(free_body: BodyModel, short_clip: Clip):
    """Once it froze phases 2 and 3 for the whole clip: its start lay behind the camera, at infinite cost."""
    xy = short_clip.keypoints.xy.copy()
    xy[4, kp.BODY] = np.random.default_rng(0).uniform(-1e5, 1e5, (25, 2))
    result = fit_clip(clip_of(replace(short_clip.keypoints, xy=xy)), free_body, QUICK)
    first, second, third = (p.params for p in result.phases)
    assert not torch.equal(second.body_pose, third.body_pose)
    assert float((second.betas[0] - first.betas.mean(0)).abs().max()) > 1e-6


@pytest.mark.thorough
def test_float32_ends_at_the_same_place(free_body: BodyModel, short_clip: Clip, quick: FitResult):
    single = fit_clip(short_clip, free_body, replace(QUICK, precision="float32", last_phase=1))
    assert single.last.params.body_pose.dtype == torch.float64
    assert single.last.objective["total"] == pytest.approx(quick.phases[0].objective["total"], rel=0.02)


def test_phase_3_tells_what_its_solver_minimised(
    free_body: BodyModel, short_clip: Clip, monkeypatch: pytest.MonkeyPatch
):
    """Feet that are held cost something, too."""
    deviation = np.full((8, 2, 4), np.inf)
    deviation[:, 0, 0] = 0.02
    held = Stances(position=np.tile([0.1, 0.9, 3.0], (8, 2, 4, 1)), deviation=deviation)
    monkeypatch.setattr(consistency, "holding_feet", lambda stages, *args, **options: stages.holding(held))
    config = replace(QUICK, weights=replace(NO_COLLISION, held_position=(10.0,) * 5))
    events = list(fit_events(short_clip, free_body, config))
    minimised = [event for event in events if isinstance(event, Iteration)][-1]
    told = events[-1].result.last.objective
    assert minimised.phase == 3 and told["held_position"] > 0.01 * told["total"]
    assert told["total"] == pytest.approx(minimised.cost, rel=1e-6)
