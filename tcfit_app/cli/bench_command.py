"""`tcfit bench`: measure how fast fits are here, compare two ways to fit, or two versions of tcfit."""

import dataclasses
import hashlib
import itertools
import sys
import time
from dataclasses import replace

from rich.console import Console
from tqdm import tqdm

from fitting_core.clip import Clip
from fitting_core.clips.reading import read_clip
from fitting_core.config.toml import as_plain
from fitting_core.errors import InputError
from fitting_core.io.summary import versions
from tcfit_app.bench.figures import (
    FORMAT,
    Bench,
    Figure,
    compared,
    comparison_tables,
    differences,
    figure_table,
    growth_table,
    ratio_table,
    read_bench,
    write_bench,
)
from tcfit_app.bench.machine import machine
from tcfit_app.bench.measuring import Setup
from tcfit_app.bench.trials import FULL, PARTS, QUICK, Amount, Trial, compared_trials, run_trials
from tcfit_app.cli.demo_command import demo_clip, read_demo
from tcfit_app.cli.detection_shown import DetectionShown
from tcfit_app.options.bench import BenchOptions
from tcfit_app.options.fit import fit_config
from tcfit_app.options.preparing import body_file, compile_kernels, prepare_solver


def run_bench(options: BenchOptions) -> Bench:
    """Measure, print the tables, and write the figures if that is asked for.

    Raises:
        InputError: Files or options cannot be used.
    """
    before = read_bench(options.against) if options.against else None
    amount = _amount(options)
    config = fit_config(options.method)
    prepare_solver(config, options.threads)
    setup = Setup(clip=_clip(options), body=body_file(options.body), config=config, clock=options.clock)
    trials = _trials(options, setup, amount)
    compile_kernels(config)
    begin = time.monotonic()
    figures = _run(trials, amount.repeats)
    bench = Bench(
        format=FORMAT,
        machine=machine(),
        versions=versions(),
        conditions=_conditions(options, setup, amount),
        figures=figures,
    )
    _show(bench, compare=bool(options.compare), seconds=time.monotonic() - begin)
    if before is not None:
        _show_against(before, bench)
    if options.json is not None:
        write_bench(options.json, bench)
        print(f"Wrote {options.json}")
    return bench


def _amount(options: BenchOptions) -> Amount:
    amount = QUICK if options.quick else FULL
    lengths, repeats = options.lengths or amount.lengths, amount.repeats if options.repeats is None else options.repeats
    if min(lengths) < 3 or len(set(lengths)) < len(lengths):
        raise InputError(f"--lengths {' '.join(map(str, lengths))}: expected different numbers of frames, 3 or more.")
    if repeats < 1:
        raise InputError(f"--repeats is {repeats}; expected 1 or more.")
    return replace(amount, lengths=tuple(sorted(lengths)), repeats=repeats)


def _clip(options: BenchOptions) -> Clip:
    """The clip without its video, which no fit looks at."""
    if options.video is None and options.keypoints is None:
        clip = read_demo(demo_clip())
    else:
        with DetectionShown() as tell:
            clip = read_clip(options.video, options.keypoints, clip=options.clip, camera=options.camera, tell=tell)
    return replace(clip, source=None)


def _trials(options: BenchOptions, setup: Setup, amount: Amount) -> list[Trial]:
    shortest = min(amount.lengths)
    if len(setup.clip) < shortest:
        raise InputError(
            f"The shortest of --lengths is {shortest} frames, but {setup.clip.name} has only {len(setup.clip)}."
        )
    if options.compare:
        return compared_trials(setup, amount, options.compare, options.threads)
    parts = [trial for part in dict.fromkeys(options.parts) for trial in PARTS[part](setup, amount)]
    return [replace(trial, threads=options.threads) for trial in parts]


def _run(trials: list[Trial], repeats: int) -> tuple[Figure, ...]:
    turns = sum(min(repeats, trial.turns or repeats) for trial in trials) + len({trial.process for trial in trials})
    steps = itertools.count()
    with tqdm(total=turns, disable=not sys.stderr.isatty(), leave=False, unit="step") as bar:

        def tell(text: str) -> None:
            bar.update(next(steps) - bar.n)
            bar.set_postfix_str(text)
            if bar.disable:
                print(text, file=sys.stderr, flush=True)

        return run_trials(trials, repeats, tell)


def _conditions(options: BenchOptions, setup: Setup, amount: Amount) -> dict[str, object]:
    keypoints = setup.clip.keypoints
    content = hashlib.sha256(keypoints.xy.tobytes() + keypoints.confidence.tobytes()).hexdigest()[:16]
    return {
        "clip": f"{setup.clip.name}, {len(setup.clip)} frames",
        "keypoints": content,
        "body": hashlib.sha256(setup.body.read_bytes()).hexdigest()[:16],
        "config": as_plain(setup.config),
        "clock": setup.clock,
        "threads": options.threads,
        "amount": dataclasses.asdict(amount),
        "compare": list(options.compare),
        "parts": [] if options.compare else list(options.parts),
    }


def _show(bench: Bench, *, compare: bool, seconds: float) -> None:
    console = Console()
    console.print(figure_table(bench.figures))
    if compare:
        for table in comparison_tables(bench.figures):
            console.print(table)
    elif (growth := growth_table(bench.figures)) is not None:
        console.print(growth)
    clock = {"wall": "wall-clock time", "cpu": "time of the processor"}[bench.conditions["clock"]]
    print(f"Medians of {bench.conditions['amount']['repeats']} turns, {clock}; measured in {seconds:.0f} s.")


def _show_against(before: Bench, now: Bench) -> None:
    rows = compared(before.figures, now.figures)
    if not rows:
        raise InputError("--against: that run has no figure in common with this one. Give the same parts and lengths.")
    Console().print(ratio_table("Against the earlier run", "before", "now", rows))
    for difference in differences(before, now):
        print(f"Not the same: {difference}")
    missing = len(now.figures) - len(rows)
    if missing:
        print(f"{missing} figures are not in the earlier run.")
