"""UI-PRMD's Vicon markers as a skeleton: rehabilitation exercises of ten people.

A. Vakanski, H.-P. Jun, D. Paul and R. Baker, "A Data Set of Human Body Movements for Physical Rehabilitation
Exercises", Data 3(1), 2018. Markers are those of Plug-in Gait. Hip centres follow Harrington et al., "Prediction of the
hip joint centre in adults, children, and patients with cerebral palsy based on magnetic resonance imaging", J.
Biomechanics 40, 2007; centres of knees, ankles, shoulders and elbows lie beside their markers by usual half widths.
Trunk, head and feet have no rotation in each person's own standing pose.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.plausible import RANGES
from build_assets.motion_capture.rigs import SIDES
from build_assets.motion_capture.skeleton import Skeleton, SourceMotion
from fitting_core.body.geometry import frame, shortest_rotation, unit
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz

_FILE = "ui_prmd_vicon_33fps.npz"
_RATE = 100 / 3
_MARKERS = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN "
    "LASI RASI LPSI RPSI LTHI LKNE LTIB LANK LHEE LTOE RTHI RKNE RTIB RANK RHEE RTOE"
).split()
_MOVES = (
    "deep squat", "hurdle step", "inline lunge", "side lunge", "sit to stand", "standing active straight leg raise",
    "standing shoulder abduction", "standing shoulder extension", "standing shoulder internal-external rotation",
    "standing shoulder scaption",
)  # fmt: skip
_SITTING = "m05"
_EVERY = 3
"""Of the ten repetitions of an exercise every third is read: they are nearly alike."""
_JOINTS = ("root", "chest", "neck", *(f"{side}_{n}" for side in SIDES for n in ("hip", "knee", "ankle")),
           *(f"{side}_{n}" for side in SIDES for n in ("shoulder", "elbow", "wrist")))  # fmt: skip
_PARENTS = (-1, 0, 1, 0, 3, 4, 0, 6, 7, 1, 9, 10, 1, 12, 13)
_UPRIGHT = ("root", "chest", "neck", "left_ankle", "right_ankle")
"""What has no rotation in the standing pose; feet keep the way that they point."""
_KNEE, _ANKLE, _SHOULDER, _ELBOW = 0.052, 0.042, 0.05, 0.04
"""Metres from a marker to the middle of its joint."""
_ROUNDS = 3
"""Centres lie along the hinge, and the hinge follows from the centres."""
_BENT = (0.2, 0.5)
"""Sines of a limb's angle between which its own plane takes over from the trunk's as that of its hinge."""
_SHORTEST = 20
"""Frames of a repetition that is worth reading; one has a single frame."""
_STANDING = 4
"""First frames of an exercise, in which the person stands."""


class _Posed(NamedTuple):
    turns: dict[str, Float[np.ndarray, "T 3 3"]]
    """World rotations."""
    places: dict[str, Float[np.ndarray, "T 3"]]
    """Metres."""


def read_ui_prmd(folder: Path) -> Iterator[SourceMotion]:
    """Every third repetition of each exercise.

    Args:
        folder: Holds ui_prmd_vicon_33fps.npz: an array (T, 39, 3) in millimetres (x ahead, y left, z up) a repetition,
            by names such as s01_m01_e01 (person, exercise, repetition; i at the end: done wrong).

    Raises:
        InputError: It is missing or of another form.
    """
    try:
        arrays = read_npz(folder / _FILE)
    except (OSError, ValueError) as error:
        raise InputError(f"{folder / _FILE}: cannot be read ({error}). Copy it again.") from error
    people: dict[str, dict[str, np.ndarray]] = defaultdict(dict)
    for name, values in sorted(arrays.items()):
        if values.ndim != 3 or values.shape[1:] != (len(_MARKERS), 3) or not np.isfinite(values).all():
            raise InputError(
                f"{folder / _FILE}: {name} is {values.shape}, expected (T, {len(_MARKERS)}, 3) finite numbers."
            )
        if len(values) < _SHORTEST or (values == 0).all(2).any():  # a marker that was lost is at zero
            continue
        people[name.split("_")[0]][name] = values[..., [1, 2, 0]] / 1000.0  # x to the left, y up, z ahead
    for person, takes in people.items():
        right = [name for name in takes if not name.endswith("i") and _SITTING not in name]
        rest = _standing([_posed(takes[name][:_STANDING]) for name in right])
        for name, markers in takes.items():
            if int(name.split("_e")[1].rstrip("i")) % _EVERY == 1:
                yield _motion(name, person, _posed(markers), rest)


def _motion(name: str, person: str, posed: _Posed, rest: dict[str, np.ndarray]) -> SourceMotion:
    turns = {joint: turn @ rest[joint].T if joint in rest else turn for joint, turn in posed.turns.items()}
    offsets = np.zeros((len(_JOINTS), 3))
    for k, (joint, parent) in enumerate(zip(_JOINTS, _PARENTS, strict=True)):
        if joint in posed.places and parent >= 0 and _JOINTS[parent] in posed.places:
            bone = posed.places[joint] - posed.places[_JOINTS[parent]]
            offsets[k, 1] = -np.linalg.norm(bone, axis=1).mean()
    root = posed.places["root"]
    return SourceMotion(
        name=name,
        subject=f"prmd {person}",
        source="ui_prmd",
        fps=_RATE,
        description=_MOVES[int(name.split("_m")[1][:2]) - 1],
        skeleton=Skeleton(joints=_JOINTS, parents=np.array(_PARENTS), offsets=offsets),
        rotations=np.stack([turns[joint] for joint in _JOINTS], 1),
        positions=np.stack([posed.places.get(joint, root) for joint in _JOINTS], 1),
    )


def _standing(takes: Sequence[_Posed]) -> dict[str, Float[np.ndarray, "3 3"]]:
    """What a person's upright parts measure when they stand and face z."""
    found: dict[str, np.ndarray] = {}
    for joint in _UPRIGHT:
        turned = []
        for take in takes:
            ahead = take.turns["root"][..., 2].mean(0)
            facing = Rotation.from_euler("y", np.arctan2(ahead[0], ahead[2])).as_matrix()
            turned.append(facing.T @ take.turns[joint].mean(0))
        u, _, vt = np.linalg.svd(np.median(turned, 0))
        found[joint] = u @ vt
        if "ankle" in joint:
            y, z = found[joint][1, 2], np.hypot(found[joint][0, 2], found[joint][2, 2])
            found[joint] = Rotation.from_euler("x", -np.arctan2(y, z)).as_matrix()
    return found


def _posed(markers: Float[np.ndarray, "T 39 3"]) -> _Posed:
    """Axes of the parts (x to the left, y up, z ahead where somebody stands upright with hanging arms), and joints."""
    at = {name: markers[:, k] for k, name in enumerate(_MARKERS)}
    front, back = (at["LASI"] + at["RASI"]) / 2, (at["LPSI"] + at["RPSI"]) / 2
    left, ahead = at["LASI"] - at["RASI"], front - back
    pelvis = _axes(x=left, z=ahead)
    up = (at["C7"] + at["CLAV"] - at["T10"] - at["STRN"]) / 2
    chest = _axes(y=up, z=(at["CLAV"] + at["STRN"] - at["C7"] - at["T10"]) / 2)
    skull = (at["LFHD"] + at["LBHD"] - at["RFHD"] - at["RBHD"], at["LFHD"] + at["RFHD"] - at["LBHD"] - at["RBHD"])
    turns, places = {"root": pelvis, "chest": chest, "neck": _axes(z=skull[1], x=skull[0])}, {}
    width, depth = (float(np.linalg.norm(v, axis=1).mean()) for v in (left, ahead))
    for side, sign in SIDES.items():
        own = {name[1:]: place for name, place in at.items() if name[0] == side[0].upper()}
        inward = (sign * (0.33 * width + 0.0073), -0.30 * width - 0.0109, -0.24 * depth - 0.0099)
        hip = front + pelvis @ np.array(inward)
        leg = _leg(hip, own, pelvis, sign)
        arm = _arm(own, chest, sign)
        for part in (leg, arm):
            turns |= {f"{side}_{name}": turn for name, turn in part.turns.items()}
            places |= {f"{side}_{name}": place for name, place in part.places.items()}
    places["root"] = (places["left_hip"] + places["right_hip"]) / 2
    return _Posed(turns, places)


def _leg(hip: np.ndarray, at: dict[str, np.ndarray], pelvis: np.ndarray, sign: float) -> _Posed:
    def centres(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return at["KNE"] - sign * _KNEE * axis, at["ANK"] - sign * _ANKLE * axis

    axis = pelvis[..., 0]
    for _ in range(_ROUNDS):
        knee, ankle = centres(axis)
        axis = _hinge(knee - hip, ankle - knee, pelvis[..., 0])
    knee, ankle = centres(axis)
    shin = _axes(y=knee - ankle, x=axis)
    turns = {"hip": _axes(y=hip - knee, x=axis), "knee": shin, "ankle": _axes(z=at["TOE"] - at["HEE"], x=shin[..., 0])}
    return _Posed(turns, {"hip": hip, "knee": knee, "ankle": ankle})


def _arm(at: dict[str, np.ndarray], chest: np.ndarray, sign: float) -> _Posed:
    shoulder, wrist = at["SHO"] - _SHOULDER * chest[..., 1], (at["WRA"] + at["WRB"]) / 2
    usual = np.array(RANGES["shoulder"].axis) * (sign, 1, 1)
    hinge = shortest_rotation(np.array([0.0, -1.0, 0.0]), usual) @ (-1.0, 0.0, 0.0)  # -x of an arm that hangs
    axis, elbow = chest @ hinge, at["ELB"]
    for _ in range(_ROUNDS):
        bone = ((elbow - shoulder)[:, None] @ chest)[:, 0]
        unturned = chest @ shortest_rotation(np.broadcast_to(usual, bone.shape), bone) @ hinge
        axis = _hinge(elbow - shoulder, wrist - elbow, unturned)
        elbow = at["ELB"] + sign * _ELBOW * axis
    forearm = _axes(y=elbow - wrist, x=-axis)
    turns = {"shoulder": _axes(y=shoulder - elbow, x=-axis), "elbow": forearm, "wrist": forearm}
    return _Posed(turns, {"shoulder": shoulder, "elbow": elbow, "wrist": wrist})


def _hinge(upper: np.ndarray, lower: np.ndarray, usual: np.ndarray) -> Float[np.ndarray, "T 3"]:
    """The axis that a limb bends about: across its two bones, or the trunk's where it is nearly straight."""
    upper = unit(upper)
    across = np.cross(upper, unit(lower))
    bent = np.linalg.norm(across, axis=-1, keepdims=True)
    own = across / np.maximum(bent, 1e-9)
    usual = unit(usual - (usual * upper).sum(-1, keepdims=True) * upper)
    share = np.clip((bent - _BENT[0]) / (_BENT[1] - _BENT[0]), 0, 1)
    axis = share * own + (1 - share) * usual
    return unit(axis - (axis * upper).sum(-1, keepdims=True) * upper)


def _axes(**told: np.ndarray) -> Float[np.ndarray, "T 3 3"]:
    """Columns x, y, z: the first that is told as it is, the second made orthogonal to it."""
    (first, one), (second, other) = told.items()
    i, j = "xyz".index(first), "xyz".index(second)
    made = frame(one, other)
    k = 3 - i - j
    columns = np.empty_like(made)
    columns[..., i], columns[..., j] = made[..., 0], made[..., 1]
    columns[..., k] = made[..., 2] * (1 if (j - i) % 3 == 1 else -1)
    return columns
