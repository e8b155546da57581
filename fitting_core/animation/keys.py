"""Fewer keys for an animation: only those that keep everything within a bound in the world.

Errors add up along a chain of joints, so no curve is looked at alone. Every channel begins with a key in each frame.
Channel by channel, from the ends of the chains to the root, every other key is taken away where all that the channel
moves stays within the bound with what the other channels have done already, and again, until nothing more can go. Then
the whole skeleton is posed as programs pose it between keys, and where anything is too far off after all, keys come
back. So the bound holds for what is written, in every frame of the video; how much of it a channel gets is not fixed.

Programs turn between two keys along the arc (glTF, three.js, Unreal), or go straight between the quaternions (Blender):
the bound holds for both.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.errors import InputError
from fitting_core.frame_runs import runs_where
from fitting_core.motion import Progress

MOST = 0.1
"""Metres: a larger bound leaves nothing of a motion."""
_PASSES = 6
"""Over all channels. Most keys go in the first three: each halves what is left at most."""
_MARGIN = 0.96
"""Share of the bound that is used up to first order: what is over it costs more keys when they are put back."""
_ENOUGH = 0.002
"""Share of the keys below which a pass is the last."""
_TINY = 1e-9
"""Metres: rounding error of the limits with all keys kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Animation:
    """A skeleton of J joints that moves over T frames, and P points that go along with it."""

    parents: Int[np.ndarray, "J"]
    """-1 for joint 0, the root."""
    offsets: Float[np.ndarray, "J 3"]
    """Of each joint from its parent, metres, in the parent's axes; the root's is ignored."""
    turns: Float[np.ndarray, "T J 4"]
    """Unit quaternions x, y, z, w of each joint against its parent, each on the side of the one before."""
    places: Float[np.ndarray, "T 3"]
    """Of the root, metres."""
    point_joints: Int[np.ndarray, "P"]
    """The joint that each point goes along with."""
    points: Float[np.ndarray, "P 3"]
    """From that joint in its axes, metres. The joints themselves are among them: those that should be held."""

    def __len__(self) -> int:
        return len(self.turns)

    @cached_property
    def tree(self) -> Tree:
        """The joints, level by level."""
        return Tree.of(self.parents)

    def posed(
        self, turns: Float[np.ndarray, "n J 4"], places: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n J 3 3"], Float[np.ndarray, "n J 3"], Float[np.ndarray, "n P 3"]]:
        """Rotations and places of the joints in the world, and the points there."""
        local = Rotation.from_quat(turns.reshape(-1, 4)).as_matrix().reshape(*turns.shape[:2], 3, 3)
        rest = torch.as_tensor(self._rest)
        turned, found = pose_joints(self.tree, torch.as_tensor(local), rest.expand(len(local), -1, -1))
        world, joints = turned.numpy(), found.numpy() + (places - self._rest[0])[:, None]
        at = self.point_joints
        return world, joints, (world[:, at] @ self.points[..., None])[..., 0] + joints[:, at]

    @cached_property
    def _rest(self) -> Float[np.ndarray, "J 3"]:
        """The joints without any rotation."""
        path = self.tree.ancestors.astype(float)
        return path @ self.offsets.astype(float)


@dataclass(frozen=True, kw_only=True, eq=False)
class Keys:
    """The frames at which the channels of an animation have keys, ascending."""

    places: Int[np.ndarray, "n"]
    """Of the root's place."""
    turns: tuple[Int[np.ndarray, "n"], ...]
    """Of each joint's turn."""
    weights: Int[np.ndarray, "n"] | None = None
    """Of the morph weights, all together; None if there are none."""
    frames: int
    """Number of frames, in each of which a channel had a key."""
    within: float
    """How far a joint or point may be off in any frame, metres."""
    largest: float
    """How far one is, metres."""

    @property
    def count(self) -> int:
        """Of all channels."""
        return sum(map(len, self._channels))

    @property
    def all(self) -> int:
        """How many there were."""
        return self.frames * len(self._channels)

    @property
    def text(self) -> str:
        """For people."""
        share = f"{self.count:,} of {self.all:,} keys ({self.count / self.all:.0%})"
        return f"{share}; joints, finger tips and toes at most {1000 * self.largest:.2f} mm off"

    @property
    def _channels(self) -> list[np.ndarray]:
        return [self.places, *self.turns, *([] if self.weights is None else [self.weights])]


def fewer_keys(
    animation: Animation,
    within: float,
    *,
    already: Float[np.ndarray, "T P"] | None = None,
    held: Mapping[int, Sequence[int]] | None = None,
    progress: Progress | None = None,
) -> Keys:
    """The keys needed for all points to stay within the bound. Raises InputError if the bound is invalid.

    Args:
        animation: With a key in each frame.
        within: How far a point may be off in any frame, metres.
        already: How far each point is off for other reasons, metres; None: not at all.
        held: Frames in which all channels above a joint, and its own, keep their keys, by joint.
        progress: See `Progress`.
    """
    check_bound(within)
    others = np.zeros((len(animation), len(animation.points))) if already is None else already
    thinning = _Thinning(animation, within - others, held or {})
    thinning.thin(progress or (lambda _: None))
    off = thinning.put_back()
    places, *turns = (np.flatnonzero(kept) for kept in thinning.kept)
    largest = float((off + others).max())
    return Keys(places=places, turns=tuple(turns), frames=len(animation), within=within, largest=largest)


def check_bound(within: float) -> None:
    """Raises InputError unless it is a valid bound for keys, metres."""
    if not 0 < within <= MOST:
        raise InputError(
            f"Keys within {1000 * within:g} mm: expected more than 0 and at most {1000 * MOST:g} mm. 2 or 5 suit most."
        )


def farthest(
    animation: Animation, places: Int[np.ndarray, "n"], *turns: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "T P"]:
    """How far each point is off when a program plays these keys, metres: the larger of both interpolations."""
    moved = between(animation.places, places)
    exact = animation.posed(animation.turns, animation.places)[2]
    found = np.zeros(exact.shape[:2])
    for way in (along_arc, straight):
        turned = np.stack([way(animation.turns[:, j], kept) for j, kept in enumerate(turns)], 1)
        found = np.maximum(found, np.linalg.norm(animation.posed(turned, moved)[2] - exact, axis=-1))
    return found


# --- between keys ---


def between(values: Float[np.ndarray, "T n"], keys: Int[np.ndarray, "m"]) -> Float[np.ndarray, "T n"]:
    """Values as played with only these keys."""
    before, after, share = _neighbours(len(values), keys)
    return (1 - share) * values[before] + share * values[after]


def straight(turns: Float[np.ndarray, "T 4"], keys: Int[np.ndarray, "m"]) -> Float[np.ndarray, "T 4"]:
    """The same for unit quaternions, as Blender does it."""
    found = between(turns, keys)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def along_arc(turns: Float[np.ndarray, "T 4"], keys: Int[np.ndarray, "m"]) -> Float[np.ndarray, "T 4"]:
    """The same, at an even speed of turning, as glTF has it."""
    before, after, share = _neighbours(len(turns), keys)
    return _arc(turns[before], turns[after], share)


def _neighbours(
    frames: int, keys: Int[np.ndarray, "m"]
) -> tuple[Int[np.ndarray, "T"], Int[np.ndarray, "T"], Float[np.ndarray, "T 1"]]:
    """The keys around each frame, and the fraction of the way between them."""
    at = np.arange(frames)
    n = np.searchsorted(keys, at, side="right")
    before, after = keys[np.maximum(n - 1, 0)], keys[np.minimum(n, len(keys) - 1)]
    return before, after, ((at - before) / np.maximum(after - before, 1))[:, None]


def _arc(
    first: Float[np.ndarray, "n 4"], last: Float[np.ndarray, "n 4"], share: Float[np.ndarray, "n 1"]
) -> Float[np.ndarray, "n 4"]:
    angle = np.arccos((first * last).sum(-1, keepdims=True).clip(-1, 1))
    flat = angle < 1e-6
    sine = np.where(flat, 1.0, np.sin(angle))
    parts = (np.where(flat, s, np.sin(s * angle) / sine) for s in (1 - share, share))
    found = sum(part * turn for part, turn in zip(parts, (first, last), strict=True))
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


# --- taking away ---


def spans(
    kept: Bool[np.ndarray, "T"], held: Bool[np.ndarray, "T"]
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Keys that may be taken away at once, as none is beside another: their frames, and of the keys around them."""
    for parity in (1, 2):
        keys = np.flatnonzero(kept)
        tried = np.arange(parity, len(keys) - 1, 2)
        tried = tried[~held[keys[tried]]]
        if len(tried):
            yield keys[tried], keys[tried - 1], keys[tried + 1]


def frames_within(
    first: Int[np.ndarray, "n"], last: Int[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"], Float[np.ndarray, "m 1"]]:
    """The frames between each two keys: which, of which two, and how far between them."""
    inside = last - first - 1
    owner = np.repeat(np.arange(len(first)), inside)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(inside) - inside, inside) + 1
    return first[owner] + step, owner, (step / (last - first)[owner])[:, None]


class _Thinning:
    """The channels while keys are taken away: 0 is the root's place, j + 1 the turn of joint j."""

    def __init__(self, animation: Animation, limits: np.ndarray, held: Mapping[int, Sequence[int]]) -> None:
        self._animation, self._limits = animation, limits
        frames, joints = animation.turns.shape[:2]
        self._world, joints_there, points = animation.posed(animation.turns, animation.places)
        middle = joints_there.mean((0, 1))  # so that single precision is enough far from the origin too
        self._joints, self._points = ((there - middle).astype(np.float32) for there in (joints_there, points))
        self._squared = ((_MARGIN * limits) ** 2).astype(np.float32)
        self.kept = np.ones((1 + joints, frames), bool)
        self._held = np.zeros_like(self.kept)
        above = np.concatenate([np.ones((joints, 1), bool), animation.tree.ancestors], 1)
        for joint, where in held.items():
            self._held[np.ix_(above[joint], where)] = True
        self._above = above[animation.point_joints]
        """(P, 1 + J): the channels that move each point."""
        still = np.flatnonzero(~animation.points.any(1))
        self._above[still, 1 + animation.point_joints[still]] = False  # a joint's turn leaves it in its place
        self._error = np.zeros((1 + joints, frames, 3), np.float32)
        """What each channel is off: metres, and in the world by a small angle about an axis."""
        self._off = np.zeros_like(self._points)
        """What the points are off by all of them, to first order."""

    def thin(self, progress: Progress) -> None:
        """Remove keys while that is within the limits to first order."""
        depth = self._animation.tree.ancestors.sum(1)
        # The ends of the chains first: they have most channels, and what they do moves few points.
        order = [*(1 + np.argsort(-depth, kind="stable")), 0]
        for k in range(_PASSES):
            before = self.kept.sum()
            for done, channel in enumerate(order):
                self._thin(int(channel))
                progress((k + done / len(order)) / _PASSES)
            if before - self.kept.sum() < _ENOUGH * before:
                break

    def _thin(self, channel: int) -> None:
        moved = np.flatnonzero(self._above[:, channel])
        for tried, first, last in spans(self.kept[channel], self._held[channel]):
            frames, owner, share = frames_within(first, last)
            error = self._error_of(channel, frames, first[owner], last[owner], share).astype(np.float32)
            change = (error - self._error[channel, frames])[:, None]
            if channel:
                arm = self._points[np.ix_(frames, moved)] - self._joints[frames, channel - 1][:, None]
                change = _cross(change, arm)
            off = self._off[np.ix_(frames, moved)] + change
            too_far = (np.einsum("tpc,tpc->tp", off, off) > self._squared[np.ix_(frames, moved)]).any(1)
            goes = np.ones(len(tried), bool)
            goes[owner[too_far]] = False
            self.kept[channel, tried[goes]] = False
            gone = goes[owner]
            self._error[channel, frames[gone]] = error[gone]
            self._off[np.ix_(frames[gone], moved)] = off[gone]

    def _error_of(
        self, channel: int, frames: np.ndarray, first: np.ndarray, last: np.ndarray, share: np.ndarray
    ) -> Float[np.ndarray, "n 3"]:
        animation = self._animation
        if not channel:
            places = animation.places
            return (1 - share) * places[first] + share * places[last] - places[frames]
        turns = animation.turns[:, channel - 1]
        found = Rotation.from_quat(_arc(turns[first], turns[last], share)) * Rotation.from_quat(turns[frames]).inv()
        error, parent = found.as_rotvec(), animation.parents[channel - 1]
        return error if parent < 0 else (self._world[frames, parent] @ error[..., None])[..., 0]

    def put_back(self) -> Float[np.ndarray, "T P"]:
        """Put keys back where the real distances exceed the limits; returns how far the points are then off.

        Of frames in a row the worst gets them, as it is mostly the middle of two keys, and then it is seen again.
        """
        while True:
            off = farthest(self._animation, *map(np.flatnonzero, self.kept))
            beyond = off - self._limits
            excess = beyond.max(1)
            worst = [run.start + excess[run].argmax() for run in runs_where(excess > _TINY)]
            if not worst:
                return off
            self.kept[:, worst] |= self._above[beyond[worst].argmax(1)].T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """NumPy's takes three times as long."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)
