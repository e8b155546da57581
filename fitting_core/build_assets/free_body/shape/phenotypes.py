"""MakeHuman's macro targets: body shape from gender, age, muscle, weight, height, proportions and breast.

Each target stands for one corner of that space, such as (female, young, maxmuscle, averageweight, minheight); its
coefficient is the product of how near a body is to each of those values.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from fitting_core.build_assets.free_body.makehuman import DataFolder

_ANCHORS = {
    "gender": ("male", "female"),
    "age": ("young", "old"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "maxheight"),
    "proportions": ("idealproportions", "uncommonproportions"),
    "cup": ("mincup", "averagecup", "maxcup"),
    "firmness": ("minfirmness", "averagefirmness", "maxfirmness"),
}
_ORIGINS = ("african", "asian", "caucasian")
_UNBOUNDED = ("weight",)  # the targets alone span only 63..76 l for a man of 1.76 m


@dataclass(frozen=True, kw_only=True, eq=False)
class Phenotype:
    """What MakeHuman's macro targets depend on, for n bodies; each in 0..1 (weight may go beyond)."""

    gender: Float[np.ndarray, "n"]
    """0 male, 1 female."""
    age: Float[np.ndarray, "n"]
    """0 young adult, 1 old."""
    muscle: Float[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    height: Float[np.ndarray, "n"]
    proportions: Float[np.ndarray, "n"]
    cup: Float[np.ndarray, "n"]
    firmness: Float[np.ndarray, "n"]
    origins: Float[np.ndarray, "n 3"]
    """Shares of MakeHuman's three sets of faces and builds; rows sum to 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MacroTargets:
    """The macro targets and the corner of the space of phenotypes that each stands for."""

    corners: list[tuple[str, ...]]
    offsets: Float[np.ndarray, "targets N 3"]

    def displace(self, phenotype: Phenotype) -> Float[np.ndarray, "n N 3"]:
        """How far bodies of these phenotypes are from the base mesh, in metres."""
        nearness = _nearness(phenotype)
        coefficients = [np.prod([nearness[anchor] for anchor in corner], axis=0) for corner in self.corners]
        return np.tensordot(np.stack(coefficients, axis=1), self.offsets, 1)


def read_macro_targets(folder: DataFolder) -> MacroTargets:
    """Reads every macro target of adults that the folder has."""
    found = {corner: name for corner, name in _macro_names() if folder.has_shape_target(name)}
    offsets = [folder.shape_target(name).astype(np.float32) for name in found.values()]
    return MacroTargets(corners=list(found), offsets=np.stack(offsets))


def _macro_names() -> list[tuple[tuple[str, ...], str]]:
    """Every corner that can have a target, with the target's name."""
    a = _ANCHORS
    names: list[tuple[tuple[str, ...], str]] = [
        ((origin, gender, age), f"macrodetails/{origin}-{gender}-{age}")
        for gender, age, origin in product(a["gender"], a["age"], _ORIGINS)
    ]
    for build in product(a["gender"], a["age"], a["muscle"], a["weight"]):
        stem = "-".join(build)
        names.append((build, f"macrodetails/universal-{stem}"))
        for folder in ("height", "proportions"):
            names += [((*build, value), f"macrodetails/{folder}/{stem}-{value}") for value in a[folder]]
        if build[0] == "female":
            breasts = product(a["cup"], a["firmness"])
            names += [((*build, cup, firm), f"breast/{stem}-{cup}-{firm}") for cup, firm in breasts]
    return names


def _nearness(phenotype: Phenotype) -> dict[str, Float[np.ndarray, "n"]]:
    """Piecewise linear coefficients of every anchor."""
    nearness: dict[str, np.ndarray] = dict(zip(_ORIGINS, phenotype.origins.T, strict=True))
    for axis, anchors in _ANCHORS.items():
        value = getattr(phenotype, axis)
        last = len(anchors) - 1
        position = (value if axis in _UNBOUNDED else np.clip(value, 0, 1)) * last
        below = np.clip(np.floor(position), 0, last - 1)
        above = position - below
        for i, anchor in enumerate(anchors):
            nearness[anchor] = np.where(below == i, 1 - above, 0) + np.where(below == i - 1, above, 0)
    return nearness
