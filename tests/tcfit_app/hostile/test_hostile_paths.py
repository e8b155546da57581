"""Every command with every kind of path that is none, in every place where it takes one: told in a line, at once, and
nothing is written that is not whole."""

import pytest

from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import COMMANDS
from tests.tcfit_app.hostile.command_lines import PathOption, path_options
from tests.tcfit_app.hostile.world import World

pytestmark = pytest.mark.thorough

OPTIONS = [option for command in COMMANDS for option in path_options(command)]


def complaints(world: World, option: PathOption, kinds: list[str]) -> list[str]:
    """What is wrong with a command's ends."""
    found = []
    for kind in kinds:
        ended, left = world.tried(option, kind)
        fault = ended.fault
        if not fault and ended.status == INPUT_ERROR and left:
            fault = f"fails, and leaves {sorted(left)[:3]}"
        if fault:
            found.append(f"{option.command} {option.flag} with {kind}: {fault}\n{ended.err[-600:]}")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("option", OPTIONS, ids=lambda option: f"{option.command} {option.name}")
def test_every_kind_in_every_place(hostile_world: World, option: PathOption):
    found = complaints(hostile_world, option, list(hostile_world.hostile))
    assert not found, "\n".join(found)


@pytest.mark.parametrize("which", range(len(OPTIONS)), ids=lambda i: f"{OPTIONS[i].command} {OPTIONS[i].name}")
def test_every_place_with_some_kind(hostile_world: World, which: int):
    kinds = list(hostile_world.hostile)
    found = complaints(hostile_world, OPTIONS[which], [kinds[5 * which % len(kinds)]])
    assert not found, "\n".join(found)
