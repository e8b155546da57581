"""OpenSim's text format for points, TRC: five header lines, then frame, time and x, y, z of each point, by tabs."""

from pathlib import Path

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.io.points.named_points import (
    MOST_POINTS,
    NamedPoints,
    check_names,
    read_world,
    stated_camera,
    without_subject,
)

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_MOST_BYTES = 512 * 2**20
"""An hour of 60 points at 120 per second takes 0.6 GB; more decimals are below measurement accuracy."""
_MOST_PLACES = 2**26
"""Markers of all frames together: 1.6 GB."""
_LATEST = 1e10
"""Seconds: times may be counted from 1970."""
_ROUNDED = 0.01
"""Seconds: some programs write times with two decimals."""
_CAMERA = "x_camera = R x + t, metres:"
"""In the first line, after the file's name, before R by rows and t. OpenSim reads only up to (X/Y/Z) there."""
_TRC = "a TRC file of OpenSim (five lines of header, then frame, time and x, y, z of each marker, by tabs)"


def write_trc(path: Path, points: NamedPoints) -> None:
    """Write points in millimetres; frames are numbered from 1, and the video's first one has time 0.

    The first line says where the camera stands, if known.

    Raises:
        OSError: It cannot be written; nothing is left of it.
    """
    first, rate = points.first_frame or 0, f"{points.frame_rate:.6f}"
    names, count = points.names, len(points)
    axes = "\t".join(f"{axis}{i}" for i in range(1, len(names) + 1) for axis in "XYZ")
    place = (
        "" if points.camera is None else f"\t{_CAMERA} " + " ".join(map("{:.9g}".format, stated_camera(points.camera)))
    )
    head = (
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}{place}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(names)}\tmm\t{rate}\t{first + 1}\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        f"\t\t{axes}",
        "",
    )
    with replacing(path) as draft, draft.open("w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        for t, places in enumerate(1e3 * points.places.reshape(count, -1)):
            cells = "\t".join("" if np.isnan(value) else f"{value:.3f}" for value in places)
            file.write(f"{first + t + 1}\t{(first + t) / points.frame_rate:.6f}\t{cells}\n")


def read_trc(path: Path) -> NamedPoints:
    """Read points. Cells without a number, and points at exactly 0, 0, 0, were not seen. Raises InputError if it is not
    a TRC file, or its lines or times do not fit its header."""
    try:
        # The first line may name a folder in any encoding. Known marker names are ASCII.
        text = regular_file(path, most=_MOST_BYTES).read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error}); expected {_TRC}.") from error
    lines = text.splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path}: does not begin like such a file; expected {_TRC}.")
    keys, values = ([cell.strip() for cell in line.split("\t")] for line in lines[1:3])
    header = dict(zip(keys, values, strict=False))
    names = without_subject([name.strip() for name in lines[3].split("\t")[2:] if name.strip()])
    unit = header.get("Units", "").lower()
    try:
        rate, declared = float(header["DataRate"]), int(header["NumMarkers"])
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: its second and third lines do not give a rate and a number of markers ({error}); expected {_TRC}."
        ) from error
    if unit not in _UNITS or not 0 < rate < np.inf or declared != len(names) or declared > MOST_POINTS:
        raise InputError(
            f"{path}: says {declared} markers in {unit or 'no unit'} at {rate:g} per second, and names {len(names)}; "
            f"expected as many names, up to {MOST_POINTS}, mm, cm or m, and a rate above 0."
        )
    check_names(path, names)
    rows = [(number, line) for number, line in enumerate(lines[5:], 6) if line.strip()]
    if not 0 < len(rows) <= _MOST_PLACES / max(1, declared):
        raise InputError(f"{path}: has {len(rows) or 'no'} frames of {declared} markers; expected {_TRC}.")
    times, places = _rows(path, rows, len(names))
    _check_times(path, times, rate)
    places[(places == 0).all(-1)] = np.nan
    stated = header.get("NumFrames", "")
    cut = stated.isdecimal() and int(stated) != len(rows)
    return NamedPoints(
        names=names,
        places=_UNITS[unit] * places,
        frame_rate=rate,
        # Programs that trim a trial often restart its time at 0.
        first_frame=round(times[0] * rate) or None,
        camera=read_world(path, lines[0].partition(_CAMERA)[2].split()),
        notes=(f"Its header says {stated[:20]} frames; it has {len(rows)}.",) if cut else (),
    )


def _rows(path: Path, rows: list[tuple[int, str]], markers: int) -> tuple[list[float], np.ndarray]:
    times, points = [], np.full((len(rows), 3 * markers), np.nan)
    for i, (number, line) in enumerate(rows):
        cells = [cell.strip() for cell in line.split("\t")]
        values = cells[2 : 2 + 3 * markers]
        try:
            times.append(float(cells[1]))
            points[i, : len(values)] = [float(value) if value else np.nan for value in values]
            if not abs(times[-1]) < _LATEST or np.isinf(points[i]).any():
                raise ValueError("a time or place is infinite or not a number")
            if any(cells[2 + 3 * markers :]):
                raise ValueError(f"it has more than {3 * markers} numbers after its time")
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}: line {number} cannot be read ({error}); expected {_TRC}.") from error
    return times, points.reshape(len(rows), markers, 3)


def _check_times(path: Path, times: list[float], rate: float) -> None:
    """Raises InputError where frame times disagree with the stated rate: it is wrong, or frames were left out."""
    lasted, expected = times[-1] - times[0], (len(times) - 1) / rate
    if abs(lasted - expected) > 0.01 * expected + max(1 / rate, _ROUNDED):
        raise InputError(
            f"{path}: its {len(times)} frames go from {times[0]:g} to {times[-1]:g} s, and at the {rate:g} per second "
            f"of its header they would last {expected:.4g} s; expected the same. Correct the header's DataRate, or "
            "add the missing frames with empty cells."
        )
