"""The 137 OpenPose keypoints: the one place that defines their order, names, groups and bones."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.errors import InputError

BODY_25 = (
    "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist mid_hip right_hip right_knee "
    "right_ankle left_hip left_knee left_ankle right_eye left_eye right_ear left_ear left_big_toe left_small_toe "
    "left_heel right_big_toe right_small_toe right_heel"
).split()
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
"""In the order of SMPL-X's finger joints."""
_FINGER_POINTS = [f"{finger}{k}" for finger in ("thumb", "index", "middle", "ring", "pinky") for k in (1, 2, 3, 4)]
HAND_21 = ["wrist", *_FINGER_POINTS]
FACE_70 = (
    [f"contour{i}" for i in range(17)]
    + [f"right_brow{i}" for i in range(5)]
    + [f"left_brow{i}" for i in range(5)]
    + [f"nose_bridge{i}" for i in range(4)]
    + [f"nostrils{i}" for i in range(5)]
    + [f"right_eyelid{i}" for i in range(6)]
    + [f"left_eyelid{i}" for i in range(6)]
    + [f"outer_lip{i}" for i in range(12)]
    + [f"inner_lip{i}" for i in range(8)]
    + ["right_pupil", "left_pupil"]
)

BODY = slice(0, 25)
LEFT_HAND = slice(25, 46)
RIGHT_HAND = slice(46, 67)
HANDS = slice(25, 67)
FACE = slice(67, 137)
CONTOUR = slice(67, 84)
COUNT = 137
SEEN = 0.2
"""Confidence above which a keypoint counts as seen, where a yes or no is needed."""
GROUPS = {"body": BODY, "left_hand": LEFT_HAND, "right_hand": RIGHT_HAND, "face": FACE}

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
PartOfPerson = Literal["person", "left_hand", "right_hand", "face"]
PARTS: dict[PartOfPerson, slice] = {
    "person": slice(0, COUNT),
    "left_hand": LEFT_HAND,
    "right_hand": RIGHT_HAND,
    "face": FACE,
}
"""What can be looked for by itself, and its keypoints."""

NAMES = BODY_25 + [f"left_{n}" for n in HAND_21] + [f"right_{n}" for n in HAND_21] + [f"face_{n}" for n in FACE_70]
INDEX = {name: i for i, name in enumerate(NAMES)}
# Wrists are distinguished by group: INDEX["left_wrist"] must be the body's point, not the hand's.
INDEX.update({name: i for i, name in enumerate(BODY_25)})
ERROR_GROUPS: dict[str, tuple[int, ...]] = {
    "body": tuple(i for i in range(BODY.stop) if i != INDEX["neck"]),
    "hands": tuple(range(HANDS.start, HANDS.stop)),
    "face": tuple(range(FACE.start, FACE.stop)),
}
"""Keypoints whose errors are stated separately, because 110 points of hands and face outvote a body. The neck is left
out: no preset fits it, and the body's is 50 px off in each frame of a 640 x 480 clip."""

_BODY_BONES = (
    "nose-neck neck-right_shoulder right_shoulder-right_elbow right_elbow-right_wrist neck-left_shoulder "
    "left_shoulder-left_elbow left_elbow-left_wrist neck-mid_hip mid_hip-right_hip right_hip-right_knee "
    "right_knee-right_ankle mid_hip-left_hip left_hip-left_knee left_knee-left_ankle nose-right_eye nose-left_eye "
    "right_eye-right_ear left_eye-left_ear left_ankle-left_big_toe left_big_toe-left_small_toe left_ankle-left_heel "
    "right_ankle-right_big_toe right_big_toe-right_small_toe right_ankle-right_heel"
).split()
_HAND_BONES = [(0 if k == 0 else 4 * f + k, 4 * f + k + 1) for f in range(5) for k in range(4)]


def _chain(first: int, last: int, *, closed: bool = False) -> list[tuple[int, int]]:
    pairs = [(FACE.start + i, FACE.start + i + 1) for i in range(first, last)]
    return pairs + ([(FACE.start + last, FACE.start + first)] if closed else [])


BONES: list[tuple[int, int]] = (
    [(BODY_25.index(a), BODY_25.index(b)) for a, b in (bone.split("-") for bone in _BODY_BONES)]
    + [(start + a, start + b) for start in (LEFT_HAND.start, RIGHT_HAND.start) for a, b in _HAND_BONES]
    + _chain(0, 16)
    + _chain(17, 21)
    + _chain(22, 26)
    + _chain(27, 30)
    + _chain(31, 35)
    + _chain(36, 41, closed=True)
    + _chain(42, 47, closed=True)
    + _chain(48, 59, closed=True)
    + _chain(60, 67, closed=True)
)
"""Pairs of keypoint indices to draw a line between."""

LIMBS = [
    BODY_25.index(f"{side}_{n}")
    for side in ("right", "left")
    for n in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
]
"""The 12 limb keypoints on which pose errors are usually reported."""


LOCKABLE = {INDEX["nose"]: "head"} | {INDEX[name]: name for name in ("neck", *(BODY_25[i] for i in LIMBS))}
"""Keypoints by which a joint of the body can be locked as it is turned, and that joint's name."""

FINGER_JOINTS: dict[Side, tuple[int, ...]] = {
    side: tuple(INDEX[f"{side}_{finger}{k}"] for finger in FINGERS for k in (1, 2, 3)) for side in SIDES
}
"""The keypoints on the 15 finger joints of a hand, in SMPL-X's order: by their turns a person states its shape."""
_BEYOND_KNUCKLES = {
    side: np.array([INDEX[f"{side}_{finger}{k}"] for finger in FINGERS for k in (2, 3, 4)]) for side in SIDES
}


@dataclass(frozen=True, kw_only=True)
class KeptOffset:
    """Depths and places of a body keypoint that a person stated, and the frames in which it is off by as much.

    See `fit.evidence.kept_offsets`: it is off in the body's own axes.
    """

    keypoint: int
    """The body's: where left and right were swapped, of the right side."""
    frames: tuple[int, ...]
    """Where it holds, counted from the clip's first."""
    depths: Mapping[int, float]
    """As `Keypoints.depth`, by frame."""
    shifts: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Pixels from its detection to where it was placed, by frame."""


@dataclass(frozen=True, kw_only=True)
class Keypoints:
    """Detections of one person over a clip, in the order of NAMES.

    A keypoint that was not detected has confidence 0 and a finite position (its value means nothing), never NaN.
    """

    xy: Float[np.ndarray, "T 137 2"]
    """Pixels, x right, y down, origin at the image's top left corner."""
    confidence: Float[np.ndarray, "T 137"]
    """0 (not detected) to 1."""
    by_hand: Bool[np.ndarray, "T 137"] | None = None
    """Which were placed by a person; None: none."""
    depth: Float[np.ndarray, "T 137"] | None = None
    """Metres behind the pelvis along the camera's z, as stated by a person; NaN where not stated, None: nowhere.

    It does not need a confidence: it says where the part is that has this name, detected or not.
    """
    turn: Float[np.ndarray, "T 137 3"] | None = None
    """How the body's joint (see LOCKABLE, FINGER_JOINTS) is turned against its parent, as stated by a person:
    axis-angle, radians; NaN where not stated, None: nowhere. It is independent of the detection, and stays where sides
    are swapped back. That of fingers counts where all of a hand's are stated.
    """
    kept: tuple[KeptOffset, ...] = ()
    """Of the whole clip: a part of it has none. Presets without the lifter ignore them."""

    def __post_init__(self) -> None:
        assert self.xy.shape[1:] == (COUNT, 2) and self.confidence.shape == self.xy.shape[:2]
        assert np.isfinite(self.xy).all() and np.isfinite(self.confidence).all()
        assert self.by_hand is None or self.by_hand.shape == self.confidence.shape
        assert self.depth is None or self.depth.shape == self.confidence.shape
        assert self.turn is None or self.turn.shape == (*self.confidence.shape, 3)

    @property
    def placed(self) -> Bool[np.ndarray, "T 137"]:
        """`by_hand`, all False when None."""
        return np.zeros(self.confidence.shape, bool) if self.by_hand is None else self.by_hand

    @property
    def told_depth(self) -> Float[np.ndarray, "T 137"]:
        """`depth`, all NaN when None."""
        return np.full(self.confidence.shape, np.nan) if self.depth is None else self.depth

    @property
    def overruled(self) -> Bool[np.ndarray, "T 137"]:
        """Detections that do not count because a person stated the hand's shape: of fingers, beyond the knuckles.

        Wrist and knuckles tell how the hand is held, and still count.
        """
        found = np.zeros(self.confidence.shape, bool)
        if self.turn is not None:
            for side, joints in FINGER_JOINTS.items():
                stated = np.isfinite(self.turn[:, joints]).all((1, 2))
                found[np.ix_(np.flatnonzero(stated), _BEYOND_KNUCKLES[side])] = True
        return found

    def __len__(self) -> int:
        return len(self.xy)

    def corrected(self, frame: int, points: Mapping[str, tuple[float, float] | None]) -> "Keypoints":
        """See `Clip.corrected`."""
        xy, confidence, by_hand = self.xy.copy(), self.confidence.copy(), self.placed.copy()
        depth = self.told_depth.copy()
        for name, point in points.items():
            if name not in INDEX:
                near = ", ".join(get_close_matches(name, NAMES)) or "such as right_wrist"
                raise InputError(f"There is no keypoint {name!r}; expected one of keypoints.NAMES: {near}.")
            if point is not None and not (len(point) == 2 and np.isfinite(point).all()):
                raise InputError(f"{name} is put at {point}; expected x and y in pixels, or None.")
            k = INDEX[name]
            xy[frame, k] = xy[frame, k] if point is None else point
            confidence[frame, k], by_hand[frame, k] = float(point is not None), point is not None
            depth[frame, k] = np.nan if point is None else depth[frame, k]
        known = {} if self.depth is None else {"depth": depth}
        return replace(self, xy=xy, confidence=confidence, by_hand=by_hand, **known)

    def __getitem__(self, frames: slice | Int[np.ndarray, "n"]) -> "Keypoints":
        known = {name: array[frames] for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        return replace(self, kept=(), **known)
