"""Malformed references of fits."""

import numpy as np

from fitting_core.measure.references.files import read_reference
from tests.fitting_core.io.malformed import PICKLE_BOMB, Case, content, directory, endless_npz, npz, zip_bomb

_NAMES = np.array(["LShoulder", "RShoulder", "LHip", "RHip"])
_POINTS = np.zeros((3, 4, 3))


def reference(data: bytes | str, says: str, name: str = "reference.npz") -> Case:
    """A broken file that is to be a reference."""
    return Case(content(name, data), read_reference, says)


def trc(
    says: str, *, rate: str = "25", unit: str = "m", markers: str = "4", row: str = "1\t0.0" + "\t0.5" * 12
) -> Case:
    """A TRC file with one broken place."""
    lines = [
        "PathFileType\t4\t(X/Y/Z)\twalk.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"{rate}\t{rate}\t1\t{markers}\t{unit}",
        "Frame#\tTime\t" + "\t\t\t".join(_NAMES),
        "\t\t" + "\t".join(f"{axis}{i}" for i in range(1, 5) for axis in "XYZ"),
        row,
    ]
    return reference("\n".join(lines), says, "walk.trc")


def amass(says: str, **changed: np.ndarray) -> Case:
    """An AMASS-style npz with one broken array."""
    sound = {
        "poses": np.zeros((3, 165)),
        "trans": np.zeros((3, 3)),
        "betas": np.zeros(10),
        "gender": np.array("neutral"),
    }
    return reference(npz(**{**sound, "mocap_frame_rate": np.array(25.0), **changed}), says, "amass.npz")


REFERENCES: dict[str, Case] = {
    "reference empty": reference(b"", "is not an npz archive"),
    "reference a text": reference("points", "is not an npz archive"),
    "reference truncated": reference(npz(points=_POINTS, names=_NAMES)[:-60], "is not an npz archive"),
    "reference 8 TB": reference(endless_npz("points", "names"), "'points' declares the shape"),
    "reference zip bomb": reference(zip_bomb("points", "names"), "unpacks to 4.0 GB"),
    "reference pickled": reference(npz(points=np.array([{}]), names=_NAMES), "'points' is an array of Python objects"),
    "reference a pickle": reference(PICKLE_BOMB, "is not an npz archive"),
    "reference of nothing known": reference(npz(x=_POINTS), "holds x; expected"),
    "reference wrong counts": reference(npz(points=_POINTS, names=_NAMES[:3]), r"shape \(3, 4, 3\) and 3 names"),
    "reference flat points": reference(npz(points=_POINTS[0], names=_NAMES), r"shape \(4, 3\)"),
    "reference of words": reference(npz(points=np.array(["a"]), names=_NAMES), "damaged"),
    "reference unknown names": reference(npz(points=_POINTS, names=np.array(list("abcd"))), "names 0 known points"),
    "reference all NaN": reference(npz(points=_POINTS * np.nan, names=_NAMES), "no point|finite|no frame"),
    "reference from half a frame on": reference(
        npz(points=_POINTS, names=_NAMES, first_frame=0.5), "first_frame is 0.5; expected a whole number"
    ),
    "reference a folder": Case(directory("reference.npz"), read_reference, "folder without truth.npz"),
    "trc a text": reference("walk", "does not begin like such a file", "walk.trc"),
    "trc wrong encoding": reference("PathFileType".encode("utf-16"), "does not begin like such a file", "walk.trc"),
    "trc unit": trc("4 markers in furlong", unit="furlong"),
    "trc counts": trc("says 5 markers", markers="5"),
    "trc rate": trc("a rate above 0", rate="-25"),
    "trc rate NaN": trc("a rate above 0", rate="nan"),
    "trc rate infinite": trc("a rate above 0", rate="inf"),
    "trc word in a row": trc("line 6 cannot be read", row="1\t0.0\tx"),
    "trc huge numbers": trc("line 6 cannot be read|finite", row="1\t0.0" + "\t1e999" * 12),
    "trc time NaN": trc("line 6 cannot be read|finite", row="1\tnan" + "\t0.5" * 12),
    "trc no frames": trc("has no frames", row=" "),
    "amass 40 angles": amass("40", poses=np.zeros((3, 40))),
    "amass rate 0": amass("is 0, expected frames per second", mocap_frame_rate=np.array(0.0)),
    "amass NaN": amass("holds nan, expected finite", poses=np.full((3, 165), np.nan)),
    "amass short translation": amass("trans", trans=np.zeros((2, 3))),
}
"""By name."""
