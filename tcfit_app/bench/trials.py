"""What is measured in a run, in turns: the parts of the bench, or the values that are compared."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting_core.config.schema import FitConfig
from fitting_core.config.settings import changed, settings, unknown
from fitting_core.config.toml import preset
from fitting_core.errors import InputError
from fitting_core.synthetic.excerpts import mirrored, picked, spread
from tcfit_app.bench.figures import Figure
from tcfit_app.bench.measuring import Setup, fit_measures, live_measures, solver_measures, warm_up, window_measures
from tcfit_app.bench.subject import Measured, Subject
from tcfit_app.options.bench import Part
from tcfit_app.options.fit import SHORTCUTS

_SLOW = {"lbfgs": 1}
"""Turns of what would take most of the time."""
GLOBAL = "global"
"""As a size of the window: all frames at once."""


@dataclass(frozen=True, kw_only=True)
class Amount:
    """How much is measured."""

    lengths: tuple[int, ...]
    repeats: int
    windows: tuple[str, ...]
    """Frames of sliding windows, or GLOBAL."""
    solvers: tuple[str, ...]
    """L-BFGS takes twenty to thirty times as long as Levenberg-Marquardt."""
    solver_frames: int
    moves: int
    """Of a drag."""


FULL = Amount(
    lengths=(16, 32, 64),
    repeats=3,
    windows=("5", "7", "15", GLOBAL),
    solvers=("lm", "lbfgs"),
    solver_frames=3,
    moves=40,
)
QUICK = Amount(lengths=(6, 12), repeats=2, windows=("7", GLOBAL), solvers=("lm",), solver_frames=3, moves=10)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One thing that is measured, as often as there are repetitions."""

    name: str
    """"fit 40 frames"; what is measured follows it."""
    process: str
    """Trials of the same process share its memory and what it has prepared."""
    function: Callable[..., Measured]
    arguments: tuple[Any, ...]
    threads: int = 1
    turns: int | None = None
    """If less often than the others."""


def fit_trials(setup: Setup, amount: Amount) -> Iterator[Trial]:
    """Whole fits of clips that differ in their length alone; each in a process of its own, for its memory."""
    for frames in amount.lengths:
        clip = mirrored(setup.clip, min(amount.lengths), frames)
        name = f"fit {frames} frames"
        yield Trial(name=name, process=name, function=fit_measures, arguments=(replace(setup, clip=clip),))


def solver_trials(setup: Setup, amount: Amount) -> Iterator[Trial]:
    """Every solver from the same start on the same cost."""
    clip = picked(setup.clip, spread(np.arange(len(setup.clip)), amount.solver_frames))
    for solver in amount.solvers:
        config = replace(setup.config, solver=solver, relay_rounds=0)
        yield Trial(
            name=f"solver {solver}",
            process="steps",
            function=solver_measures,
            turns=_SLOW.get(solver),
            arguments=(replace(setup, clip=clip, config=config),),
        )


def window_trials(setup: Setup, amount: Amount) -> Iterator[Trial]:
    """Phase 3 by size of the window, from the same start."""
    clip = mirrored(setup.clip, min(amount.lengths), min(amount.lengths))
    for size in amount.windows:
        yield Trial(
            name=f"window {size}",
            process="steps",
            function=window_measures,
            arguments=(replace(setup, clip=clip, config=with_window(setup.config, size)),),
        )


def live_trials(setup: Setup, amount: Amount) -> Iterator[Trial]:
    """A drag of one keypoint."""
    clip = mirrored(setup.clip, min(amount.lengths), min(amount.lengths))
    yield Trial(
        name="live", process="steps", function=live_measures, arguments=(replace(setup, clip=clip), amount.moves)
    )


PARTS: dict[Part, Callable[[Setup, Amount], Iterator[Trial]]] = {
    "fit": fit_trials,
    "solver": solver_trials,
    "window": window_trials,
    "live": live_trials,
}


def with_window(config: FitConfig, size: str) -> FitConfig:
    """Phase 3 with a sliding window of so many frames, or GLOBAL.

    Raises:
        InputError: It is neither.
    """
    if size == GLOBAL:
        return replace(config, temporal=replace(config.temporal, mode=GLOBAL))
    values = {"temporal.window_size": size, "temporal.mode": "sliding_window"}
    return changed(config, values, origin="window", texts=True)


def compared_trials(setup: Setup, amount: Amount, choices: Sequence[str], threads: int) -> list[Trial]:
    """Whole fits with every combination of the values that are compared.

    Args:
        setup: What they have in common.
        amount: Of the lengths the longest is fitted.
        choices: As the user has given them: "solver=lm,lbfgs".
        threads: Of torch, where they are not compared.

    Raises:
        InputError: One of them names no setting, a wrong value, or less than two values.
    """
    clip = mirrored(setup.clip, min(amount.lengths), max(amount.lengths))
    keys = [_choice(text) for text in choices]
    if len({key for key, _ in keys}) < len(keys):
        raise InputError("--compare names a setting twice; give all of its values at once: KEY=A,B,C.")
    trials = []
    for values in itertools.product(*(values for _, values in keys)):
        chosen = dict(zip((key for key, _ in keys), values, strict=True))
        config = setup.config
        for key, value in sorted(chosen.items(), key=lambda item: item[0] != "preset"):
            config = _changed(config, key, value)
        name = " ".join(f"{key}={value}" for key, value in chosen.items())
        trials.append(
            Trial(
                name=name,
                process=name,
                function=fit_measures,
                arguments=(replace(setup, clip=clip, config=config),),
                threads=int(chosen.get("threads", threads)),
            )
        )
    return trials


def _choice(text: str) -> tuple[str, list[str]]:
    key, equals, rest = (part.strip() for part in text.partition("="))
    values = [value.strip() for value in rest.split(",") if value.strip()]
    if not equals or len(set(values)) < 2 or len(set(values)) < len(values):
        raise InputError(f"--compare {text}: expected KEY=A,B with two or more different values.")
    key = key.replace("-", "_")
    if key == "threads" and not all(value.isdigit() and int(value) for value in values):
        raise InputError(f"--compare {text}: expected numbers of threads, 1 or more.")
    if key not in (*_SPECIAL, "threads", *SHORTCUTS, *settings()):
        raise InputError(f"--compare {text}: {unknown(key, [*_SPECIAL, 'threads', *SHORTCUTS, *settings()])}")
    return key, values


_SPECIAL: dict[str, Callable[[FitConfig, str], FitConfig]] = {
    "window": with_window,
    "preset": lambda config, name: replace(
        preset(name, origin="--compare"), device=config.device, precision=config.precision
    ),
}
"""Keys that are no single setting."""


def _changed(config: FitConfig, key: str, value: str) -> FitConfig:
    if key == "threads":
        return config
    if key in _SPECIAL:
        return _SPECIAL[key](config, value)
    return changed(config, {SHORTCUTS.get(key, key): value}, origin="--compare", texts=True)


def run_trials(trials: Sequence[Trial], repeats: int, tell: Callable[[str], None]) -> tuple[Figure, ...]:
    """Measure everything in turns, each process after a small fit that does not count.

    Args:
        trials: What is measured, in this order.
        repeats: How often.
        tell: Is told what is measured next.
    """
    processes: dict[str, Subject] = {}
    values: dict[tuple[str, str], list[float]] = {}
    try:
        for trial in trials:
            if trial.process not in processes:
                tell(f"warming up for {trial.name}")
                processes[trial.process] = Subject(trial.threads)
                processes[trial.process].measure(warm_up, trial.arguments[0])
        for repeat in range(repeats):
            for trial in trials:
                if trial.turns is not None and repeat >= trial.turns:
                    continue
                tell(f"{repeat + 1}/{repeats} {trial.name}")
                measured = processes[trial.process].measure(trial.function, *trial.arguments)
                for what, (value, unit) in measured.items():
                    values.setdefault((f"{trial.name}, {what}", unit), []).append(value)
    finally:
        for process in processes.values():
            process.close()
    return tuple(Figure(name=name, unit=unit, values=tuple(found)) for (name, unit), found in values.items())
