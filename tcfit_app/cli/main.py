"""The command `tcfit`: parses the command line, runs one command, and returns an exit code."""

import errno
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Union

import tyro
from tyro.conf import OmitArgPrefixes, OmitSubcommandPrefixes, Positional, arg, subcommand

from fitting_core.config.schema import DEFAULT_PRESET
from fitting_core.errors import InputError
from fitting_core.files.regular import legible
from fitting_core.memory import share_heaps
from tcfit_app.cli.ending import ended, prepare_streams
from tcfit_app.cli.json_lines import OPTION, SCHEMA, Started, emit, json_lines, version
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.detect import DetectOptions
from tcfit_app.options.evaluate import EvaluateOptions
from tcfit_app.options.export import ExportOptions
from tcfit_app.options.fit import (
    DemoOptions,
    FitOptions,
    MethodOptions,
    NewOptions,
    ReviewOptions,
    fit_config,
    registry_of_hints,
)
from tcfit_app.options.import_ import ImportOptions
from tcfit_app.options.removed import check_removed


@dataclass(frozen=True, kw_only=True)
class ListModels:
    """List installed models and detectors (the default)."""


@dataclass(frozen=True, kw_only=True)
class AddModels:
    """Install body models, or download a detector."""

    paths: Annotated[Positional[tuple[Path, ...]], arg(metavar="PATH")]
    """Model files, folders, or archives as downloaded; or the name of a detector, to download what it lacks."""
    yes: bool = False
    """Agree to the licence of the download."""


@dataclass(frozen=True, kw_only=True)
class Models:
    """List installed body models and detectors, or add some."""

    action: Annotated[ListModels, subcommand("list")] | Annotated[AddModels, subcommand("add")] = field(
        default_factory=ListModels
    )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Print all settings of the method with their meaning, as a file for --config."""

    method: MethodOptions = field(default_factory=MethodOptions)


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this computer, and say what to install."""


def _in(module: str) -> Any:
    """A module of this folder, imported by the command that needs it, so that --help stays quick."""
    return import_module(f"tcfit_app.cli.{module}")


def _fit(options: FitOptions, command: str) -> None:
    module = _in("fit_command")
    (module.run_fit if options.people is None else module.run_fit_people)(options, command=command)


def _models(options: Models, command: str) -> None:
    if isinstance(options.action, ListModels):
        _in("models_command").list_models()
    elif options.action.paths:
        _in("models_command").register_models(options.action.paths, agreed=options.action.yes)
    else:
        raise InputError(
            "tcfit models add: no path given; expected model files, folders or downloaded archives, or a detector."
        )


def _settings(options: Settings, command: str) -> None:
    from fitting_core.config.toml import as_toml

    print(as_toml(fit_config(options.method), preset_name=options.method.preset or DEFAULT_PRESET), end="")


COMMANDS: dict[str, tuple[type, Callable[[Any, str], object]]] = {
    "fit": (FitOptions, _fit),
    "new": (NewOptions, lambda options, command: _in("new_command").make_project(options)),
    "review": (ReviewOptions, lambda options, command: _in("review_command").run_review(options)),
    "demo": (DemoOptions, lambda options, command: _in("demo_command").review_demo(options)),
    "detect": (DetectOptions, lambda options, command: _in("detect_command").run_detect(options)),
    "import": (ImportOptions, lambda options, command: _in("import_command").run_import(options)),
    "export": (ExportOptions, lambda options, command: _in("export_command").run_export(options)),
    "evaluate": (
        EvaluateOptions,
        lambda options, command: _in("evaluate_command").run_evaluate(options, command=command),
    ),
    "batch": (BatchOptions, lambda options, command: _in("batch_command").run_batch(options, command=command)),
    "models": (Models, _models),
    "settings": (Settings, _settings),
    "doctor": (Doctor, lambda options, command: _in("doctor").doctor()),
}
"""Each command's options, and what runs it: given these and the command line as text, for records. An int that it
returns is the exit code."""


def parse(arguments: Sequence[str]) -> Any:
    """The options that a command line, without the program's name, stands for. Raises SystemExit if it asks for help,
    or is wrong; either has been printed."""
    options: Any = Union[tuple(Annotated[kind, subcommand(name)] for name, (kind, _) in COMMANDS.items())]  # noqa: UP007
    with registry_of_hints():
        return tyro.cli(
            options,
            args=arguments,
            prog="tcfit",
            description="Fit SMPL-X bodies to monocular video, consistently over time (version: tcfit --version).",
            config=(OmitArgPrefixes, OmitSubcommandPrefixes),
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line.

    Args:
        arguments: Without the program's name; None: those of this process.

    Returns:
        The exit code: 0, 1 if `doctor` found something missing or clips of `batch` have failed, or one in ending.py.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    prepare_streams()
    if not _tells_events(given):
        return ended(lambda: _run(given))

    def run() -> int | None:
        emit(Started(schema=SCHEMA, command=given[0], version=version()))
        return _run(given)

    with json_lines() as end:
        return end(ended(run))


def _tells_events(given: list[str]) -> bool:
    kind, _ = COMMANDS.get(given[0] if given else "", (None, None))
    return OPTION in given and getattr(kind, "json", None) is False


def _run(given: list[str]) -> int | None:
    if given == ["--version"]:
        print(f"tcfit {version() or 'of unknown version: it is not installed'}")
        return None
    os.getcwd()  # fails where that folder is gone, in which torch's libraries end the process
    check_removed(given)
    options = parse(given)
    _check_paths(options)
    run = dict(COMMANDS.values())[type(options)]
    share_heaps()
    code = run(options, legible(shlex.join(["tcfit", *given])))
    return code if isinstance(code, int) else None


# --- impossible paths, refused before anything is read ---

_LONGEST_NAME, _LONGEST = 255, 4095
"""Bytes of a file's name and of a path, as Linux has them."""
_NAMES_OR_PATHS = ("body_model", "detector")
"""Options that take a name or a path."""
_PRIOR = "pose_prior="
"""A value of --set that may name a file."""


def _check_paths(options: Any) -> None:
    """Raise InputError for a path that is too long or not UTF-8.

    Results store the paths of their input, and OpenCV, SQLite and JSON accept only UTF-8. Without this check, such a
    name failed only after the fit.

    Args:
        options: A command's, with those of its groups.
    """
    for path in _paths_in(options):
        if why := _fault(path):
            raise InputError(f"{legible(str(path))[:200]}: {why}")


def _paths_in(options: Any) -> Iterator[Path]:
    if isinstance(options, Path):
        yield options
    elif isinstance(options, str):
        if options.startswith(_PRIOR):
            yield Path(options.removeprefix(_PRIOR))
    elif isinstance(options, tuple):
        for value in options:
            yield from _paths_in(value)
    elif is_dataclass(options):
        for one in fields(options):
            value = getattr(options, one.name)
            yield from _paths_in(Path(value) if one.name in _NAMES_OR_PATHS and value else value)


def _fault(path: Path) -> str:
    """Why the path is impossible; empty if it is not."""
    written = os.fsencode(path)
    if b"\0" in written:
        return "has a null character, which no path can have."
    if any(len(part) > _LONGEST_NAME for part in written.split(b"/")) or len(written) > _LONGEST:
        return f"is too long; expected names of at most {_LONGEST_NAME} bytes, and {_LONGEST} for the whole path."
    try:
        written.decode("utf-8")
    except UnicodeDecodeError:
        return "has a name that is not UTF-8. Rename it."
    try:
        path.stat()
    except OSError as error:  # other problems are reported where the path is used
        if error.errno == errno.ELOOP:
            return "is a link that leads to itself. Choose another place."
    return ""
