"""Which detections count, and how much: what an image's border makes up, swapped sides, and what is seen at all."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.config.schema import FitConfig
from fitting_core.keypoints import Keypoints

BORDER = 0.015
"""Share of the image height: a detection nearer to the border is one of a part that lies beyond it."""
LONE_HIP = 0.5
"""Confidence that a hip needs where its knee is not seen."""
SEEN = 0.2
"""Confidence from which a keypoint counts as seen, where a yes or no is needed."""
USABLE = 4
"""Body keypoints that a frame must show to say where the person is."""

_HIPS = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
_LEGS = [[kp.INDEX[f"{side}_hip"], kp.INDEX[f"{side}_knee"]] for side in ("left", "right")]
_OF_CLIP = {"of the whole clip": True}
"""Marks a field that the whole clip decides: its parts keep it as it is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """What a fit takes from the detections of a clip.

    `observations[frames]` is the same for some consecutive frames. Every field has a row for each frame and is sliced,
    unless it is declared as one that the whole clip decides.
    """

    keypoints: Keypoints
    """The detections, with swapped sides swapped back."""
    swapped: Bool[np.ndarray, "T pairs"]
    """Whether the sides of a pair of limbs were swapped back; pairs in the order of PAIRED."""
    xy: Float[Tensor, "T 137 2"]
    """Pixels."""
    confidence: Float[Tensor, "T 137"]
    side: Float[Tensor, "T 137 2"]
    """See `cut_off`; 0 everywhere if the configuration takes detections at the border at their word."""
    seen: Bool[Tensor, "T 137"]
    """Keypoints of which the image says where they are."""
    hips_seen: Bool[Tensor, "T"]
    """Whether both hips are."""
    leg_seen: Bool[Tensor, "T"]
    """Whether hip and knee of one side are."""
    shown: Bool[Tensor, "137"] = field(metadata=_OF_CLIP)
    """Keypoints that any frame of the clip shows."""

    def __post_init__(self) -> None:
        rows = {name: len(value) for name, value in self._by_frame().items()}
        assert set(rows.values()) == {len(self.keypoints)}, f"fields of a row for each frame differ in length: {rows}"

    @staticmethod
    def of(
        keypoints: Keypoints, size: tuple[int, int], config: FitConfig, *, dtype: torch.dtype, device: torch.device
    ) -> "Observations":
        """The observations of a whole clip.

        Args:
            keypoints: the detections.
            size: image width and height in pixels.
            config: whether swapped sides are swapped back, and whether the image's border tells less.
            dtype: of the tensors.
            device: of the tensors.
        """
        swapped = np.zeros((len(keypoints), len(PAIRED)), bool)
        if config.unswap_sides:
            keypoints, swaps = unswapped(keypoints)
            for pair, name in enumerate(PAIRED):
                swapped[swaps.get(name, []), pair] = True
        side = cut_off(keypoints, size) if config.one_sided_cut_off else np.zeros(keypoints.xy.shape, np.int8)
        xy, confidence, sides = (
            as_tensor(a, dtype=dtype, device=device) for a in (keypoints.xy, keypoints.confidence, side)
        )
        seen = (confidence > SEEN) & (sides == 0).all(-1)
        return Observations(
            keypoints=keypoints,
            swapped=swapped,
            xy=xy,
            confidence=confidence,
            side=sides,
            seen=seen,
            hips_seen=seen[:, _HIPS].all(1),
            leg_seen=torch.stack([seen[:, leg].all(1) for leg in _LEGS]).any(0),
            shown=(confidence > 0).any(0),
        )

    def __len__(self) -> int:
        return len(self.keypoints)

    def __getitem__(self, frames: slice) -> Self:
        return replace(self, **{name: value[frames] for name, value in self._by_frame().items()})

    def _by_frame(self) -> dict[str, Any]:
        """Every field with a row for each frame."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.metadata != _OF_CLIP}

    @property
    def swaps(self) -> dict[str, Int[np.ndarray, "n"]]:
        """Frames in which the sides of a pair of limbs were swapped back, by the pair's name, where there are any."""
        frames = {name: np.flatnonzero(self.swapped[:, pair]) for pair, name in enumerate(PAIRED)}
        return {name: where for name, where in frames.items() if len(where)}

    @property
    def usable(self) -> Bool[Tensor, "T"]:
        """Frames with enough confident keypoints to say where the person is."""
        return self.seen[:, kp.BODY].sum(1) >= USABLE


def as_tensor(a: np.ndarray, *, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The array in a fit's type and on its device."""
    a = np.asarray(a)
    # torch warns of arrays that cannot be written, as those of a project are.
    a = a if a.flags.writeable else a.copy()
    return torch.as_tensor(a, dtype=dtype, device=device)


def cut_off(keypoints: Keypoints, size: tuple[int, int]) -> Int[np.ndarray, "T 137 2"]:
    """Along which axes a detection says no more than that the part lies at least so far out: -1, 0 or 1 for x and y.

    OpenPose puts parts that the image cuts off onto its border, and the hips of half-body footage near its bottom, at
    confidences of 0.2 to 0.5 (seen on sign-language clips: wrists in the lap at 3 px from the border, hips 40 px too
    high). Taken at their word they pull the body together; left out, the unseen forearm swings at the camera.

    Args:
        keypoints: the detections.
        size: image width and height in pixels.

    Returns:
        1: the part lies there or at a larger coordinate; -1: there or at a smaller one; 0: just there.
    """
    last = np.array(size) - 1
    margin = BORDER * size[1]
    side = (keypoints.xy > last - margin).astype(np.int8) - (keypoints.xy < margin).astype(np.int8)
    seen = (keypoints.confidence > SEEN) & (side == 0).all(-1)
    hips = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
    knees = [kp.INDEX["left_knee"], kp.INDEX["right_knee"]]
    alone = ~seen[:, knees] & (keypoints.confidence[:, hips] < LONE_HIP)
    side[:, hips, 1] = np.where(alone, 1, side[:, hips, 1])
    no_leg = alone.all(1)
    side[no_leg, kp.INDEX["mid_hip"], 1] = 1
    side[(keypoints.confidence == 0) | keypoints.placed] = 0
    return side


_HAND = [kp.LEFT_HAND.start + i for i in range(21)], [kp.RIGHT_HAND.start + i for i in range(21)]
PAIRED = {
    "arms": (
        [kp.INDEX["left_elbow"], kp.INDEX["left_wrist"]],
        [kp.INDEX["right_elbow"], kp.INDEX["right_wrist"]],
        _HAND,
    ),
    "legs": (
        [kp.INDEX[f"left_{n}"] for n in ("knee", "ankle", "big_toe", "small_toe", "heel")],
        [kp.INDEX[f"right_{n}"] for n in ("knee", "ankle", "big_toe", "small_toe", "heel")],
        ([], []),
    ),
}
"""Left and right keypoints of a pair of limbs, the first two of which tell whether it is swapped; what goes along."""
_SWAP_PRICE = 0.5
"""What a change of sides must save: half the distance of the two sides, summed over the telling keypoints."""


def unswapped(keypoints: Keypoints) -> tuple[Keypoints, dict[str, Int[np.ndarray, "n"]]]:
    """The keypoints with left and right limbs swapped back where a detector swapped them for some frames.

    A swap makes both limbs jump across the body and back. For each pair of limbs, the sequence of "as detected" and
    "swapped" of least total movement is found by dynamic programming; "as detected" is what holds for most frames.
    Frames where a person placed elbows and wrists (or knees and ankles) of both sides stay as they are. A single one
    that was placed goes with the others: it was nudged where it is, and not called left.

    Returns:
        The corrected keypoints, and the frames that were swapped back, by pair.
    """
    xy, confidence, placed = keypoints.xy.copy(), keypoints.confidence.copy(), keypoints.placed.copy()
    swaps = {}
    for name, (left, right, others) in PAIRED.items():
        sides = [left[:2], right[:2]]
        settled = np.all(keypoints.placed[:, sides], axis=(1, 2))
        telling = np.all(keypoints.confidence[:, sides] > SEEN, axis=1) & ~settled[:, None]
        frames = _swapped_frames(keypoints.xy[:, sides], telling)
        frames = frames[~settled[frames]]
        if len(frames):
            one, other = [*left, *others[0]], [*right, *others[1]]
            for values in (xy, confidence, placed):
                values[np.ix_(frames, one + other)] = values[np.ix_(frames, other + one)]
            swaps[name] = frames
    return Keypoints(xy=xy, confidence=confidence, by_hand=placed), swaps


def _swapped_frames(xy: Float[np.ndarray, "T 2 n 2"], telling: Bool[np.ndarray, "T n"]) -> Int[np.ndarray, "m"]:
    """Frames to swap: the shortest path through two states, the more frequent one being "as detected".

    Frames that tell nothing go with their neighbours where these agree.

    Args:
        xy: Left and right keypoints, pixels.
        telling: Whether both sides of a keypoint are known.
    """
    known = np.flatnonzero(telling.any(1))
    if len(known) < 3:
        return known[:0]
    points, both = xy[known], telling[known][1:] & telling[known][:-1]
    apart = (np.linalg.norm(points[:, 0] - points[:, 1], axis=-1) * telling[known]).sum(1)
    same = (np.linalg.norm(points[1:] - points[:-1], axis=-1).sum(1) * both).sum(1)
    crossed = (np.linalg.norm(points[1:] - points[:-1, ::-1], axis=-1).sum(1) * both).sum(1)
    price = _SWAP_PRICE * np.minimum(apart[1:], apart[:-1])
    total, came_from = np.zeros(2), []
    for stay, change in zip(same, crossed + price, strict=True):
        options = total[:, None] + np.array([[stay, change], [change, stay]])
        came_from.append(options.argmin(0))
        total = options.min(0)
    state = [int(total.argmin())]
    for choice in reversed(came_from):
        state.append(int(choice[state[-1]]))
    path = np.array(state[::-1], float)
    everywhere = np.interp(np.arange(len(xy)), known, path if path.mean() < 0.5 else 1 - path)
    return np.flatnonzero(everywhere == 1)
