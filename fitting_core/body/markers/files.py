"""A user's own set of markers, a small TOML or JSON file:

    radius = 7                # millimetres from the skin to the marker's middle; 7 without this line

    [markers]
    LKNE = 8123               # a vertex of the body's mesh, counted from 0
    LeftAnkle = "LANK"        # a marker of the standard set by another name
    Knee = "LKJC"             # an anatomical joint centre, or "left_knee", SMPL-X's joint

JSON has the same keys: {"radius": 7, "markers": {"LKNE": 8123}}.
"""

from pathlib import Path
from typing import Any

import msgspec

from fitting_core.body.markers.joint_centres import CENTRES
from fitting_core.body.markers.marker_set import NAMED, RADIUS, MarkerSet
from fitting_core.body.markers.places import PLACES
from fitting_core.errors import InputError
from fitting_core.files.regular import parsed_toml, regular_file

_MOST_BYTES, _MOST_MARKERS, _LONGEST = 2**20, 200, 60
_FARTHEST = 100.0
"""Millimetres."""
_FORM = 'a TOML or JSON file with a table "markers" of names and vertices, such as LKNE = 8123'


def read_marker_set(path: Path) -> MarkerSet:
    """Read a set of markers. Raises InputError if it cannot be read, or is not a set of markers."""
    content = _content(path)
    markers, radius = content.get("markers"), content.get("radius", 1e3 * RADIUS)
    if not isinstance(markers, dict) or not 0 < len(markers) <= _MOST_MARKERS:
        found = "none" if not isinstance(markers, dict) else str(len(markers))
        raise InputError(f'{path}: has {found} in "markers"; expected 1 to {_MOST_MARKERS}, in {_FORM}.')
    if others := sorted(set(content) - {"markers", "radius"}):
        raise InputError(f'{path}: has {others[0][:_LONGEST]!r}; expected "markers" and "radius" alone.')
    if isinstance(radius, bool) or not isinstance(radius, int | float) or not 0 <= radius <= _FARTHEST:
        raise InputError(f"{path}: its radius is {radius!r:.60}; expected millimetres, 0 to {_FARTHEST:g}.")
    for name, on in markers.items():
        _check(path, name, on)
    return MarkerSet(markers, radius / 1e3)


def _content(path: Path) -> dict[str, Any]:
    try:
        text = regular_file(path, most=_MOST_BYTES).read_text(encoding="utf-8-sig")
        found = msgspec.json.decode(text) if text.lstrip()[:1] == "{" else parsed_toml(text)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); expected {_FORM}.") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected {_FORM}.") from error
    assert isinstance(found, dict)
    return found


def _check(path: Path, name: str, on: Any) -> None:
    """Raises InputError for a marker that none can be."""
    if not name.isprintable() or not name.isascii() or not 0 < len(name.strip()) == len(name) <= _LONGEST:
        raise InputError(
            f"{path}: a marker is named {name[:_LONGEST]!r}; expected up to {_LONGEST} letters, digits and signs of "
            "ASCII without spaces around them, as TRC and C3D need."
        )
    if isinstance(on, int) and not isinstance(on, bool) and 0 <= on < 2**31:
        return
    if not isinstance(on, str) or on not in NAMED:
        raise InputError(
            f"{path}: the marker {name} sits on {on!r:.60}; expected a vertex's number, a joint such as left_knee, "
            f"a joint centre ({', '.join(CENTRES)}), or a marker of the standard set: {', '.join(PLACES)}."
        )
