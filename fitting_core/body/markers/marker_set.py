"""Sets of markers: by name a vertex, a marker of the standard set or a joint, and where they are on a posed body."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from jaxtyping import Float, Int

from fitting_core.body.markers.joint_centres import CENTRES, joint_centres_in_space
from fitting_core.body.markers.places import PLACES, standard_vertices
from fitting_core.body.mesh import Mesh, shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError
from fitting_core.files.regular import parsed_toml, regular_file

RADIUS = 0.007
"""Metres from the skin to the middle of a marker: the usual ones are balls of 14 mm."""
_CHUNK = 16
"""Frames whose meshes are in memory at once."""
Target = int | str
"""The place of a marker: the number of a vertex, or one of NAMED."""
NAMED = (*PLACES, *CENTRES, *JOINT)
"""Markers of the standard set, anatomical joint centres, and SMPL-X's joints."""


@dataclass(frozen=True)
class MarkerSet:
    """Markers by their names."""

    targets: Mapping[str, Target] = field(default_factory=lambda: {name: name for name in PLACES})
    radius: float = RADIUS
    """Metres; joints and their centres have none."""

    def __post_init__(self) -> None:
        assert all(isinstance(on, int) or on in NAMED for on in self.targets.values())

    def __len__(self) -> int:
        return len(self.targets)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the markers, in their order."""
        return tuple(self.targets)

    def only(self, names: tuple[str, ...]) -> "MarkerSet":
        """Some of them, in this order."""
        return MarkerSet({name: self.targets[name] for name in names}, self.radius)


STANDARD = MarkerSet()


def marker_places(body: BodyModel, params: BodyParams, markers: MarkerSet) -> Float[np.ndarray, "T M 3"]:
    """Where the middles of the markers are on posed bodies, metres, in the world of the parameters.

    A marker sits on its vertex, off the skin by its radius along the vertex's normal, the mean of the triangles around.

    Raises:
        InputError: A vertex's number is higher than the body has any.
    """
    inside = {name: k for k, name in enumerate((*CENTRES, *JOINT))}
    joints = {i: inside[on] for i, on in enumerate(markers.targets.values()) if isinstance(on, str) and on in inside}
    on_skin = {i: _vertex(body, name, on) for i, (name, on) in enumerate(markers.targets.items()) if i not in joints}
    found = np.zeros((len(params), len(markers), 3))
    mesh = shared_mesh(body)
    if joints:
        places = np.concatenate([joint_centres_in_space(body, params), mesh.joints(params).numpy()], 1)
        found[:, list(joints)] = places[:, list(joints.values())]
    if on_skin:
        skin = _Skin(body, np.array(list(on_skin.values())))
        for start in range(0, len(params), _CHUNK):
            frames = slice(start, start + _CHUNK)
            found[frames, list(on_skin)] = skin.places(mesh, params[frames], markers.radius)
    return found


def _vertex(body: BodyModel, name: str, on: Target) -> int:
    number = standard_vertices(body)[on] if isinstance(on, str) else on
    if number >= len(body.template):
        raise InputError(
            f"The marker {name} sits on the vertex {number}, and the {body.gender} {body.kind} body has "
            f"{len(body.template)} vertices, counted from 0. Take numbers of this body's mesh."
        )
    return number


class _Skin:
    """Vertices of a body with the triangles around them."""

    def __init__(self, body: BodyModel, vertices: Int[np.ndarray, "M"]) -> None:
        self._vertices = torch.as_tensor(vertices)
        place, face = np.nonzero((body.faces[None] == vertices[:, None, None]).any(-1))
        self._corners = torch.as_tensor(body.faces[face].astype(np.int64))
        self._owner = torch.as_tensor(place)

    def places(self, mesh: Mesh, params: BodyParams, radius: float) -> Float[np.ndarray, "B M 3"]:
        """Off the skin by the radius."""
        vertices = mesh(params).double()
        a, b, c = (vertices[:, self._corners[:, i]] for i in range(3))
        areas = torch.linalg.cross(b - a, c - a)
        normals = areas.new_zeros(len(vertices), len(self._vertices), 3).index_add_(1, self._owner, areas)
        length = normals.norm(dim=-1, keepdim=True).clamp_min(1e-12)
        return (vertices[:, self._vertices] + radius * normals / length).numpy()


_MOST_BYTES, _MOST_MARKERS, _LONGEST = 2**20, 200, 60
_FARTHEST = 100.0
"""Millimetres."""
_FORM = 'a TOML or JSON file with a table "markers" of names and vertices, such as LKNE = 8123'


def read_marker_set(path: Path) -> MarkerSet:
    """A user's own set of markers, a small TOML or JSON file:

        radius = 7                # millimetres from the skin to the marker's middle; 7 without this line

        [markers]
        LKNE = 8123               # a vertex of the body's mesh, counted from 0
        LeftAnkle = "LANK"        # a marker of the standard set by another name
        Knee = "LKJC"             # an anatomical joint centre, or "left_knee", SMPL-X's joint

    JSON has the same keys: {"radius": 7, "markers": {"LKNE": 8123}}. Raises InputError if it cannot be read, or is not
    a set of markers.
    """
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
