"""Sets of markers: by name a vertex, a marker of the standard set or a joint, and where they are on a posed body."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, Int

from fitting_core.body.markers.joint_centres import CENTRES, joint_centres_in_space
from fitting_core.body.markers.places import PLACES, standard_vertices
from fitting_core.body.mesh import Mesh, shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError

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
