"""One setting of the method varied at a time, on the suite: window size, shape sample, temporal weight."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from evaluation.ablation_plots import Ablation, Trial
from evaluation.suite_runs import SuiteTask, done_tasks, fit_seconds, run_task
from fitting_core.config.schema import FitConfig
from fitting_core.measure.records import Record, pooled

_STRATEGIES = ("random", "confident", "coverage")
_ERRORS = {"Vertex-to-surface error, cm": "vertex_to_surface", "Volume error, dm³": "volume_error"}


@dataclass(frozen=True, kw_only=True)
class Variation:
    """A setting, and the configurations with its values."""

    title: str
    x_title: str
    note: str
    phase: int
    """Whose seconds are told."""
    logarithmic: bool = False
    values: tuple[tuple[str, float | None, str, FitConfig], ...]
    """Label, place on the axis, variant, configuration."""


def _windows(base: FitConfig) -> Iterator[tuple[str, float | None, str, FitConfig]]:
    for size in (3, 5, 7, 9, 15):
        temporal = replace(base.temporal, mode="sliding_window", window_size=size)
        yield str(size), None, "", replace(base, temporal=temporal)
    yield "global", None, "", replace(base, temporal=replace(base.temporal, mode="global"))


def _samples(base: FitConfig) -> Iterator[tuple[str, float | None, str, FitConfig]]:
    for strategy in _STRATEGIES:
        for size in (5, 15, 30):
            sample = replace(base.shape_sample, size=size, strategy=strategy)
            yield str(size), float(size), strategy, replace(base, shape_sample=sample, last_phase=2)


def _weights(base: FitConfig) -> Iterator[tuple[str, float | None, str, FitConfig]]:
    for weight in (1.0, 10.0, 100.0, 1000.0, 10000.0):
        yield f"{weight:g}", weight, "", replace(base, temporal=replace(base.temporal, weight=weight))


def variations(base: FitConfig) -> tuple[Variation, ...]:
    """All that is varied, from one configuration."""
    return (
        Variation(
            title="Window size",
            x_title="frames of a window",
            note="How many frames phase 3 solves together; global: all at once.",
            phase=3,
            values=tuple(_windows(base)),
        ),
        Variation(
            title="Shape sample",
            x_title="frames",
            note="How many frames find the shared shape in phase 2, and how they are chosen. Measured after phase 2.",
            phase=2,
            values=tuple(_samples(base)),
        ),
        Variation(
            title="Temporal weight",
            x_title="w_T",
            note="Weight of the temporal term over four decades.",
            phase=3,
            logarithmic=True,
            values=tuple(_weights(base)),
        ),
    )


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Where all variations are fitted."""

    folder: Path
    preset: str
    """That is varied."""
    config: FitConfig
    """Its configuration."""
    sequences: Sequence[str]
    level: str
    every: int

    def task(self, name: str, sequence: str, config: FitConfig, start: Path | None = None) -> SuiteTask:
        """A way of fitting one sequence."""
        return SuiteTask(
            sequence=sequence,
            level=self.level,
            variant=name,
            config=config,
            folder=self.folder / "ablations" / self.level / self.preset / name / sequence,
            every=self.every,
            surfaces_of_phase1=False,
            start=start,
        )


def run_ablations(setting: Setting, *, jobs: int) -> tuple[Ablation, ...]:
    """Fit and measure all variations; what was done before with the same settings is taken as it is.

    What is varied belongs to phases 2 and 3, so phase 1 is fitted once for each sequence.
    """
    alone = replace(setting.config, last_phase=1)
    first = {name: setting.task("phase-1", name, alone) for name in setting.sequences}
    for done, _ in enumerate(done_tasks(run_task, list(first.values()), jobs=jobs), 1):
        print(f"Phase 1: {done} of {len(first)}", file=sys.stderr, flush=True)
    found = []
    for variation in variations(setting.config):
        tasks = {
            (label, variant): [
                setting.task(_name(variation, variant, label), name, config, task.folder)
                for name, task in first.items()
            ]
            for label, _, variant, config in variation.values
        }
        records: dict[Path, tuple[Record, ...]] = {}
        every_task = [task for group in tasks.values() for task in group]
        for task, done in done_tasks(run_task, every_task, jobs=jobs):
            records[task.folder] = done
            print(f"{variation.title}: {len(records)} of {len(every_task)}", file=sys.stderr, flush=True)
        found.append(_ablation(setting.preset, variation, tasks, records))
    return tuple(found)


def _name(variation: Variation, variant: str, label: str) -> str:
    return "-".join(part for part in (variation.title.lower().replace(" ", "-"), variant, label) if part)


def _ablation(
    preset: str,
    variation: Variation,
    tasks: dict[tuple[str, str], list[SuiteTask]],
    records: dict[Path, tuple[Record, ...]],
) -> Ablation:
    trials = []
    for label, place, variant, _ in variation.values:
        group = tasks[label, variant]
        last = [records[task.folder][-1] for task in group]
        errors = {title: pooled(last, curve) for title, curve in _ERRORS.items()}
        errors["Acceleration error, m/s²"] = pooled(last, "acceleration_error")
        spent = sum(fit_seconds(task.folder)[f"phase{variation.phase}"] for task in group)
        errors[f"Phase {variation.phase}, CPU s a frame"] = spent / sum(record.frames for record in last)
        trials.append(Trial(label=label, place=place, variant=variant, errors=errors))
    names = ", ".join(dict.fromkeys(task.sequence for group in tasks.values() for task in group))
    return Ablation(
        title=variation.title,
        x_title=variation.x_title,
        note=f"{variation.note} Preset {preset}, all else as it is there; on {names}.",
        logarithmic=variation.logarithmic,
        trials=tuple(trials),
    )
