"""Whether the kernels can be used, and compiling them: the entry point of this folder.

Without kernels everything works in torch by automatic differentiation, some twenty times slower.
"""

import os
import warnings
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

from torch import Tensor

from fitting_core.config.schema import FitConfig
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import SolverView
from fitting_core.fit.variables.state import Free

if TYPE_CHECKING:
    from fitting_core.fit.fused.frames import FusedFrames

SECONDS = 40
"""Approximate compile time, seconds."""
_FUNCTIONS = 141
"""Approximately how many functions numba compiles for them; each takes about as long."""
NOT_YET = "the kernels are not compiled yet"
"""The problem that `prepare` solves."""
_MARK = "compiled"
"""File next to the kernels that marks them as complete."""


class _Use:
    allowed = True
    compiled = False
    warned = False
    threads = 0


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def use(*, kernels: bool | None = None, threads: int | None = None) -> None:
    """Set for this process whether available kernels are used, and on how many threads (0: `cores()`)."""
    _Use.allowed = _Use.allowed if kernels is None else kernels
    _Use.threads = _Use.threads if threads is None else threads


@cache
def _missing() -> str:
    """Why nothing can be compiled; empty if it can."""
    try:
        import fitting_core.fit.fused.frames
    except (ImportError, RuntimeError, OSError) as error:  # the latter two: no folder for what it compiles
        return f"numba cannot be used ({error}); pip install numba"
    assert fitting_core.fit.fused.frames
    return ""


def problem() -> str:
    """Why the kernels are not used; empty if they are."""
    if not _Use.allowed:
        return "the kernels are turned off"
    return _missing() or ("" if _compiled() else NOT_YET)


def prepare_for(config: FitConfig) -> None:
    """Compile the kernels before a fit that uses them, with a warning that this takes a while.

    If they cannot be compiled, a warning says so once per process.
    """
    if not _Use.allowed or (config.device, config.precision, config.solver) != ("cpu", "float64", "lm"):
        return
    prepare(lambda text: warnings.warn(text, stacklevel=2))
    if (why := problem()) and _Use.allowed and not _Use.warned:
        _Use.warned = True
        warnings.warn(f"Fits take many times as long as they could: {why}.", stacklevel=2)


def _compiled() -> bool:
    if not _Use.compiled:
        from fitting_core.fit.compiled.jit import kept_in

        _Use.compiled = (kept_in() / _MARK).is_file()
    return _Use.compiled


def prepare(say: Callable[[str], None]) -> None:
    """Compile the kernels unless they are compiled; `say` announces that this takes a while."""
    if _missing() or _compiled():
        return
    from fitting_core.fit.compiled.jit import kept_in

    say(f"Compiling the solver's kernels, which happens once and takes {SECONDS} seconds or more ...")
    try:
        _compile(say)
    except Exception as error:  # any error of numba or LLVM: torch still works
        _Use.allowed = False
        say(f"They cannot be compiled ({type(error).__name__}: {error}); fits take many times as long without.")
        return
    _Use.compiled = True
    say("Compiled: fits take a fraction of the time from now on.")
    try:
        (kept_in() / _MARK).touch()
    except OSError:
        say(f"They cannot be kept in {kept_in()}; TCFIT_KERNELS names another folder.")


def _compile(say: Callable[[str], None]) -> None:
    """Compile all kernels; `say` reports each quarter of the functions."""
    from numba.core import event

    from fitting_core.fit.fused.frames import compile_all

    class Count(event.Listener):
        compiled = 0

        def on_start(self, event: object) -> None:
            pass

        def on_end(self, event: object) -> None:
            self.compiled += 1
            quarters, rest = divmod(4 * self.compiled, _FUNCTIONS)
            if rest < 4 and 0 < quarters < 4:
                say(f"{25 * quarters} % compiled ...")

    with event.install_listener("numba:compile", Count()):
        compile_all()


def fused_frames(terms: list[Term], view: SolverView, free: Free, index: Tensor) -> "FusedFrames | None":
    """The kernels for an objective; None if they are not ready, or do not support the body's points or its prior."""
    if problem() or not any(isinstance(term, Data) for term in terms):
        return None
    from fitting_core.fit.fused.frames import FusedFrames
    from fitting_core.fit.fused.known import served

    return FusedFrames(terms, view, free, index, threads=_Use.threads or cores()) if served(view) else None
