"""A shape that is known before a fit, from another clip of the person or from a measurement."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownShape:
    """What phase 2 takes instead of looking for a shape."""

    betas: Float[np.ndarray, "10"]
    """Of the body that is fitted: on another one they mean another shape."""
    source: str = ""
    """Where they come from, for the user."""

    def sentence(self) -> str:
        """For the user."""
        return f"shape as given from {self.source}" if self.source else "shape as given"
