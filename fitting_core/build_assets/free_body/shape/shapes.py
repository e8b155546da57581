"""Samples adult bodies from MakeHuman's targets, in the base mesh's A-pose."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.build_assets.free_body.makehuman import BaseMesh, DataFolder, Offsets
from fitting_core.build_assets.free_body.shape.phenotypes import MacroTargets, Phenotype, read_macro_targets

GENDERS = ("neutral", "male", "female")
_MALE_BELOW = 0.5


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
    Modifier(name="head/head-scale-depth", deviation=0.2),
    Modifier(name="head/head-scale-horiz", deviation=0.2),
    Modifier(name="head/head-scale-vert", deviation=0.2),
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
    """Draws adult bodies: vertices of the base mesh in metres, A-pose.

    Heights are about 1.77 +- 0.07 m for men and 1.65 +- 0.065 m for women, the mean body mass index about 25.

    Args:
        targets: what the bodies are made of.
        gender: one of GENDERS; "neutral" draws men and women in turn.
        count: how many.
        random: the source of randomness.
    """
    phenotype, fatness = _draw_people(gender, count, random)
    bodies = targets.mesh.vertices + targets.macro.displace(phenotype)
    for modifier, more, less in targets.modifiers:
        amount = random.normal(0, modifier.deviation, count) + modifier.fatness * fatness
        amount = np.clip(amount, -1, 1.6)[:, None, None]
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
