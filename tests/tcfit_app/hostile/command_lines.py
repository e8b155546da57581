"""Every command with every option that takes a path, found from the options themselves: new ones come along."""

import re
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

import tyro.conf

from tcfit_app.cli.main import COMMANDS, AddModels

_PATH = re.compile(r"\b(PATH|FILE|DIR|VIDEO|PROJECT|RESULT|\w+\.(onnx|npz|json|toml|csv))\b")
"""In what an option shows for its value, where a text may be a path."""
_POSITIONAL = typing.get_args(tyro.conf.Positional[int])[1]
"""How tyro marks options that have no name."""


@dataclass(frozen=True, kw_only=True)
class PathOption:
    """A place in a command line where a path goes."""

    command: str
    name: str
    """As in the options' class."""
    positional: bool

    @property
    def flag(self) -> str:
        """As it is typed."""
        return "--" + self.name.replace("_", "-")


def path_options(command: str) -> Iterator[PathOption]:
    """Those of a command, nested options too."""
    yield from _of(command, COMMANDS[command][0])
    if command == "models":
        yield from _of(command, AddModels)


def _of(command: str, kind: type) -> Iterator[PathOption]:
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        hint = hints[field.name]
        if is_dataclass(hint):
            yield from _of(command, typing.cast(type, hint))
        else:
            marks = getattr(hint, "__metadata__", ())
            shown = " ".join(str(getattr(mark, "metavar", "")) for mark in marks)
            if Path in _parts(hint) or _PATH.search(shown):
                yield PathOption(command=command, name=field.name, positional=_POSITIONAL in marks)


def _parts(hint: typing.Any) -> set[typing.Any]:
    return {hint}.union(*(_parts(part) for part in typing.get_args(hint)))


def with_path(base: Sequence[str], option: PathOption, value: str, places: Mapping[str, int]) -> list[str]:
    """A command line with another path in one place.

    Args:
        base: A command line that works.
        option: Which place.
        value: What goes there.
        places: Where positional options stand in the base.
    """
    line = list(base)
    if option.positional and option.name in places:
        line[places[option.name]] = value
    elif option.flag in line:
        line[line.index(option.flag) + 1] = value
    else:
        line += [option.flag, value]
    return line
