"""Hundreds of hostile files and plugins: each ends soon, in little memory, with a line of why, runs
nothing, and leaves nothing half-written."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tcfit_app.cli.ending import INPUT_ERROR
from tests.tcfit_app.hostile.made_files import EXECUTED, bombs, cameras, pickles
from tests.tcfit_app.hostile.made_plugins import plugins
from tests.tcfit_app.hostile.world import World

pytestmark = pytest.mark.thorough

MANY, SECONDS = 200, 10.0
FILES = {"pickles": pickles, "cameras": cameras, "bombs": bombs}
_OPEN, _SLOW = ("review", "demo"), ("evaluate", "batch", "fit")
"""Commands that stay open, and those that take their time with what is right."""
_OF_PLUGINS = (0, 1, INPUT_ERROR, 130)
"""Ends of a call with a plugin: it is left out, its export fails, its file cannot be read, or it interrupts."""


def fault_of(world: World, line: list[str], statuses: tuple[int, ...]) -> str:
    """What is wrong with the end of a call; empty if nothing is."""
    ended, left = world.ran(line, limit=SECONDS * (1 if line[0] in _OPEN else 30))
    fault = ended.fault
    if not fault and ended.status not in statuses and not ended.hung:
        fault = f"ends with status {ended.status}"
    if not fault and line[0] not in (*_OPEN, *_SLOW) and ended.seconds > SECONDS:
        fault = f"takes {ended.seconds:.0f} s of a processor"
    if not fault and (any(Path(path).name == EXECUTED for path in left) or (ended.status == INPUT_ERROR and left)):
        fault = f"leaves {sorted(left)[:3]}"
    return fault and f"{' '.join(line)[:300]}: {fault}\n{ended.err[-600:]}"


def case_numbers(few: int) -> list[object]:
    """A few for every run of the tests, and the others for those who choose slow ones."""
    return [*range(few), *(pytest.param(number, marks=pytest.mark.slow) for number in range(few, MANY))]


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("number", case_numbers(6))
def test_files(hostile_world: World, tmp_path: Path, kind: str, number: int):
    line = FILES[kind](np.random.default_rng([number, len(kind)]), tmp_path)
    assert not (fault := fault_of(hostile_world, line, (0, INPUT_ERROR))), fault


@pytest.mark.parametrize("number", case_numbers(6))
def test_plugins(hostile_world: World, number: int):
    (hostile_world.folder / "points.odd").touch()
    line = plugins(np.random.default_rng(number), hostile_world.packages)
    try:
        assert not (fault := fault_of(hostile_world, line, _OF_PLUGINS)), fault
    finally:
        for path in hostile_world.packages.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
