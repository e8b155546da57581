"""Samples bodies from MakeHuman's macro targets and local shape changes, in the base mesh's A-pose."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from build_assets.free_body.makehuman import BaseMesh, DataFolder, Offsets

_ANCHORS = {
    "gender": ("male", "female"),
    "age": ("baby", "child", "young", "old"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "maxheight"),
    "proportions": ("idealproportions", "uncommonproportions"),
    "cup": ("mincup", "averagecup", "maxcup"),
    "firmness": ("minfirmness", "averagefirmness", "maxfirmness"),
}
_SPANS = {"age": (-2.0, 1.0)}
"""The values of the first and the last anchor, where they are not 0 and 1."""
_ORIGINS = ("african", "asian", "caucasian")
_UNBOUNDED = ("weight",)  # the targets alone span only 63..76 l for a man of 1.76 m


@dataclass(frozen=True, kw_only=True, eq=False)
class Phenotype:
    """What MakeHuman's macro targets depend on, for n bodies; each but age in 0..1 (weight may go beyond)."""

    gender: Float[np.ndarray, "n"]
    """0 male, 1 female."""
    age: Float[np.ndarray, "n"]
    """0 young adult, 1 old; -1 a child of ten years, -2 a baby of one year."""
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
    """Reads every macro target that the folder has."""
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
        last, (low, high) = len(anchors) - 1, _SPANS.get(axis, (0.0, 1.0))
        position = ((value if axis in _UNBOUNDED else np.clip(value, low, high)) - low) / (high - low) * last
        below = np.clip(np.floor(position), 0, last - 1)
        above = position - below
        for i, anchor in enumerate(anchors):
            nearness[anchor] = np.where(below == i, 1 - above, 0) + np.where(below == i - 1, above, 0)
    return nearness


GENDERS = ("neutral", "male", "female", "child")
"""A child stands beside the genders, as body files name it: a boy or girl of about two to thirteen years."""
_MALE_BELOW = 0.5
_AGES = (-1.75, -0.4)
"""Of children, as `Phenotype` counts them."""
_CHILD_SIZE = 0.7
"""Of a child to an adult: local changes are as large in metres whoever they change."""


@dataclass(frozen=True, kw_only=True)
class Modifier:
    """How one of MakeHuman's local shape changes varies between people.

    "*" in its name stands for the left and the right side, which change together.
    """

    name: str
    deviation: float
    """Standard deviation of its coefficient; 1 is the full target, -1 the full opposite one."""
    fatness: float = 0.0
    """How much it follows fatness: MakeHuman's weight alone spans only 63..76 l for a man of 1.76 m."""
    youth: float = 0.0
    """How large it is for the youngest children. MakeHuman's heads of children are too small: at eight years 0.85 times
    as large as an adult's, where their circumference is 0.94 times his (G. Nellhaus, Pediatrics 41, 1968)."""


_MODIFIERS = (
    Modifier(name="torso/torso-scale-depth", deviation=0.25, fatness=0.22),
    Modifier(name="torso/torso-scale-horiz", deviation=0.25, fatness=0.15),
    Modifier(name="torso/torso-scale-vert", deviation=0.25),
    Modifier(name="torso/torso-vshape", deviation=0.25, fatness=-0.1),
    Modifier(name="torso/measure-shoulder-dist", deviation=0.25),
    Modifier(name="torso/measure-waist-circ", deviation=0.25, fatness=0.35),
    Modifier(name="torso/measure-hips-circ", deviation=0.25, fatness=0.25),
    Modifier(name="torso/measure-napetowaist-dist", deviation=0.2),
    Modifier(name="hip/hip-scale-depth", deviation=0.25, fatness=0.15),
    Modifier(name="hip/hip-scale-horiz", deviation=0.25, fatness=0.1),
    Modifier(name="stomach/stomach-pregnant", deviation=0.15, fatness=0.1),
    Modifier(name="stomach/stomach-tone", deviation=0.25),
    Modifier(name="buttocks/buttocks-volume", deviation=0.25, fatness=0.2),
    Modifier(name="neck/neck-scale-vert", deviation=0.2),
    Modifier(name="neck/neck-scale-horiz", deviation=0.2, fatness=0.12),
    Modifier(name="arms/measure-upperarm-length", deviation=0.2),
    Modifier(name="arms/measure-lowerarm-length", deviation=0.2),
    Modifier(name="arms/*upperarm-fat", deviation=0.25, fatness=0.4),
    Modifier(name="arms/*lowerarm-fat", deviation=0.25, fatness=0.3),
    Modifier(name="arms/*upperarm-muscle", deviation=0.2),
    Modifier(name="legs/upperlegs-height", deviation=0.25),
    Modifier(name="legs/lowerlegs-height", deviation=0.25),
    Modifier(name="legs/*upperleg-fat", deviation=0.25, fatness=0.4),
    Modifier(name="legs/*lowerleg-fat", deviation=0.25, fatness=0.3),
    Modifier(name="legs/*lowerleg-muscle", deviation=0.2),
    Modifier(name="head/head-scale-depth", deviation=0.2, youth=1.6),
    Modifier(name="head/head-scale-horiz", deviation=0.2, youth=0.9),
    Modifier(name="head/head-scale-vert", deviation=0.2, youth=1.0),
    Modifier(name="head/head-fat", deviation=0.3, fatness=0.4),
    Modifier(name="chin/chin-width", deviation=0.3),
    Modifier(name="chin/chin-height", deviation=0.3),
    Modifier(name="nose/nose-scale-vert", deviation=0.3),
    Modifier(name="nose/nose-scale-depth", deviation=0.3),
    Modifier(name="nose/nose-scale-horiz", deviation=0.3),
    Modifier(name="mouth/mouth-scale-horiz", deviation=0.3),
    Modifier(name="hands/*hand-scale", deviation=0.2),
    Modifier(name="feet/*foot-scale", deviation=0.2),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeTargets:
    """Everything that a sampled body is made of."""

    mesh: BaseMesh
    macro: MacroTargets
    modifiers: list[tuple[Modifier, Offsets, Offsets]]
    """Each with its increasing and its decreasing target."""


def read_shape_targets(folder: DataFolder, mesh: BaseMesh) -> ShapeTargets:
    """Reads the targets that sampled bodies use."""
    return ShapeTargets(
        mesh=mesh,
        macro=read_macro_targets(folder),
        modifiers=[(m, _both_sides(folder, m, "incr"), _both_sides(folder, m, "decr")) for m in _MODIFIERS],
    )


def sample_bodies(
    targets: ShapeTargets, gender: str, count: int, random: np.random.Generator
) -> Float[np.ndarray, "count N 3"]:
    """Draws bodies: vertices of the base mesh in metres, A-pose.

    Heights are about 1.77 +- 0.07 m for men, 1.65 +- 0.065 m for women, and 0.85 to 1.55 m for children; the mean body
    mass index is about 25 for adults and 17 for children.

    Args:
        targets: what the bodies are made of.
        gender: one of GENDERS; "neutral" draws men and women in turn, "child" boys and girls of all ages.
        count: how many.
        random: the source of randomness.
    """
    phenotype, fatness = (_draw_children if gender == "child" else _draw_people)(gender, count, random)
    bodies = targets.mesh.vertices + targets.macro.displace(phenotype)
    size = _CHILD_SIZE if gender == "child" else 1.0
    youth = np.clip((phenotype.age - _AGES[1]) / (_AGES[0] - _AGES[1]), 0, 1)
    for modifier, more, less in targets.modifiers:
        amount = random.normal(0, modifier.deviation, count) + modifier.fatness * fatness
        amount = (size * np.clip(amount, -1, 1.6) + modifier.youth * youth)[:, None, None]
        bodies += np.maximum(amount, 0) * more + np.maximum(-amount, 0) * less
    return bodies


def _draw_people(gender: str, count: int, random: np.random.Generator) -> tuple[Phenotype, Float[np.ndarray, "count"]]:
    """Phenotypes, and how fat each person is: mean about 0.6, mostly within -1..2."""
    sex = _draw_sex(gender, count, random)
    male = sex < _MALE_BELOW
    # MakeHuman's height axis spans 1.36..2.45 m for men and 1.22..2.31 m for women, linearly.
    height = np.where(male, random.normal(0.363, 0.064, count), random.normal(0.373, 0.060, count))
    fatness = random.normal(0, 0.75, count) + 0.4 * (random.exponential(1, count) - 1) + np.where(male, 0.4, 0.8)
    fatness = np.clip(fatness, np.where(male, -1.4, -0.7), 3.0)
    phenotype = Phenotype(
        gender=sex,
        age=random.beta(1.2, 2.5, count),
        muscle=random.normal(0.5, 0.2, count),
        weight=0.5 + 0.35 * fatness,
        height=height,
        proportions=random.normal(0.5, 0.2, count),
        cup=random.normal(0.5, 0.2, count),
        firmness=random.normal(0.5, 0.2, count),
        origins=random.dirichlet([1, 1, 1], count),
    )
    return phenotype, fatness


def _draw_children(
    gender: str, count: int, random: np.random.Generator
) -> tuple[Phenotype, Float[np.ndarray, "count"]]:
    """The same of children."""
    people, _ = _draw_people("neutral", count, random)
    fatness = random.normal(0, 0.75, count) + 0.4 * (random.exponential(1, count) - 1)
    fatness = np.clip(fatness, -1, 2.5)
    height = random.normal(0.39, 0.04, count)
    children = replace(
        people, age=random.uniform(*_AGES, count), weight=0.5 + 0.35 * fatness, height=height, cup=np.zeros(count)
    )
    return children, fatness


def _draw_sex(gender: str, count: int, random: np.random.Generator) -> Float[np.ndarray, "count"]:
    if gender == "neutral":
        men, women = random.uniform(0, 0.15, count), random.uniform(0.85, 1, count)
        return np.where(np.arange(count) % 2 == 0, men, women)
    return np.full(count, {"male": 0.0, "female": 1.0}[gender])


def _both_sides(folder: DataFolder, modifier: Modifier, sense: str) -> Offsets:
    sides = ("l-", "r-") if "*" in modifier.name else ("",)
    return sum(
        (folder.shape_target(f"{modifier.name.replace('*', side)}-{sense}") for side in sides), start=np.zeros(3)
    )
