"""References of points alone: npz with `points` and `names`, and OpenSim's TRC."""

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.measure.references.reference import Reference, stated_first_frame, stated_rate
from fitting_core.synthetic.studio.world_camera import WorldCamera

FEWEST = 4
"""Known points without which nothing can be aligned."""
_SIDED = "shoulder elbow wrist hip knee ankle eye ear bigtoe smalltoe heel".split()
_MIDDLE = {"nose": "nose", "neck": "neck", "midhip": "mid_hip", "chip": "mid_hip", "hip": "mid_hip"}
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_LIMBS = {
    ("shoulder", "hip"): 0.50,
    ("hip", "knee"): 0.43,
    ("knee", "ankle"): 0.41,
    ("shoulder", "elbow"): 0.30,
    ("elbow", "wrist"): 0.26,
}
"""Metres between joints of an adult."""
_GROWN = (0.25, 2.0)
"""Shares of these that the limbs of people and their measurement may have: infants' are a quarter, feet make 3.3."""
_MISTAKEN = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "feet": 3.281}
FARTHEST = 300.0
"""Metres from the camera at which nobody is filmed: a camera's place in mm or cm puts people there."""
_TRC = "a TRC file of OpenSim (five lines of header, then frame, time and x, y, z of each marker, by tabs)"


def keypoint_named(name: str) -> int | None:
    """The keypoint of a marker's name, None if it is none: RShoulder, right_shoulder and R-Shoulder are one."""
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    if plain in _MIDDLE:
        return kp.INDEX[_MIDDLE[plain]]
    known = {re.sub(r"[^a-z0-9]", "", own): index for own, index in kp.INDEX.items()}
    for side in ("right", "left"):
        known |= {side[0] + part: known[side + part] for part in _SIDED}
    return known.get(plain)


def in_places(
    path: Path, points: Float[np.ndarray, "T n 3"], names: Sequence[str]
) -> tuple[Float[np.ndarray, "T 137 3"], tuple[str, ...]]:
    """Named points in the places of the keypoints, and what is to be said about those that have none.

    Raises:
        InputError: Too few names are known, or one stands for a keypoint that another one is.
    """
    placed = np.full((len(points), kp.COUNT, 3), np.nan)
    owner: dict[int, str] = {}
    for i, name in enumerate(names):
        index = keypoint_named(name)
        if index is None:
            continue
        if index in owner:
            raise InputError(f"{path}: {owner[index]} and {name} are both {kp.NAMES[index]}. Leave one of them out.")
        owner[index], placed[:, index] = name, points[:, i]
    if len(owner) < FEWEST:
        raise InputError(
            f"{path}: names {len(owner)} known points ({', '.join(names[:8])}); expected at least {FEWEST} of "
            "OpenPose's, such as RShoulder or right_shoulder. Rename its points."
        )
    unknown = [name for name in names if name not in owner.values()]
    return placed, (f"not used, as no keypoint has its name: {', '.join(unknown)}",) if unknown else ()


def read_points(path: Path, arrays: dict[str, np.ndarray], camera: WorldCamera | None) -> Reference:
    """The npz form: `points` (T, n, 3) in metres, `names` (n), and `fps` and `first_frame` if they are known.

    Raises:
        InputError: It does not hold these.
    """
    points, names = np.asarray(arrays["points"], np.float64), [str(name) for name in arrays["names"]]
    if points.ndim != 3 or points.shape[1:] != (len(names), 3) or not len(points):
        raise InputError(
            f"{path}: has points of the shape {points.shape} and {len(names)} names; expected (frames, names, 3)."
        )
    rate = stated_rate(path, arrays, ("fps", "frame_rate"))
    return _reference(path, "3D points", points, names, camera, rate, stated_first_frame(path, arrays))


def read_trc(path: Path, camera: WorldCamera | None) -> Reference:
    """OpenSim's text format.

    Raises:
        InputError: It is no such file, or a line of it has another form than the header says.
    """
    try:
        lines = regular_file(path).read_text(encoding="utf-8", errors="strict").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected {_TRC}.") from error
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path}: does not begin as such files do; expected {_TRC}.")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    names = [name.strip() for name in lines[3].split("\t")[2:] if name.strip()]
    unit = header.get("Units", "").strip()
    try:
        rate, declared = float(header["DataRate"]), int(header["NumMarkers"])
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: its second and third line give no {error}; expected {_TRC}.") from error
    if unit not in _UNITS or not 0 < rate < np.inf or declared != len(names):
        raise InputError(
            f"{path}: says {declared} markers in {unit or 'no unit'} at {rate:g} per second, and names {len(names)}; "
            "expected as many names, mm, cm or m, and a rate above 0."
        )
    rows = [(5 + i, line.split("\t")) for i, line in enumerate(lines[5:], 1) if line.strip()]
    times, points = _rows(path, rows, len(names))
    # Programs that cut a trial begin it at 0 again as often as not.
    first = round(times[0] * rate) or None
    return _reference(path, "OpenSim TRC", _UNITS[unit] * points, names, camera, rate, first)


def _rows(path: Path, rows: list[tuple[int, list[str]]], markers: int) -> tuple[list[float], np.ndarray]:
    times, points = [], np.full((len(rows), 3 * markers), np.nan)
    for i, (number, cells) in enumerate(rows):
        values = [cell.strip() for cell in cells[2 : 2 + 3 * markers]]
        try:
            times.append(float(cells[1]))
            points[i, : len(values)] = [float(value) if value else np.nan for value in values]
            if not np.isfinite(times[-1]) or np.isinf(points[i]).any():
                raise ValueError("a time or place is infinite or no number")
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}: line {number} cannot be read ({error}); expected {_TRC}.") from error
    if not rows:
        raise InputError(f"{path}: has no frames; expected {_TRC}.")
    return times, points.reshape(len(rows), markers, 3)


def _reference(
    path: Path,
    kind: str,
    points: np.ndarray,
    names: Sequence[str],
    camera: WorldCamera | None,
    rate: float | None,
    first_frame: int | None,
) -> Reference:
    placed, notes = in_places(path, points, names)
    if not np.isfinite(placed).any():
        raise InputError(f"{path}: has no finite point in any frame; expected places in metres, NaN where unknown.")
    _check_metres(path, placed)
    if camera is not None:
        placed = camera(placed)
        if np.nanmedian(placed[..., 2]) <= 0:
            raise InputError(
                f"{path}: lies behind the camera; expected points in the world of --camera's R and t. Files for "
                "OpenSim often have y up where a calibration has z up: exchange the axes in one of them."
            )
        if np.nanmedian(placed[..., 2]) > FARTHEST:
            raise InputError(
                f"{path}: lies {np.nanmedian(placed[..., 2]):.0f} m in front of the camera; expected less than "
                f"{FARTHEST:g} m. Give t of --camera in metres."
            )
    return Reference(
        name=path.name,
        kind=kind,
        frame_rate=rate,
        first_frame=first_frame or 0,
        first_frame_known=first_frame is not None,
        in_camera=camera is not None,
        points=placed,
        notes=notes,
    )


def _check_metres(path: Path, placed: Float[np.ndarray, "T 137 3"]) -> None:
    """Raises InputError for limbs that no person has; where no limb has both its ends, nothing can be told."""
    found = _limb_lengths(placed)
    share = float(np.median([length / _LIMBS[limb] for (limb, _), length in found.items()])) if found else 1.0
    if _GROWN[0] <= share <= _GROWN[1]:
        return
    (((start, end), side), length), *_ = found.items()
    unit = next((name for name, factor in _MISTAKEN.items() if 0.5 < share / factor < 1.5), None)
    advice = f"They look like {unit}: divide them by {_MISTAKEN[unit]:g}." if unit else "Scale the points to metres."
    raise InputError(
        f"{path}: {side}_{start} and {side}_{end} are {length:.3g} m apart; expected metres (in a TRC file, the unit "
        f"that its header says), in which these are some {_LIMBS[start, end]:g} m apart. {advice}"
    )


def _limb_lengths(placed: Float[np.ndarray, "T 137 3"]) -> dict[tuple[tuple[str, str], str], float]:
    """Medians over the frames, by limb and side, of those that are known in any."""
    found = {}
    for limb, side in product(_LIMBS, ("left", "right")):
        start, end = (placed[:, kp.INDEX[f"{side}_{joint}"]] for joint in limb)
        lengths = np.linalg.norm(end - start, axis=-1)
        if np.isfinite(lengths).any():
            found[limb, side] = float(np.nanmedian(lengths))
    return found
