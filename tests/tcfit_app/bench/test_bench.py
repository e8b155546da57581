"""The bench: what it measures, the arithmetic of its comparisons, and its file. Nothing here depends on speed."""

import getpass
import io
import json
import multiprocessing
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.synthetic.excerpts import picked
from tcfit_app.bench import trials as trials_module
from tcfit_app.bench.figures import (
    FORMAT,
    Bench,
    Figure,
    compared,
    comparison_tables,
    differences,
    growth_table,
    number,
    ratio_table,
    read_bench,
    write_bench,
)
from tcfit_app.bench.machine import machine, peak_memory
from tcfit_app.bench.measuring import Setup, fit_measures
from tcfit_app.bench.subject import Measured, Subject
from tcfit_app.bench.trials import FULL, PARTS, QUICK, Trial, compared_trials, run_trials
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import main, parse
from tcfit_app.fitting import child_processes
from tcfit_app.options.fit import fit_config
from tests.drivers.processes import needs_fork
from tests.samples.posed_clips import clip_of, motion

CHEAP = (
    "--preset paper --pose-prior relaxed --set settings.iterations=2 --set settings.rounds=1"
    " --set weights.collision=0,0,0,0,0"
).split()


def figure(name: str, *values: float, unit: str = "s") -> Figure:
    return Figure(name=name, unit=unit, values=values)


def printed(table: Any) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(table)
    return console.file.getvalue()  # pyright: ignore[reportAttributeAccessIssue]


@pytest.fixture(scope="module")
def setup() -> Setup:
    return Setup(clip=clip_of(motion(20)), body=Path("body.npz"), config=PRESETS["tcfit"], clock="cpu")


class Here:
    """Measures in this process."""

    def __init__(self, threads: int) -> None:
        self.threads = threads

    def measure(self, function: Callable[..., Measured], *arguments: Any) -> Measured:
        return function(*arguments)

    def close(self) -> None:
        pass


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trials_module, "Subject", Here)


def test_a_comparison_is_of_medians_and_clear_only_if_all_turns_agree():
    before = [figure("a", 4, 2, 3), figure("b", 1, 1, 2), figure("c", 0, 0), figure("gone", 1)]
    before += [figure("a", 9, unit="MiB"), figure("d", 1, 2), figure("e", 100, 101, 102)]
    now = [figure("b", 4, 4.25, 4.5), figure("a", 6, 5, 4), figure("c", 1, 1), figure("new", 1)]
    now += [figure("d", 3, 4), figure("e", 101.5, 101.2, 109)]
    b, a, c, d, e = rows = compared(before, now)
    assert (a.now.name, a.now.unit, a.ratio, a.verdict) == ("a", "s", 5 / 3, "in the spread")
    assert (b.ratio, b.verdict) == (4.25, "clear")
    assert (c.ratio, c.verdict) == (None, "")
    assert (d.ratio, d.verdict) == (3.5 / 1.5, "too few turns")
    assert e.ratio == pytest.approx(101.5 / 101) and e.verdict == "same"
    text = printed(ratio_table("Title", "old", "new", rows))
    assert "1.67" in text and "clear" in text and "in the spread" in text and "4.25 (4.00-4.50)" in text


def test_variants_are_compared_with_the_first():
    figures = [figure("x=1, phase 1", 2.0), figure("x=2, phase 1", 3.0), figure("x=3, phase 1", 1.0)]
    text = "".join(printed(table) for table in comparison_tables(figures))
    assert "x=2 against x=1" in text and "1.50" in text and "x=3 against x=1" in text and "0.50" in text


def test_growth_is_relative_to_the_shortest_clip():
    names = ((40, "phase 1", 6.0), (20, "phase 1", 4.0), (20, "peak memory", 100.0), (40, "peak memory", 150.0))
    table = growth_table([figure(f"fit {frames} frames, {what}", value) for frames, what, value in names])
    lines = [line.split("│")[1:-1] for line in printed(table).splitlines() if "│" in line]
    cells = {row[0].strip(): [cell.strip() for cell in row[1:]] for row in lines}
    assert cells == {"phase 1": ["1.00", "1.50"], "peak memory": ["1.00", "1.50"]}
    assert growth_table([figure("fit 20 frames, phase 1", 1.0), figure("live, move", 1.0)]) is None


@pytest.mark.parametrize(
    "value, text", [(0, "0"), (0.01234, "0.0123"), (1.005, "1.00"), (12.34, "12.3"), (1234.5, "1234"), (99.99, "100.0")]
)
def test_numbers_have_three_digits(value: float, text: str):
    assert number(value) == text


def test_what_was_measured_comes_back_from_its_file(tmp_path: Path):
    conditions = {"clip": "demo", "config": {"solver": "lm"}}
    bench = Bench(format=FORMAT, machine=machine(), versions={}, conditions=conditions, figures=(figure("a", 1, 2),))
    write_bench(tmp_path / "new" / "b.json", bench)
    assert read_bench(tmp_path / "new" / "b.json") == bench
    assert list(tmp_path.glob("new/*")) == [tmp_path / "new" / "b.json"]


def test_what_else_has_changed_is_told():
    def bench(cores: int, **conditions: str) -> Bench:
        return Bench(format=FORMAT, machine={"cores": cores}, versions={}, conditions=conditions, figures=())

    assert differences(bench(2, clip="a"), bench(2, clip="a")) == []
    assert differences(bench(2, clip="a"), bench(4, clip="b", clock="cpu")) == [
        "machine.cores was 2, is 4",
        'clip was "a", is "b"',
        'clock was not noted, is "cpu"',
    ]


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "cannot be read"),
        ("{", "is no file of"),
        ('{"format": "tcfit bench 1"}', "is no file of"),
        ('{"format": "other", "machine": {}, "versions": {}, "conditions": {}, "figures": []}', "is 'other'"),
        (
            '{"format": "tcfit bench 1", "machine": {}, "versions": {}, "conditions": {},'
            ' "figures": [{"name": "a", "unit": "s", "values": []}]}',
            "has no value for a",
        ),
    ],
)
def test_what_is_no_earlier_run_is_refused(tmp_path: Path, content: str | None, message: str):
    if content is not None:
        (tmp_path / "b.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_bench(tmp_path / "b.json")


def test_the_machine_is_described_and_not_named():
    text = json.dumps(machine())
    assert set(machine()) == {"processor", "cores", "memory GiB", "system"} and machine()["cores"]
    assert platform.node() not in text and f'"{getpass.getuser()}"' not in text
    assert (peak := peak_memory()) is None or peak > 10


def test_values_to_compare_become_configurations(setup: Setup):
    found = compared_trials(setup, QUICK, ["window=9,global", "temporal-weight=1,2"], threads=1)
    names = [trial.name for trial in found]
    assert names == [f"window={w} temporal_weight={t}" for w in ("9", "global") for t in ("1", "2")]
    temporal = [trial.arguments[0].config.temporal for trial in found]
    assert [t.mode for t in temporal] == ["sliding_window"] * 2 + ["global"] * 2
    assert temporal[0].window_size == 9 and [t.weight for t in temporal] == [1, 2, 1, 2]
    assert len({trial.process for trial in found}) == 4 and {len(t.arguments[0].clip) for t in found} == {12}


def test_threads_and_presets_are_compared_too(setup: Setup):
    threads = compared_trials(setup, QUICK, ["threads=1,2"], threads=1)
    assert [trial.threads for trial in threads] == [1, 2]
    one, other = compared_trials(setup, QUICK, ["solver=lm,lbfgs", "preset=paper,tcfit"], threads=3)[2:]
    assert one.arguments[0].config.solver == "lbfgs" and one.arguments[0].config.temporal.mode == "sliding_window"
    assert other.arguments[0].config.solver == "lbfgs" and other.threads == 3


@pytest.mark.parametrize(
    "choices, message",
    [
        (["solver"], "expected KEY=A,B"),
        (["solver=lm"], "two or more different values"),
        (["solver=lm,lm"], "two or more different values"),
        (["sovler=lm,lbfgs"], "did you mean solver"),
        (["solver=lm,newton"], "expected one of lm, lbfgs"),
        (["window=7,all"], "window_size is all"),
        (["preset=paper,papre"], "Did you mean paper"),
        (["threads=0,1"], "expected numbers of threads"),
        (["solver=lm,lbfgs", "solver=lbfgs,lm"], "names a setting twice"),
    ],
)
def test_what_cannot_be_compared_is_refused(setup: Setup, choices: list[str], message: str):
    with pytest.raises(InputError, match=message):
        compared_trials(setup, QUICK, choices, threads=1)


def test_trials_take_turns(in_this_process: None, setup: Setup, monkeypatch: pytest.MonkeyPatch):
    order: list[str] = []

    def measure(setup: Setup, name: str) -> Measured:
        order.append(name)
        return {"time": (float(len(order)), "s")}

    monkeypatch.setattr(trials_module, "warm_up", lambda setup: {})
    plan = [
        Trial(name=name, process=name, function=measure, arguments=(setup, name), turns=turns)
        for name, turns in (("a", None), ("b", 1), ("c", None))
    ]
    figures = run_trials(plan, 3, lambda text: None)
    assert order == ["a", "b", "c", "a", "c", "a", "c"]
    assert [(f.name, f.values) for f in figures] == [
        ("a, time", (1, 4, 6)),
        ("b, time", (2,)),
        ("c, time", (3, 5, 7)),
    ]


def test_every_part_names_what_it_measures(setup: Setup):
    names = [trial.name for part in PARTS.values() for trial in part(setup, FULL)]
    assert len(set(names)) == len(names) and not [name for name in names if ", " in name]
    assert {"fit 64 frames", "solver lbfgs", "window global", "window 7", "live"} <= set(names)


def test_a_bench_of_every_part_and_its_comparison_with_another(
    in_this_process: None, keypoint_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """All parts on a tiny clip: tables, file, and a second run against the first."""
    file = tmp_path / "b.json"
    command = ["bench", "--keypoints", str(keypoint_folder), "--quick", "--lengths", "3", "5", "--repeats", "1", *CHEAP]
    assert main([*command, "--parts", "fit", "window", "live", "--json", str(file)]) == 0
    output = capsys.readouterr().out
    assert "Growth with the length" in output and "Medians of 1 turns, wall-clock time" in output
    content = json.loads(file.read_text())
    assert set(content) == {"format", "machine", "versions", "conditions", "figures"} and content["format"] == FORMAT
    assert {"python", "torch", "numpy", "tcfit"} <= set(content["versions"])
    found = {f["name"]: f for f in content["figures"]}
    assert {"fit 3 frames, phase 1", "fit 5 frames, all phases", "window 7, phase 3", "live, move"} <= set(found)
    assert all(len(f["values"]) == 1 and f["values"][0] > 0 for f in found.values())
    total = sum(found[f"fit 5 frames, phase {k}"]["values"][0] for k in (1, 2, 3))
    assert found["fit 5 frames, all phases"]["values"][0] == pytest.approx(total)
    assert main([*command, "--parts", "live", "--threads", "1", "--clock", "cpu", "--against", str(file)]) == 0
    output = capsys.readouterr().out
    assert "Against the earlier run" in output and "live, move" in output
    assert [line for line in output.splitlines() if "Not the same" in line] == [
        'Not the same: clock was "wall", is "cpu"',
        'Not the same: parts was ["fit","window","live"], is ["live"]',
    ]
    assert main([*command, "--parts", "solver", "--against", str(file)]) == INPUT_ERROR


def test_a_comparison_of_two_values(in_this_process: None, keypoint_folder: Path, capsys: pytest.CaptureFixture[str]):
    command = ["bench", "--keypoints", str(keypoint_folder), "--lengths", "3", "--repeats", "2", *CHEAP]
    assert main([*command, "--compare", "seed=1,2", "--set", "last_phase=1"]) == 0
    output = capsys.readouterr().out
    assert "seed=2 against seed=1" in output and "objective" in output
    row = next(line for line in output[output.index("against") :].splitlines() if "objective" in line)
    assert "1.00" in row and "same" in row  # the seed draws frames of phase 2, which is left out


@pytest.mark.parametrize(
    "arguments, message",
    [
        ("--lengths 2 4", "3 or more"),
        ("--lengths 4 4", "different numbers"),
        ("--repeats 0", "--repeats is 0"),
        ("--lengths 7", "has only 6"),
        ("--threads 300", "--threads is 300"),
        ("--lengths 3 --compare solver=lm", "two or more"),
        ("--against none.json", "none.json: cannot be read"),
    ],
)
def test_wrong_options_are_refused(keypoint_folder: Path, capsys, arguments: str, message: str):
    assert main(["bench", "--keypoints", str(keypoint_folder), *arguments.split()]) == INPUT_ERROR
    assert message in capsys.readouterr().err


def test_the_options_have_defaults():
    options = parse(["bench"])
    assert options.parts == tuple(PARTS) and options.compare == () and options.threads == 1 and not options.quick


def _failing(setup: object) -> Measured:
    raise InputError("no frame shows a person")


def _breaking(setup: object) -> Measured:
    raise ZeroDivisionError("by chance")


@needs_fork
def test_a_process_measures_and_hands_errors_on(monkeypatch: pytest.MonkeyPatch, setup: Setup, free_body):
    monkeypatch.setattr(child_processes, "CONTEXT", multiprocessing.get_context("fork"))
    config = parse(["bench", *CHEAP, "--set", "last_phase=1"]).method
    whole = Setup(clip=picked(setup.clip, range(4)), body=free_body.source, config=fit_config(config), clock="cpu")
    subject = Subject(threads=1)
    try:
        measured = subject.measure(fit_measures, whole)
        assert measured["phase 1"][0] > 0 and measured["phase 1"][1] == "ms/frame"
        with pytest.raises(InputError, match="no frame shows a person"):
            subject.measure(_failing, whole)
        with pytest.raises(RuntimeError, match="ZeroDivisionError: by chance"):
            subject.measure(_breaking, whole)
    finally:
        subject.close()


def test_the_middle_and_the_high_end_of_repetitions():
    measured = figure("a", *map(float, range(100, -1, -1)))
    assert (measured.median, measured.high) == (50, 95)
