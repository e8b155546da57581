"""OpenSim's text format for points, TRC: five lines of header, then frame, time and x, y, z of each point, by tabs."""

from pathlib import Path

import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.io.points.named_points import NamedPoints, check_names

_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_MOST_BYTES = 512 * 2**20
"""An hour of 60 points at 120 per second has 0.6 GB with more digits than anyone measures."""
_TRC = "a TRC file of OpenSim (five lines of header, then frame, time and x, y, z of each marker, by tabs)"


def write_trc(path: Path, points: NamedPoints) -> None:
    """Write points in millimetres; frames are numbered from 1, and the video's first one has the time 0.

    Raises:
        OSError: It cannot be written.
    """
    first, rate = points.first_frame or 0, f"{points.frame_rate:.6f}"
    names, count = points.names, len(points)
    axes = "\t".join(f"{axis}{i}" for i in range(1, len(names) + 1) for axis in "XYZ")
    head = (
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(names)}\tmm\t{rate}\t{first + 1}\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        f"\t\t{axes}",
        "",
    )
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        for t, places in enumerate(1e3 * points.places.reshape(count, -1)):
            cells = "\t".join("" if np.isnan(value) else f"{value:.3f}" for value in places)
            file.write(f"{first + t + 1}\t{(first + t) / points.frame_rate:.6f}\t{cells}\n")


def read_trc(path: Path) -> NamedPoints:
    """Read points. Cells without a number, and points at exactly 0, 0, 0, were not seen.

    Raises:
        InputError: It is no such file, or a line of it has another form than the header says.
    """
    try:
        lines = regular_file(path, most=_MOST_BYTES).read_text(encoding="utf-8", errors="strict").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected {_TRC}.") from error
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{path}: does not begin as such files do; expected {_TRC}.")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    names = tuple(name.strip() for name in lines[3].split("\t")[2:] if name.strip())
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
    check_names(path, names)
    rows = [(5 + i, line.split("\t")) for i, line in enumerate(lines[5:], 1) if line.strip()]
    times, places = _rows(path, rows, len(names))
    places[(places == 0).all(-1)] = np.nan
    stated = header.get("NumFrames", "").strip()
    cut = stated.isdecimal() and int(stated) != len(rows)
    return NamedPoints(
        names=names,
        places=_UNITS[unit] * places,
        frame_rate=rate,
        # Programs that cut a trial begin it at 0 again as often as not.
        first_frame=round(times[0] * rate) or None,
        notes=(f"Its header says {stated[:20]} frames; it has {len(rows)}.",) if cut else (),
    )


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
