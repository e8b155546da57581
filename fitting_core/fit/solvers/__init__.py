"""Solvers behind one interface, and the SOLVERS table."""

from collections.abc import Callable, Generator
from typing import Protocol

from fitting_core.config.schema import SolverSettings
from fitting_core.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from fitting_core.fit.solvers.limited_memory import LimitedMemory
from fitting_core.fit.solvers.problem import Problem
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.variables.state import State


class Solver(Protocol):
    """Minimises any Problem."""

    iterations: int
    """Maximum number of steps of one minimisation."""

    def minimise(self, problem: Problem, start: State, *, final: bool) -> Generator[Progress, None, Solution]:
        """Lowers every group's cost, yielding after each step; `final` asks for full accuracy."""
        ...


SOLVERS: dict[str, Callable[[SolverSettings], Solver]] = {"lm": LevenbergMarquardt, "lbfgs": LimitedMemory}
"""By the name in a configuration."""


def make_solver(name: str, settings: SolverSettings) -> Solver:
    """The solver of a configuration."""
    return SOLVERS[name](settings)
