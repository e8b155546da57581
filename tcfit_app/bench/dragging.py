"""A drag of keypoints, timed: its start, every move, its release, and what plain re-runs would have cost instead."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core.body.params import BodyParams
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import rerun_events
from tcfit_app.fitting.live import Correction, LiveCorrection

Times = list[tuple[float, float]]
"""Milliseconds on the wall's clock and of the processor."""
_BEGINS = 3
"""Times that a drag is begun: that happens once for each."""


@dataclass(frozen=True, kw_only=True)
class Drag:
    """What a drag took and where it ended; parameters of all frames."""

    times: dict[str, Times]
    on_the_way: BodyParams
    """After the last move."""
    released: BodyParams
    rerun: BodyParams | None
    """Of the first plain re-run, if there was one."""


def quick(config: FitConfig) -> FitConfig:
    """The same without the restarts of phase 1: what the drag starts from need not be the best."""
    return replace(config, relay_rounds=0, limb_flips=False, yaws="side_view")


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds that it takes, on the wall's clock and of the processor."""
    wall, cpu = time.perf_counter(), time.thread_time()
    work()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.thread_time() - cpu)


def dragged(correction: Correction, targets: list[Float[np.ndarray, "n 2"]], *, reruns: int) -> Drag:
    """Drag keypoints along a way.

    Args:
        correction: What is dragged.
        targets: Where the keypoints are at each move, pixels.
        reruns: How many of the moves a plain re-run follows too, the last one among them.
    """
    c = correction
    live: list[LiveCorrection] = []
    ends: list[BodyParams] = []
    begins = [timed(lambda: live.append(LiveCorrection(c, targets[0]))) for _ in range(_BEGINS)]
    drag = live[-1]

    def follow(xy: np.ndarray) -> None:
        drag.move(xy)
        drag.resolve()

    def again(xy: np.ndarray) -> None:
        ends.append(drained(rerun_events(c.edited(xy), c.body, c.converging, c.params, c.frames)).params)

    moves = [timed(lambda xy=xy: follow(xy)) for xy in targets]
    on_the_way = drag.params
    release = [timed(lambda: ends.append(drained(drag.release()).params))]
    followed = targets[:: -max(1, len(targets) // reruns)] if reruns else []
    plain = [timed(lambda xy=xy: again(xy)) for xy in followed]
    times = {"begin": begins, "move": moves, "release": release, "plain re-run": plain}
    rerun = ends[1] if plain else None
    return Drag(times=times, on_the_way=on_the_way, released=ends[0], rerun=rerun)
