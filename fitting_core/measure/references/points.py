"""References of points alone, by the names that keypoints, markers and joints have: npz, TRC and C3D."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.markers.joint_centres import CENTRES
from fitting_core.body.markers.marker_set import RADIUS, MarkerSet, Target
from fitting_core.body.markers.places import PLACES
from fitting_core.body.model import JOINT
from fitting_core.errors import InputError, some_of
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.keypoints import SIDES
from fitting_core.measure.references.reference import Reference, stated_first_frame, stated_rate
from fitting_core.world_camera import WorldCamera

FEWEST = 4
"""Known points without which nothing can be aligned."""
_SIDED = "shoulder elbow wrist hip knee ankle eye ear bigtoe smalltoe heel".split()
_MIDDLE = {"nose": "nose", "neck": "neck", "midhip": "mid_hip", "chip": "mid_hip", "hip": "mid_hip"}
_LIMBS = {
    ("shoulder", "hip"): 0.50,
    ("hip", "knee"): 0.43,
    ("knee", "ankle"): 0.41,
    ("shoulder", "elbow"): 0.30,
    ("elbow", "wrist"): 0.26,
}
"""Metres between joints of an adult."""
_SPINE = {"pelvis", "spine1", "spine2", "spine3"}
"""Beside these, left_hip and others are SMPL-X's joints, which lie centimetres from the keypoints of the same names."""
_NEAR = {"shoulder": "SHO", "hip": "ASI", "knee": "KNE", "ankle": "ANK", "elbow": "ELB", "wrist": "WRA"}
"""The marker that is near a limb's end."""
_GROWN = (0.25, 2.0)
"""Shares of these that the limbs of people and their measurement may have: infants' are a quarter, feet make 3.3."""
_MISTAKEN = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "feet": 3.281}
_UNEVEN = 0.05
"""Of a frame's time, by which frames may be longer than others: files round their times."""
_ALONG = 0.8
"""Cosine to an axis along which a trunk is."""
FARTHEST = 300.0
"""Implausible distance from the camera, metres: a camera position in mm or cm puts people there."""


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_KEYPOINTS = {_plain(own): index for own, index in kp.INDEX.items()}
_KEYPOINTS |= {side[0] + part: _KEYPOINTS[side + part] for side in SIDES for part in _SIDED}
_KEYPOINTS |= {name: kp.INDEX[own] for name, own in _MIDDLE.items()}


def keypoint_named(name: str) -> int | None:
    """The keypoint of a marker's name, None if it names none: RShoulder, right_shoulder and R-Shoulder are one."""
    return _KEYPOINTS.get(_plain(name))


def matched(
    path: Path, points: NamedPoints, own: MarkerSet | None = None
) -> tuple[Float[np.ndarray, "T 137 3"], MarkerSet, Float[np.ndarray, "T M 3"], tuple[str, ...]]:
    """Named points in the places of the keypoints, those that are markers or joints, and what is to be said of others.
    Raises InputError if too few names are known, or one stands for a keypoint that another one is.

    Args:
        path: For messages.
        points: By names of OpenPose's keypoints, of markers of the standard set, or of SMPL-X's joints if those of the
            spine are there.
        own: The user's names, which go before these.
    """
    placed = np.full((len(points), kp.COUNT, 3), np.nan)
    owner: dict[int, str] = {}
    targets: dict[str, Target] = {}
    own_targets = {} if own is None else own.targets
    of_body = set(points.names) >= _SPINE
    for i, name in enumerate(points.names):
        index = keypoint_named(name)
        if name in own_targets:
            targets[name] = own_targets[name]
        elif of_body and name in JOINT:
            targets[name] = name
        elif index is not None:
            if index in owner:
                raise InputError(
                    f"{path}: {owner[index]} and {name} are both {kp.NAMES[index]}. Leave one of them out."
                )
            owner[index], placed[:, index] = name, points.places[:, i]
        elif (target := _plain(name).upper()) in PLACES or target in CENTRES:
            targets[name] = target
    if (count := len(owner) + len(targets)) < FEWEST:
        raise InputError(
            f"{path}: names {count} known points ({some_of(points.names)}); expected at least {FEWEST} of "
            "OpenPose's, such as RShoulder or right_shoulder, of the markers of Plug-in Gait, such as LKNE, of joint "
            "centres, such as LKJC, or of SMPL-X's joints. Rename its points, or say with --markers what they are."
        )
    unknown = [name for name in points.names if name not in owner.values() and name not in targets]
    notes = (f"Not used, as no keypoint or marker has this name: {some_of(unknown, most=20)}.",) if unknown else ()
    places = points.places[:, [points.names.index(name) for name in targets]]
    return placed, MarkerSet(targets, RADIUS if own is None else own.radius), places, notes


def read_points(path: Path, arrays: dict[str, np.ndarray], camera: WorldCamera | None) -> Reference:
    """The npz form: `points` (T, n, 3) in metres, `names` (n), and `fps` and `first_frame` if they are known.

    `time` (T), seconds of the video, says both. Further arrays of the shape of `points` are other systems' results.

    Raises:
        InputError: It does not hold these.
    """
    points, names = np.asarray(arrays["points"], np.float64), [str(name) for name in arrays["names"]]
    if points.ndim != 3 or points.shape[1:] != (len(names), 3) or not len(points):
        raise InputError(
            f"{path}: has points of the shape {points.shape} and {len(names)} names; expected (frames, names, 3)."
        )
    rate, first = stated_rate(path, arrays, ("fps", "frame_rate")), stated_first_frame(path, arrays)
    if "time" in arrays:
        rate, first = _clock(path, np.asarray(arrays["time"], float), len(points))
    named = NamedPoints(names=tuple(names), places=points, frame_rate=rate or 0.0, first_frame=first)
    found = reference_of_points(path, "3D points", named, camera)
    others = {name: array for name, array in arrays.items() if name != "points" and array.shape == points.shape}
    placed = {name: matched(path, replace(named, places=array.astype(float)))[0] for name, array in others.items()}
    return replace(found, others=placed)


def _clock(path: Path, seconds: np.ndarray, count: int) -> tuple[float, int]:
    """Frames per second, and the number of the first frame, of frames at these moments. Raises InputError if they are
    not as many as the frames, or not evenly spaced."""
    steps = np.diff(seconds)
    if seconds.shape != (count,) or count < 2 or not (steps > 0).all() or np.ptp(steps) > _UNEVEN * steps.mean():
        raise InputError(
            f"{path}: its time has the shape {seconds.shape} or is not evenly spaced; expected a second of the video "
            f"for each of {count} frames, at one rate. Say fps and first_frame in its place."
        )
    rate = (count - 1) / (seconds[-1] - seconds[0])
    return float(rate), round(seconds[0] * rate)


def reference_of_points(
    path: Path, kind: str, points: NamedPoints, camera: WorldCamera | None, markers: MarkerSet | None = None
) -> Reference:
    """A reference of points alone. Raises InputError if too few of them have known names, or they are not in metres or
    not before the camera.

    Args:
        path: Where they were read.
        kind: Of file, in words.
        points: In the file's world; a frame rate of 0 is not known.
        camera: Where the clip's camera stands in that; None: where the file says, if it does.
        markers: What the user says that points are.
    """
    placed, known, places, notes = matched(path, points, markers)
    if not np.isfinite(placed).any() and not np.isfinite(places).any():
        raise InputError(f"{path}: has no finite point in any frame; expected places in metres, NaN where unknown.")
    _check_metres(path, placed, known, places)
    if camera is None and points.camera is not None:
        camera = WorldCamera.of(points.camera)
        notes = (*notes, "It stands before the camera as its file says, which tcfit wrote.")
    if camera is not None:
        placed, places = camera(placed), camera(places)
        _check_before(path, np.concatenate([placed, places], 1)[..., 2])
    return Reference(
        name=path.name,
        kind=kind,
        frame_rate=points.frame_rate or None,
        first_frame=points.first_frame or 0,
        first_frame_known=points.first_frame is not None,
        in_camera=camera is not None,
        points=placed,
        markers=known if len(known) else None,
        marker_places=places if len(known) else None,
        notes=(*points.notes, *notes),
    )


def _check_before(path: Path, depth: np.ndarray) -> None:
    """Raises InputError for points behind the camera, or farther off than anybody is filmed."""
    if np.nanmedian(depth) <= 0:
        raise InputError(
            f"{path}: lies behind the camera; expected points in the world of --camera's R and t. Files for "
            "OpenSim often have y up where a calibration has z up: exchange the axes in one of them."
        )
    if np.nanmedian(depth) > FARTHEST:
        raise InputError(
            f"{path}: lies {np.nanmedian(depth):.0f} m in front of the camera; expected less than "
            f"{FARTHEST:g} m. Give t of --camera in metres."
        )


def trunk_axis(found: Reference) -> Float[np.ndarray, "3"] | None:
    """The way from the hips to the shoulders, as a unit vector along y or z; None if it is along neither.

    No program has x up, and along it people lie.
    """
    markers = found.markers or MarkerSet({}, RADIUS)
    places = np.zeros((len(found), 0, 3)) if found.marker_places is None else found.marker_places
    ends = _ends(found.points, markers, places)
    ways = np.concatenate([ends[f"{side}_shoulder"] - ends[f"{side}_hip"] for side in SIDES])
    ways = ways[np.isfinite(ways).all(1) & ways.any(1)]
    if not len(ways):
        return None
    way = np.median(ways / np.linalg.norm(ways, axis=1, keepdims=True), axis=0)
    axis = np.array([0, abs(way[1]) > _ALONG, abs(way[2]) > _ALONG]) * np.sign(way)
    return axis if axis.any() else None


def _check_metres(
    path: Path, placed: Float[np.ndarray, "T 137 3"], markers: MarkerSet, places: Float[np.ndarray, "T M 3"]
) -> None:
    """Raises InputError for implausible limb lengths; limbs without both ends are not checked."""
    found = _limb_lengths(_ends(placed, markers, places))
    share = float(np.median([length / _LIMBS[limb] for (limb, _), length in found.items()])) if found else 1.0
    if _GROWN[0] <= share <= _GROWN[1]:
        return
    (((start, end), side), length), *_ = found.items()
    unit = next((name for name, factor in _MISTAKEN.items() if 0.5 < share / factor < 1.5), None)
    advice = f"They look like {unit}: divide them by {_MISTAKEN[unit]:g}." if unit else "Scale the points to metres."
    raise InputError(
        f"{path}: {side}_{start} and {side}_{end} are {length:.3g} m apart; expected metres (in a TRC or C3D file, the "
        f"unit that it says), in which these are some {_LIMBS[start, end]:g} m apart. {advice}"
    )


def _ends(
    placed: Float[np.ndarray, "T 137 3"], markers: MarkerSet, places: Float[np.ndarray, "T M 3"]
) -> dict[str, Float[np.ndarray, "T 3"]]:
    """Of limbs, such as left_knee, by keypoint, joint, joint centre, or the marker that is near."""
    found = {}
    for centre, end in CENTRES.items():
        marker = centre[0] + _NEAR[end.split("_")[1]]
        names = [i for i, on in enumerate(markers.targets.values()) if on in (centre, end, marker)]
        found[end] = places[:, names[0]] if names else placed[:, kp.INDEX[end]]
    return found


def _limb_lengths(ends: dict[str, Float[np.ndarray, "T 3"]]) -> dict[tuple[tuple[str, str], str], float]:
    """Medians over the frames, by limb and side, of those that are known in any."""
    found = {}
    for limb, side in product(_LIMBS, SIDES):
        start, end = (ends[f"{side}_{part}"] for part in limb)
        lengths = np.linalg.norm(end - start, axis=-1)
        if np.isfinite(lengths).any():
            found[limb, side] = float(np.nanmedian(lengths))
    return found
