"""Flows from seeds."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

import numpy as np

from tests.flows.actions import ACTS, FAULTS, Act, ignored
from tests.flows.world import CLIPS, PATIENCE, TABS, Broken, world

STEPS = 14
"""Actions of a flow."""
LASTING = 4
"""Actions for which a full disk stays full."""


@dataclass(frozen=True)
class Failure:
    """A flow after which something did not hold."""

    seed: int
    steps: int
    played: tuple[str, ...]
    """What was done, in order."""
    problem: str

    def __str__(self) -> str:
        done = "\n".join(f"  {number}. {what}" for number, what in enumerate(self.played, 1))
        return f"seed {self.seed}, {self.steps} steps: {self.problem}\n{done}"


def play(seed: int, steps: int = STEPS) -> Failure | None:
    """Play a flow; None if all that must hold does."""
    played: list[str] = []
    try:
        with _watched(), world() as made:
            rng = np.random.default_rng(seed)
            shares = np.array([share for share, _ in ACTS])
            at = int(rng.integers(STEPS // 2))
            fault, own = FAULTS[int(rng.integers(len(FAULTS)))], rng.integers(2**32, size=STEPS + 1)
            if rng.random() < 0.3:
                made.switch()
                played.append(f"open {CLIPS[1]}")
            for step in range(steps):
                # Each action has random numbers of its own: a shorter flow begins with the same ones.
                rng = np.random.default_rng(own[step])
                act = Act(made, rng, TABS[int(rng.integers(len(TABS)))])
                if step == at:
                    played.append(f"FAULT: {fault(act)}")
                does = ACTS[int(rng.choice(len(ACTS), p=shares / shares.sum()))][1]
                name = getattr(does, "__name__", None) or f"{does.func.__name__} {does.keywords}"  # pyright: ignore
                played.append(f"{act.tab}: {name}")
                try:
                    does(act)
                except Exception as error:
                    if not ignored(error):
                        raise
                if made.die():
                    played.append("KILLED, opened again")
                if step == at + LASTING:
                    made.disk.room = None
            made.check()
            made.reopen()
    except Broken as broken:
        return Failure(seed, steps, tuple(played), str(broken))
    except _Hung:
        return Failure(seed, steps, tuple(played), "the app hangs")
    except Exception as error:
        import traceback

        return Failure(seed, steps, tuple(played), "".join(traceback.format_exception(error)))
    return None


def shrunk(failure: Failure) -> Failure:
    """The shortest beginning of a flow that fails."""
    for steps in range(1, failure.steps):
        if (shorter := play(failure.seed, steps)) is not None:
            return shorter
    return failure


class _Hung(BaseException):
    """The thread that plays waits for ever."""


@contextmanager
def _watched() -> Iterator[None]:
    def hung(number: int, frame: FrameType | None) -> None:
        raise _Hung

    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(int(20 * PATIENCE))
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
