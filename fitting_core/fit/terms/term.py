"""A term of the objective: weighted residuals whose squares add up to its cost.

A term needs a name and the residuals. Derivatives come from its kernel on the CPU (`terms.entry.Kernel`), and from
automatic differentiation of the residuals everywhere else; tests compare the two.
"""

from abc import ABC, abstractmethod

from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.variables.estimate import Estimate


class Term(ABC):
    """A part of the objective: a frozen dataclass with a name and residuals."""

    name: str
    """The name its cost is reported under."""
    once: bool = False
    """Whether it counts once for the clip instead of in every frame: on the shape that frames share (phase 2)."""

    @abstractmethod
    def residual(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Weighted residuals; their squares add up to the term's cost."""

    def reweighted(self, e: Estimate) -> Float[Tensor, "B n"]:
        """Residuals whose Jacobian J makes the Gauss-Newton matrix J^T J.

        A robust term holds its weights here (iteratively reweighted least squares): the products J^T r are those of
        `residual`, the matrix is larger and never indefinite. Others: the residuals themselves.
        """
        return self.residual(e)

    def jacobian(self, e: Estimate, index: Int[Tensor, "d"]) -> Float[Tensor, "B n d"] | None:
        """The Jacobian of `reweighted` by these columns of the state; None: by automatic differentiation.

        Only for a term without a kernel whose automatic Jacobian takes too long.
        """
        return None

    def softened(self, *, cold: bool) -> "Term":
        """A gentler term with its minima in about the same places, which Levenberg-Marquardt minimises first.

        The term itself if its slope is good enough. Not called for E_T.

        Args:
            cold: whether the start is far from the solution.
        """
        return self
