"""A term of the objective: weighted residuals, and what the term declares about itself.

The cost of a term is the sum of its squared residuals. It needs only a name and the residuals. Anything more, such as a
closed-form Jacobian, makes it faster, and tests compare it with automatic differentiation.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum, auto
from typing import ClassVar

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.point_jacobian import PointJacobian


class Derivative(Enum):
    """How the derivatives of a term are found."""

    AUTOMATIC = auto()
    """By automatic differentiation of `residual`."""
    COLUMNS = auto()
    """Each residual depends on only one column of the state: `columns` and `slope`."""
    POSE_COLUMNS = auto()
    """The same with columns of the axis-angle pose, whatever the pose prior's own numbers are."""
    ROWS = auto()
    """By a closed-form Jacobian in the columns of the axis-angle pose: `rows`."""
    STENCIL = auto()
    """For a term with a reach in time: its residuals combine a `quantity` of single frames by a fixed `stencil`, and
    `rows` has the Jacobian of that quantity."""


@dataclass(frozen=True)
class Rows:
    """Rows of the Gauss-Newton system: half gradient J^T r (+ extra), half matrix J^T J."""

    residual: Float[Tensor, "B n"]
    jacobian: Float[Tensor, "B n width"]
    extra_gradient: Float[Tensor, "B width"] | None = None


@dataclass(frozen=True)
class Stencil:
    """How residuals combine a quantity of single frames: r_i = sum over offsets of factor x quantity_(i + offset).

    It acts on the frames of a span, and gives residuals for those that have `reach` neighbours on either side in it.
    The matrix L that it stands for is never built: L and its square would be frames times frames.
    """

    factors: tuple[tuple[int, float], ...]
    """Offset and factor."""

    @property
    def reach(self) -> int:
        """Frames to either side that a residual depends on."""
        return max(abs(offset) for offset, _ in self.factors)

    def scaled(self, weight: float) -> "Stencil":
        """The same with all factors times a weight."""
        return Stencil(tuple((offset, weight * factor) for offset, factor in self.factors))

    def _at(self, offset: int, span: int) -> slice:
        start = self.reach + offset
        return slice(start, start + max(span - 2 * self.reach, 0))

    def __call__(self, values: Float[Tensor, "s m"]) -> Float[Tensor, "c m"]:
        """L times the values of a span of frames."""
        parts = [factor * values[self._at(offset, len(values))] for offset, factor in self.factors]
        return torch.stack(parts).sum(0)

    def transposed(self, residuals: Float[Tensor, "c m"], span: int) -> Float[Tensor, "s m"]:
        """L^T times residuals."""
        values = residuals.new_zeros(span, residuals.shape[1])
        for offset, factor in self.factors if len(residuals) else ():
            values[self._at(offset, span)] += factor * residuals
        return values

    def square(self, span: int, like: Tensor) -> list[Float[Tensor, "s"]]:
        """The diagonal of L^T L and the ones below it, each over the frames of a span, zero past its end."""
        bands = [like.new_zeros(span) for _ in range(2 * self.reach + 1)]
        for lower, a in self.factors:
            for upper, b in self.factors:
                if lower >= upper:
                    bands[lower - upper][self._at(upper, span)] += a * b
        return bands


class Term(ABC):
    """A part of the objective: a frozen dataclass with a name and residuals, and declarations about it.

    `derivative` and `reach` are those of the class; `once` may differ from one term to another.
    """

    name: str
    """The name its cost is reported under."""
    derivative: ClassVar[Derivative] = Derivative.AUTOMATIC
    """Which of the methods below it implements."""
    reach: ClassVar[int] = 0
    """Frames to either side that a frame's residuals depend on. A term with a reach couples frames up to twice as far
    apart, and is used when frames are fitted together (phase 3)."""
    once: bool = False
    """Whether it counts once for the clip instead of in every frame: on the shape that frames share (phase 2)."""

    def __init_subclass__(cls) -> None:
        over_time = {Derivative.AUTOMATIC, Derivative.STENCIL}
        possible = over_time if cls.reach else set(Derivative) - {Derivative.STENCIL}
        names = ", ".join(sorted(d.name for d in possible))
        assert cls.derivative in possible, (
            f"{cls.__name__} has a reach of {cls.reach}: its derivative is one of {names}"
        )

    @abstractmethod
    def residual(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Weighted residuals; their squares add up to the term's cost.

        With a reach, `e` holds frames in a row, and the result is that of the frames that have so many neighbours on
        either side in it: (B - 2 reach, n).
        """

    def softened(self, *, cold: bool) -> "Term":
        """A gentler term with its minima in about the same places, which Levenberg-Marquardt minimises first.

        The term itself if its slope is good enough. Not called for terms with a reach.

        Args:
            cold: whether the start is far from the solution.
        """
        return self

    def columns(self, e: Estimate) -> Int[Tensor, "n"]:
        """COLUMNS, POSE_COLUMNS: the column that each residual depends on."""
        raise NotImplementedError

    def slope(self, e: Estimate) -> Float[Tensor, "B n"]:
        """COLUMNS, POSE_COLUMNS: the derivative of each residual by its column."""
        raise NotImplementedError

    def rows(self, e: Estimate, jacobian: PointJacobian) -> Rows:
        """ROWS: residuals and their Jacobian; STENCIL: the quantity and its Jacobian, unweighted."""
        raise NotImplementedError

    def quantity(self, e: Estimate) -> Float[Tensor, "B m"]:
        """STENCIL: the quantity of each frame that residuals combine."""
        raise NotImplementedError

    @property
    def stencil(self) -> Stencil:
        """STENCIL: how, weight included."""
        raise NotImplementedError
