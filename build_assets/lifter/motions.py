"""Windows of motion to train on: captured, mirrored, faster and slower, with limbs of other motions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2, vq
from torch import Tensor

from build_assets.lifter.figure import N_JOINTS, Figure
from build_assets.motion_capture.collections import captured_motion, split
from build_assets.motion_capture.retarget import MotionClip
from build_assets.pose_prior.synthesis import SYNTHESIS, group_rows
from evaluation.synthetic.motion_suite.windows import shipped_windows
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, other_side
from fitting_core.lifting.network import FRAMES, RATE

_SHORTEST = 14
"""Frames of a stretch that is worth using."""
_STILL = 0.3
"""Metres per second up to which a foot stands."""
_LOW = 0.05
"""Metres above the lowest ankle of its clip up to which it does."""
_CLUSTERS, _CLUSTERED, _FLATTENED = 128, 3000, 0.6
"""Poses are drawn from clusters with probability size^(1 - 0.6): much of what was captured walks or stands."""
_SPEEDS = (0.6, 1.6)
_POOL = 20_000
_OWN_AND_OTHER = {
    ("left_arm", "right_arm"): (0.55, 0.75),
    ("left_leg", "right_leg"): (0.85, 0.93),
    ("spine",): (0.8, 0.92),
    ("head",): (0.6, 0.8),
}
"""Shares of windows that keep their own limbs, and of those with their own or another window's; the rest has synthetic
ones, which move from pose to pose."""
_CARRYING = {("left_leg", "right_leg"), ("spine",)}
"""Groups that upright windows keep."""
_MOST_UPRIGHT = 25.0
"""Degrees of the root's lean up to which a window counts as upright."""
_DEVIATIONS = {(): 3.0, ("neck", "head"): 4.0, ("left_wrist", "right_wrist"): 10.0}
"""Degrees of a turn that stays for the whole window, of every joint, and of some more."""
_BENT = 0.35
"""Share of windows, but for upright ones, of people who bend at the hips: those who were captured hardly ever do."""
_BEND, _BENDS = (12.0, 0.0, 0.0), (25.0, 12.0, 20.0)
"""Degrees about the pelvis's axes (x: forward, y: turned, z: sideways): mean and standard deviation."""
_AT_EASE = 0.2
"""Share of windows, but for upright ones, of people who stand still. Who is captured hardly ever does, and with knees
that are bent by 20 degrees: bones were longer than the person's."""
_EASY_KNEE, _EASY_LEAN = 4.0, 2.5
"""Degrees (standard deviations) by which knees and the root of a person who stands at ease are off."""
_MOST_BENT = 35.0
"""Degrees of a knee in captured motion that they are made of."""
_SLOW = 0.3
"""Times its speed, at most, captured motion goes on in them."""
_OTHER_SIDE = [0, *(JOINT[other_side(name)] for name in list(JOINT)[1:N_JOINTS])]


def training_clips(folder: Path) -> tuple[list[MotionClip], list[MotionClip]]:
    """The motion capture in a folder to train on, and what is kept apart: held-out subjects, and the motions of the
    motion suite's untouched half.

    Raises:
        InputError: A file is missing or broken.
    """
    clips, held = split(captured_motion(folder))
    kept_apart = {window.clip for window in shipped_windows().values() if window.half == "untouched"}
    held += [clip for clip in clips if clip.name in kept_apart]
    return [clip for clip in clips if clip.name not in kept_apart], held


class Motion(NamedTuple):
    """Windows in the world, y up."""

    turns: Float[Tensor, "B T 22 3 3"]
    """The root in the world, other joints against their parents."""
    pelvis: Float[Tensor, "B T 3"]
    """Metres."""
    stands: Float[Tensor, "B T 2"]
    """1 where the left or the right foot stands still on the ground; NaN if the legs were not captured."""


@dataclass(frozen=True, eq=False)
class Corpus:
    """Captured motion, frame after frame."""

    turns: Float[Tensor, "N 22 3 3"]
    pelvis: Float[Tensor, "N 3"]
    stands: Bool[Tensor, "N 2"]
    start: Int[np.ndarray, "N"]
    """First frame of each frame's stretch."""
    stop: Int[np.ndarray, "N"]
    fps: Float[np.ndarray, "N"]
    likely: Float[np.ndarray, "N"]
    """Probabilities of being drawn, summed up."""
    upright: Int[np.ndarray, "n"]
    """Frames of which the root is upright."""
    standing: Int[np.ndarray, "n"]
    """Those of them in which both feet stand on knees that are nearly straight."""

    @staticmethod
    def of(clips: Sequence[MotionClip], figure: Figure, rng: np.random.Generator) -> "Corpus":
        """All stretches without a gap that are long enough."""
        parts = [part for clip in clips for part in _stretches(clip, figure.leg)]
        turns, pelvis, stands, fps = (np.concatenate([part[k] for part in parts]) for k in range(4))
        lengths = np.array([len(part[0]) for part in parts])
        ends = np.cumsum(lengths)
        upright = np.degrees(np.arccos(np.clip(turns[:, 0, 1, 1], -1, 1))) < _MOST_UPRIGHT
        return Corpus(
            turns=torch.as_tensor(turns, dtype=torch.float32),
            pelvis=torch.as_tensor(pelvis, dtype=torch.float32),
            stands=torch.as_tensor(stands),
            start=np.repeat(ends - lengths, lengths),
            stop=np.repeat(ends, lengths),
            fps=fps,
            likely=_likely(torch.as_tensor(turns, dtype=torch.float32), figure, rng),
            upright=np.flatnonzero(upright),
            standing=np.flatnonzero(upright & stands.all(1) & _straight(turns)),
        )

    def __len__(self) -> int:
        return len(self.turns)


def _straight(turns: Float[np.ndarray, "N 22 3 3"]) -> Bool[np.ndarray, "N"]:
    knees = turns[:, [JOINT["left_knee"], JOINT["right_knee"]]]
    return np.asarray((np.degrees(np.arctan2(knees[..., 2, 1], knees[..., 2, 2])) < _MOST_BENT).all(1))


def _stretches(clip: MotionClip, leg: float) -> list[tuple[np.ndarray, ...]]:
    """Turns, pelvis, standing feet and frame rate of a clip's frames without gaps, on legs of `leg` metres."""
    local = rotations.exp(torch.as_tensor(clip.body_pose).view(-1, N_JOINTS - 1, 3)).numpy()
    turns = np.concatenate([clip.orient[:, None], local], 1)
    still = np.zeros((len(turns), 2), bool)
    if len(turns) > 1:
        speed = np.linalg.norm(np.gradient(clip.feet, axis=0), axis=2) * clip.fps
        height = clip.feet[..., 1] - np.percentile(clip.feet[..., 1], 2)
        still = (speed < _STILL) & (height < _LOW)
    pelvis, fps = clip.pelvis * (leg / clip.leg), np.full(len(turns), clip.fps)
    breaks = np.flatnonzero(np.diff(clip.frames) > 1) + 1
    bounds = zip([0, *breaks], [*breaks, len(turns)], strict=True)
    return [(turns[a:b], pelvis[a:b], still[a:b], fps[a:b]) for a, b in bounds if b - a >= _SHORTEST]


def _likely(turns: Tensor, figure: Figure, rng: np.random.Generator) -> Float[np.ndarray, "N"]:
    nowhere = turns.clone()
    nowhere[:, 0] = torch.eye(3)
    shape = torch.zeros(1, 10)
    points = torch.cat([figure.pose(part, shape.expand(len(part), 10)).flatten(1) for part in nowhere.split(4096)])
    some = points[torch.as_tensor(rng.choice(len(points), min(_CLUSTERED, len(points)), replace=False))].numpy()
    centres, _ = kmeans2(some, min(_CLUSTERS, len(some) // 2), iter=8, minit="++", rng=rng)
    label, _ = vq(points.numpy(), centres)
    weight = np.bincount(label, minlength=len(centres)).astype(float)[label] ** -_FLATTENED
    return np.cumsum(weight / weight.sum())


class Windows:
    """Draws windows from a corpus.

    Args:
        corpus: what was captured.
        rng: source of all chance.
        varied: faster, slower, backward, with other limbs; else as captured.
    """

    def __init__(self, corpus: Corpus, rng: np.random.Generator, *, varied: bool = True) -> None:
        self.corpus, self.rng, self.varied = corpus, rng, varied
        self._limbs = {groups: self._pool(groups) for groups in SYNTHESIS} if varied else {}

    def _pool(self, groups: tuple[str, ...]) -> tuple[list[int], Tensor]:
        drawn = np.concatenate(SYNTHESIS[groups](self.rng, _POOL), 1)
        joints = [row + 1 for group in groups for row in group_rows(group)]
        return joints, rotations.exp(torch.as_tensor(drawn, dtype=torch.float32))

    def draw(self, count: int, *, upright: Bool[np.ndarray, "B"] | None = None) -> Motion:
        """Draw `count` windows, upright where requested."""
        if not self.varied:
            return self._captured(count, upright)
        others = np.ones(count, bool) if upright is None else ~upright
        at_ease = others & (self.rng.random(count) < _AT_EASE) & bool(len(self.corpus.standing))
        motion = self._captured(count, upright, at_ease)
        turns, stands = motion.turns.clone(), motion.stands.clone()
        still = torch.as_tensor(at_ease)
        turns[still], stands[still] = self._at_ease(turns[still]), 1.0
        other = self._captured(count).turns
        for groups, (joints, pool) in self._limbs.items():
            own, either = _OWN_AND_OTHER[groups]
            chance = torch.as_tensor(self.rng.random(count))
            if groups in _CARRYING:
                chance[torch.as_tensor(~others | at_ease)] = 0.0
            theirs, made = (chance >= own) & (chance < either), chance >= either
            for which, source in ((theirs, other[theirs][:, :, joints]), (made, self._acted(pool, int(made.sum())))):
                changed = turns[which]
                changed[:, :, joints] = source
                turns[which] = changed
            if groups == ("left_leg", "right_leg"):
                stands[theirs | made] = torch.nan
        bent = torch.as_tensor((self.rng.random(count) < _BENT) & others & ~at_ease)
        turns[bent] = self._bent(turns[bent])
        deviation = torch.full((N_JOINTS, 1), 3.0)
        for names, degrees in _DEVIATIONS.items():
            deviation[[JOINT[name] for name in names]] = degrees
        noise = torch.as_tensor(self.rng.standard_normal((count, 1, N_JOINTS, 3)), dtype=torch.float32)
        return Motion(turns @ rotations.exp(torch.deg2rad(deviation) * noise), motion.pelvis, stands)

    def _captured(
        self, count: int, upright: np.ndarray | None = None, at_ease: Bool[np.ndarray, "B"] | None = None
    ) -> Motion:
        c, rng = self.corpus, self.rng
        at = np.searchsorted(c.likely, rng.random(count)).clip(0, len(c) - 1)
        if upright is not None and len(c.upright):
            weight = np.diff(c.likely, prepend=0.0)[c.upright]
            at = np.where(upright, rng.choice(c.upright, count, p=weight / weight.sum()), at)
        if at_ease is not None and at_ease.any():
            at = np.where(at_ease, rng.choice(c.standing, count), at)
        step = c.fps[at] / RATE
        if self.varied:
            step = (
                step * np.exp(rng.uniform(np.log(_SPEEDS[0]), np.log(_SPEEDS[1]), count)) * rng.choice([-1, 1], count)
            )
        if at_ease is not None:
            step = np.where(at_ease, _SLOW * rng.random(count) * step, step)
        time = at[:, None] + (np.arange(FRAMES) - FRAMES // 2) * step[:, None] - c.start[at, None]
        # Beyond its ends a stretch runs backward: people stop, and go back.
        last = (c.stop - c.start)[at, None] - 1.0
        time = time % (2 * last)
        time = np.where(time > last, 2 * last - time, time)
        before = np.minimum(np.floor(time).astype(int), last.astype(int) - 1)
        share = torch.as_tensor(time - before, dtype=torch.float32)
        index = torch.as_tensor(before + c.start[at, None])
        turns = between(c.turns[index], c.turns[index + 1], share[..., None, None, None])
        pelvis = (1 - share)[..., None] * c.pelvis[index] + share[..., None] * c.pelvis[index + 1]
        stands = (c.stands[index] & c.stands[index + 1]).float()
        return _mirrored_half(turns, pelvis, stands, torch.as_tensor(rng.random(count) < 0.5))

    def _at_ease(self, turns: Float[Tensor, "n T 22 3 3"]) -> Float[Tensor, "n T 22 3 3"]:
        """The root upright and knees straight, both nearly, feet where they were; the spine bends half as far."""
        rng, eased = self.rng, turns.clone()
        up = turns[:, :, 0, 1]  # the world's up in the root's axes
        axis = torch.linalg.cross(up, torch.tensor([0.0, 1.0, 0.0]).expand_as(up))
        tilted = axis / axis.norm(dim=-1, keepdim=True).clamp_min(1e-6) * up[..., 1:2].clamp(-1, 1).acos()
        swayed = np.radians(_EASY_LEAN) * rng.standard_normal((len(turns), 1, 3)) * (1, 0, 1)
        sway = rotations.exp(torch.as_tensor(swayed, dtype=torch.float32))
        eased[:, :, 0] = turns[:, :, 0] @ rotations.exp(tilted).mT @ sway
        spine = [JOINT[f"spine{part}"] for part in (1, 2, 3)]
        eased[:, :, spine] = between(torch.eye(3).expand_as(turns[:, :, spine]), turns[:, :, spine], torch.tensor(0.5))
        for side in ("left", "right"):
            hip, knee, ankle = (JOINT[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
            bent = torch.atan2(turns[:, :, knee, 2, 1], turns[:, :, knee, 2, 2])
            left = np.radians(_EASY_KNEE) * abs(rng.standard_normal((len(turns), 1)))
            half = (bent - torch.as_tensor(left, dtype=torch.float32)).clamp_min(0) / 2
            turn = rotations.exp(torch.stack([half, torch.zeros_like(half), torch.zeros_like(half)], -1))
            eased[:, :, hip] = turns[:, :, hip] @ turn
            eased[:, :, knee] = turn.mT @ turns[:, :, knee] @ turn.mT
            eased[:, :, ankle] = turn @ turns[:, :, ankle]
        return eased

    def _bent(self, turns: Float[Tensor, "n T 22 3 3"]) -> Float[Tensor, "n T 22 3 3"]:
        """The pelvis and all above it turned, the legs as they were: from one angle to another over the window."""
        first, change = torch.as_tensor(self.rng.standard_normal((2, len(turns), 1, 3)), dtype=torch.float32)
        share = torch.linspace(-0.5, 0.5, FRAMES)[:, None]
        turn = rotations.exp(torch.deg2rad(torch.tensor(_BEND) + torch.tensor(_BENDS) * (first + share * change)))
        bent, hips = turns.clone(), [JOINT["left_hip"], JOINT["right_hip"]]
        bent[:, :, 0] = turns[:, :, 0] @ turn
        bent[:, :, hips] = turn.mT[:, :, None] @ turns[:, :, hips]
        return bent

    def _acted(self, pool: Tensor, count: int) -> Float[Tensor, "n T J 3 3"]:
        """Limbs that go through two or three poses, and rest in them now and then."""
        keys = torch.as_tensor(self.rng.integers(len(pool), size=(count, 3)))
        pace, begin = (torch.as_tensor(self.rng.random((count, 1)), dtype=torch.float32) for _ in range(2))
        time = (torch.linspace(0, 2, FRAMES) * pace + 0.3 * begin).clamp(0, 1.999)
        key = time.long()
        share = time - key
        share = share * share * (3 - 2 * share)
        row = torch.arange(count)[:, None]
        return between(pool[keys[row, key]], pool[keys[row, key + 1]], share[..., None, None, None])


def between(one: Tensor, other: Tensor, share: Tensor) -> Tensor:
    """Rotations between two that are near each other: the nearest ones to their weighted mean's first two columns."""
    mean = (1 - share) * one + share * other
    first = torch.nn.functional.normalize(mean[..., 0], dim=-1, eps=1e-8)
    second = mean[..., 1] - (first * mean[..., 1]).sum(-1, keepdim=True) * first
    second = torch.nn.functional.normalize(second, dim=-1, eps=1e-8)
    return torch.stack([first, second, torch.linalg.cross(first, second)], -1)


def _mirrored_half(turns: Tensor, pelvis: Tensor, stands: Tensor, which: Bool[Tensor, "B"]) -> Motion:
    """Some windows as a mirror shows them."""
    sign = torch.tensor([-1.0, 1.0, 1.0])
    other = turns[:, :, _OTHER_SIDE] * sign[:, None] * sign
    return Motion(
        torch.where(which[:, None, None, None, None], other, turns),
        torch.where(which[:, None, None], pelvis * sign, pelvis),
        torch.where(which[:, None, None], stands.flip(-1), stands),
    )
