"""Small clips, fits and edits for tests of projects: random, and the same again for the same seed."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from hypothesis import strategies as st

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.config.schema import PRESETS
from fitting_core.ground.arrays import grounding_arrays
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.gravity import Gravity
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.plane import Ground
from fitting_core.keypoints import COUNT, FINGER_JOINTS, GROUPS, PARTS, Keypoints
from fitting_core.results.error_bars import ErrorBars, error_bar_arrays
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.provenance import Provenance
from tcfit_app.project.edits.edit_log import EditHistory, LogEntry
from tcfit_app.project.edits.kinds import (
    SWAPPABLE,
    ClearDepth,
    CopyFrom,
    DetectAgain,
    Edit,
    Interpolate,
    Keep,
    Lock,
    MarkBad,
    MoveKey,
    MoveKeypoint,
    Nudge,
    Pin,
    PlaceKey,
    Release,
    RemoveKey,
    Reset,
    Restore,
    SetConfidence,
    SetDepth,
    ShapeHand,
    SwapSides,
    TakeOver,
    Unlock,
)
from tcfit_app.project.edits.packed_points import packed
from tcfit_app.project.edits.space_edits import MAX_DEPTH
from tcfit_app.project.storage.run_record import BodyRecord

FRAMES = 6
CAMERA = Camera(focal=(700.5, 710.0), center=(310.0, 250.0), size=(640, 480), source="as given")
BODY = BodyRecord(kind="smplx", gender="female", hash="0123abcd", source="bodies/SMPLX_FEMALE.npz")
CONFIG = PRESETS["tcfit"]


def sample_keypoints(frames: int = FRAMES, seed: int = 0) -> Keypoints:
    """Random positions; every fifth keypoint or so was not detected."""
    rng = np.random.default_rng(seed)
    confidence = rng.uniform(0.1, 1, (frames, COUNT)) * (rng.random((frames, COUNT)) > 0.2)
    return Keypoints(xy=rng.uniform(0, 480, (frames, COUNT, 2)), confidence=confidence)


def sample_clip(frames: int = FRAMES, seed: int = 0) -> Clip:
    return Clip(
        keypoints=sample_keypoints(frames, seed),
        camera=CAMERA,
        frame_rate=29.97,
        name="walk",
        first_frame=7,
        notes=("gap in 3", "größer"),
    )


def sample_params(seed: int, frames: int = FRAMES, components: int = 12) -> BodyParams:
    generator = torch.Generator().manual_seed(seed)
    neutral = BodyParams.neutral(frames, hand_components=components)
    return BodyParams(**{n: torch.randn(t.shape, generator=generator, dtype=t.dtype) for n, t in vars(neutral).items()})


def sample_phase(phase: int, seed: int, frames: int = FRAMES, components: int = 12) -> PhaseResult:
    rng = np.random.default_rng(seed)
    return PhaseResult(
        phase=phase,
        params=sample_params(100 * seed + phase, frames, components),
        objective={"data": rng.random(), "temporal": float("inf"), "total": rng.random()},
        frame_cost=rng.random(frames),
        seconds=phase / 2,
        notes=(f"shape from frames {seed}",),
        provenance=Provenance(*rng.integers(0, 5, (2, frames), np.uint8)),
        error_bars=sample_error_bars(seed, frames) if phase == 3 else None,
    )


def sample_error_bars(seed: int, frames: int = FRAMES) -> ErrorBars:
    """Any, and none in the first frame."""
    rng, unknown = np.random.default_rng(seed), ErrorBars.unknown(frames)
    joints, angles = (rng.random(values.shape, np.float32) for values in (unknown.joints, unknown.angles))
    joints[0], angles[0] = np.nan, np.nan
    return ErrorBars(joints=joints, angles=angles)


def sample_view(clip: Clip, *, name: str, count: int, times: np.ndarray | None = None) -> OtherView:
    """Of a camera a quarter turn to the left, that shows random keypoints."""
    relation = Relation(
        rotation=((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
        translation=(-4.0, 0.0, 4.0),
        offset=-1 / clip.frame_rate,
        rotation_deviation=2.0,
        direction_deviation=1.5,
        offset_deviation=0.01,
        disagreement=0.004,
        overlap=(len(clip) - 2) / clip.frame_rate,
        vertical_off=3.0,
    )
    other = replace(
        clip, keypoints=sample_keypoints(count, seed=count), name=name, views=(), source=None, first_frame=0
    )
    return OtherView(clip=other, times=times, relation=relation)


def sample_fit(seed: int, *, last_phase: int = 3, frames: int = FRAMES, components: int = 12) -> FitResult:
    return FitResult(
        phases=tuple(sample_phase(n, seed, frames, components) for n in range(1, last_phase + 1)),
        camera=CAMERA,
        config=CONFIG,
        observed=np.random.default_rng(seed).random((frames, 55)) < 0.5,
        warnings=("left and right were swapped",),
        pose_prior="relaxed",
        grounding=sample_grounding(seed, frames),
        size=0.97,
    )


def sample_grounding(seed: int, frames: int = FRAMES) -> Grounding:
    """A camera that looks down by 10 degrees from 1.5 m, or one that sees no feet if the seed is even."""
    random, up = np.random.default_rng(seed), np.array([0.0, -np.cos(np.radians(10)), -np.sin(np.radians(10))])
    known = seed % 2 == 1
    return Grounding(
        gravity=Gravity(up=up, deviation=4.5),
        contacts=Contacts(
            probability=random.random((frames, 2)),
            standing=random.random((frames, 2)) < 0.5,
            let_go=random.random((frames, 2)) < 0.2,
        ),
        ground=Ground(normal=up, offset=1.5, deviation=0.02) if known else None,
        missing="" if known else "the feet are not in the image",
    )


def assert_same_params(one: BodyParams, other: BodyParams) -> None:
    for name, tensor in vars(one).items():
        found = getattr(other, name)
        assert found.dtype == tensor.dtype and torch.equal(found, tensor), name


def assert_same_fit(one: FitResult, other: FitResult) -> None:
    """Equal to the last bit."""
    assert [p.phase for p in one.phases] == [p.phase for p in other.phases]
    for a, b in zip(one.phases, other.phases, strict=True):
        assert_same_params(a.params, b.params)
        assert (a.objective, a.seconds, a.notes) == (b.objective, b.seconds, b.notes)
        assert np.array_equal(a.frame_cost, b.frame_cost)
        bars, others = error_bar_arrays(a.error_bars), error_bar_arrays(b.error_bars)
        assert bars.keys() == others.keys() and all(_same_values(bars[name], others[name]) for name in bars)
        assert (a.provenance is None) == (b.provenance is None)
        for name, codes in vars(a.provenance).items() if a.provenance else ():
            assert getattr(b.provenance, name).dtype == np.uint8 and np.array_equal(codes, getattr(b.provenance, name))
    assert np.array_equal(one.observed, other.observed)
    known, found = grounding_arrays(one.grounding), grounding_arrays(other.grounding)
    assert known.keys() == found.keys() and all(_same_values(known[name], found[name]) for name in known)
    for name in ("camera", "config", "warnings", "pose_prior", "size"):
        assert getattr(one, name) == getattr(other, name), name


def _same_values(one: np.ndarray, other: np.ndarray) -> bool:
    return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def applied(detections: Keypoints, log: Iterable[LogEntry]) -> Keypoints:
    """The keypoints to fit: detections with a whole log."""
    return EditHistory(detections, log).keypoints


def same_keypoints(one: Keypoints, other: Keypoints) -> bool:
    """Equal to the last bit."""
    told = [np.nan if keypoints.turn is None else keypoints.turn for keypoints in (one, other)]
    same_turns = _same_values(*map(np.asarray, np.broadcast_arrays(*told)))
    arrays = ("xy", "confidence", "told_depth")
    return (
        one.kept == other.kept and same_turns and all(_same_values(getattr(one, n), getattr(other, n)) for n in arrays)
    )


_PIXELS = st.floats(-1e4, 1e4)
_FRAMES = st.lists(st.integers(0, FRAMES - 1), min_size=1, max_size=4, unique=True).map(tuple)
_JOINTS = st.lists(st.sampled_from([0, 4, 7, 30, 46, 100, 136]), min_size=1, max_size=4, unique=True).map(tuple)

_LOCKABLE = st.lists(st.sampled_from([0, 4, 7]), min_size=1, max_size=3, unique=True).map(tuple)
_BODY_JOINTS = st.lists(st.sampled_from([0, 4, 7, 14]), min_size=1, max_size=3, unique=True).map(tuple)


@st.composite
def _moves(draw: st.DrawFn) -> MoveKeypoint:
    frames, joints = draw(_FRAMES), draw(_JOINTS)
    row = st.tuples(*[st.tuples(_PIXELS, _PIXELS)] * len(joints))
    return MoveKeypoint(
        frames=frames, joints=joints, xy=draw(st.tuples(*[row] * len(frames))), confidence=draw(st.floats(0, 1))
    )


@st.composite
def _depths(draw: st.DrawFn) -> SetDepth:
    frames, joints = draw(_FRAMES), draw(_BODY_JOINTS)
    row = st.tuples(*[st.floats(-MAX_DEPTH, MAX_DEPTH)] * len(joints))
    return SetDepth(frames=frames, joints=joints, depth=draw(st.tuples(*[row] * len(frames))))


@st.composite
def _locks(draw: st.DrawFn) -> Lock:
    joints = draw(_LOCKABLE)
    turn = st.tuples(*[st.floats(-3, 3)] * 3)
    return Lock(frames=draw(_FRAMES), joints=joints, turn=draw(st.tuples(*[turn] * len(joints))))


@st.composite
def _shaped_hands(draw: st.DrawFn) -> ShapeHand:
    first, last = sorted(draw(st.tuples(*[st.integers(0, FRAMES - 1)] * 2)))
    blend = draw(st.integers(0, (last - first) // 2))
    shape = tuple((0.1 * k, draw(st.floats(-3, 3)), 0.0) for k in range(15))
    return ShapeHand(
        frames=tuple(range(first, last + 1)),
        joints=draw(st.sampled_from(list(FINGER_JOINTS.values()))),
        name="claw",
        shape=shape if blend or draw(st.booleans()) else None,
        blend=(blend if first else 0, blend if last < FRAMES - 1 else 0),
        before=shape[::-1] if blend and first else None,
        after=shape[::-1] if blend and last < FRAMES - 1 else None,
    )


@st.composite
def _taken_over(draw: st.DrawFn) -> TakeOver:
    frames, joints = draw(_FRAMES), draw(_JOINTS)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    xy, confidence = rng.uniform(-1e4, 1e4, (len(frames), len(joints), 2)), rng.random((len(frames), len(joints)))
    by_hand = rng.random(confidence.shape) < 0.5
    content = packed(np.concatenate([xy, confidence[..., None], by_hand[..., None]], -1))
    return TakeOver(frames=frames, joints=joints, source="person 2", exchange="x", packed=content)


@st.composite
def _detected_again(draw: st.DrawFn) -> DetectAgain:
    """Some of its groups may not have been found."""
    frames, part = draw(_FRAMES), draw(st.sampled_from(list(PARTS)))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    points = np.concatenate([rng.uniform(0, 480, (len(frames), COUNT, 2)), rng.random((len(frames), COUNT, 1))], -1)
    for k, group in enumerate(GROUPS.values()):
        points[rng.random(len(frames)) < 0.1 * (k + 1), group] = 0
    return DetectAgain.found(frames, part, points)


def _kept(edit: SetDepth) -> Keep:
    shift = tuple((None, *((1.5, -2.0),) * (len(edit.joints) - 1)) for _ in edit.frames)
    return Keep(frames=tuple(range(FRAMES)), joints=edit.joints, at=edit.frames, depth=edit.depth, shift=shift)


def _pinned(edit: SetDepth) -> Pin:
    places = tuple((10.0 * joint, 20.0) for joint in edit.joints)
    return Pin(frames=edit.frames, joints=edit.joints, xy=places, depth=edit.depth)


@st.composite
def _interpolations(draw: st.DrawFn) -> Interpolate:
    first = draw(st.integers(0, FRAMES - 3))
    return Interpolate.between(first, draw(st.integers(first + 2, FRAMES - 1)), draw(_JOINTS))


@st.composite
def _keyframes(draw: st.DrawFn) -> Edit:
    first, at, to, last = sorted(draw(st.tuples(*[st.integers(0, FRAMES - 1)] * 4)))
    frames, joints = tuple(range(first, last + 1)), draw(_JOINTS)
    if draw(st.booleans()):
        return PlaceKey(
            frames=frames, joints=joints, at=at, xy=draw(st.tuples(*[st.tuples(_PIXELS, _PIXELS)] * len(joints)))
        )
    if draw(st.booleans()):
        return MoveKey(frames=frames, joints=joints, at=at, to=to)
    return RemoveKey(frames=frames, joints=joints, at=at)


def edits() -> st.SearchStrategy[Edit]:
    """Every kind of edit of a clip of FRAMES frames."""
    where = {"frames": _FRAMES, "joints": _JOINTS}
    return st.one_of(
        _moves(),
        _interpolations(),
        _keyframes(),
        _depths(),
        _depths().map(_pinned),
        _depths().map(_kept),
        st.builds(Release, frames=_FRAMES, joints=_BODY_JOINTS),
        _locks(),
        _shaped_hands(),
        _taken_over(),
        _detected_again(),
        st.builds(Unlock, frames=_FRAMES, joints=_LOCKABLE),
        st.builds(ClearDepth, frames=_FRAMES, joints=_BODY_JOINTS),
        st.builds(Nudge, **where, by=st.tuples(_PIXELS, _PIXELS)),
        st.builds(MarkBad, **where),
        st.builds(Restore, **where),
        st.builds(SwapSides, frames=_FRAMES, joints=st.sampled_from(list(SWAPPABLE.values()))),
        st.builds(CopyFrom, **where, source=st.integers(0, FRAMES - 1)),
        st.builds(Reset, **where),
        st.builds(SetConfidence, **where, confidence=st.floats(0, 1)),
    )


def random_edit(seed: int) -> Edit:
    """An edit of a clip of FRAMES frames, without hypothesis: for processes that are to be killed."""
    rng = np.random.default_rng(seed)
    frames = tuple(rng.choice(FRAMES, 2, replace=False).tolist())
    joints = tuple(rng.choice(COUNT, 3, replace=False).tolist())
    xy = tuple(tuple(map(tuple, row)) for row in rng.uniform(0, 480, (2, 3, 2)).tolist())
    kinds: list[Edit] = [
        MoveKeypoint(frames=frames, joints=joints, xy=xy),
        MarkBad(frames=frames, joints=joints),
        Nudge(frames=frames, joints=joints, by=(1.0, -0.5)),
        SwapSides(frames=frames, joints=SWAPPABLE["arms"]),
        CopyFrom(frames=frames, joints=joints, source=0),
        Pin(frames=frames, joints=(4, 7), xy=((1.0, 2.0), (3.0, 4.0)), depth=((0.1, 0.2), (0.3, 0.4))),
        SetDepth(frames=frames, joints=(4, 7), depth=tuple(map(tuple, rng.uniform(-1, 1, (2, 2)).tolist()))),
        Keep(
            frames=tuple(range(FRAMES)),
            joints=(4, 7),
            at=frames,
            depth=((0.2, None), (None, 0.1)),
            shift=((None, (2.0, 1.0)), ((0.5, -3.0), None)),
        ),
        PlaceKey(frames=tuple(range(FRAMES)), joints=joints, at=frames[0], xy=xy[0]),
        Lock(frames=frames, joints=(4,), turn=((0.1, -0.2, 0.3),)),
        ShapeHand(frames=frames[:1], joints=FINGER_JOINTS["left"], name="x", shape=((0.1, -0.2, 0.3),) * 15),
    ]
    return kinds[seed % len(kinds)]
