"""What a term's file declares beside its residuals: its weights' names, the docs' row, its factory, and its kernel."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fitting_core.fit.terms.context import TermContext, UsedKeypoints
from fitting_core.fit.terms.term import Term


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """How compiled code (`fit/fused/`) evaluates a term of single frames.

    It reads records that all terms share: no two fields have the same name. A field is declared as in numpy: name,
    type, and shape unless it is a single number.
    """

    constants: Callable[[Any], Mapping[str, Any]]
    """From a term, the values of its fields; narrower ones fill the front. Those of terms of one kind are summed."""
    clip: tuple[tuple, ...] = ()
    """Fields of one value for all frames, `c.clip` in kernels."""
    frame: tuple[tuple, ...] = ()
    """Fields of a value for each frame, `c.frames[frame]`."""
    point: tuple[tuple, ...] = ()
    """Fields of a value for each point, `c.points[i]`."""
    keypoint: tuple[tuple, ...] = ()
    """Fields of a value for each point in each frame, `c.keypoints[frame, i]`."""
    cost: Callable | None = None
    """(c, frame, orient, x, s, derivatives) -> cost; with `derivatives`, rows in turn columns are added to gradient and
    matrix. None: a term on points, which `fused.frame` evaluates with the others on the same point."""
    add_columns: Callable | None = None
    """(c, frame, x, s): adds what depends on columns of the state alone to the gradient and matrix of the free ones."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A term of the objective."""

    name: str
    """The name its cost is reported under."""
    kind: type[Term]
    about: str
    """The docs' row: one sentence."""
    make: Callable[[TermContext, UsedKeypoints, int], Term | None]
    """From the constants of a fit, the keypoints used, and the index (0 to 4) of a stage; None: not part of it."""
    weights: tuple[str, ...] = ()
    """Fields of `config.weights.Weights`."""
    kernel: Kernel | None = None
    """None: evaluated in torch, and added to the kernels' terms."""
