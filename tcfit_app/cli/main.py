"""The command `tcfit`: reads the command line, runs one command, and turns its end into an exit code."""

import os
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Union

import tyro
from tyro.conf import OmitArgPrefixes, OmitSubcommandPrefixes, Positional, arg, subcommand

from fitting_core.config.schema import DEFAULT_PRESET
from fitting_core.errors import InputError
from fitting_core.files.regular import legible
from fitting_core.io.people_file import holds_people
from tcfit_app.cli.ending import ended, prepare_streams
from tcfit_app.cli.json_lines import OPTION, SCHEMA, Started, emit, json_lines, version
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.detect import DetectOptions
from tcfit_app.options.evaluate import EvaluateOptions
from tcfit_app.options.export import LIST, ExportOptions
from tcfit_app.options.fit import DemoOptions, FitOptions, MethodOptions, NewOptions, ReviewOptions, fit_config
from tcfit_app.options.import_ import ImportOptions
from tcfit_app.options.paths import check_paths
from tcfit_app.options.render import RenderOptions


@dataclass(frozen=True, kw_only=True)
class ListModels:
    """Show the models and networks on this computer (the default)."""


@dataclass(frozen=True, kw_only=True)
class AddModels:
    """Copy body models to where tcfit finds them, or fetch the embedded detector's networks."""

    paths: Annotated[Positional[tuple[Path, ...]], arg(metavar="PATH")]
    """Model files, folders, or archives as downloaded. The word mediapipe fetches the detector's networks."""
    yes: bool = False
    """Agree to the download beforehand."""


@dataclass(frozen=True, kw_only=True)
class Models:
    """Show the body models and networks on this computer, or add to them."""

    action: Annotated[ListModels, subcommand("list")] | Annotated[AddModels, subcommand("add")] = field(
        default_factory=ListModels
    )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Print every setting of the method with its value and meaning, as a file for --config."""

    method: MethodOptions = field(default_factory=MethodOptions)


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Show what works on this computer, and what to install for the rest."""


def _fit(options: FitOptions, command: str) -> None:
    if options.people is not None:
        from tcfit_app.cli.fit_people import run_fit_people

        run_fit_people(options, command=command)
        return
    from tcfit_app.cli.fit_command import run_fit

    run_fit(options, command=command)


def _new(options: NewOptions, command: str) -> None:
    from tcfit_app.cli.new_command import make_project

    make_project(options)


def _review(options: ReviewOptions, command: str) -> None:
    from tcfit_app.cli.review_command import run_review

    run_review(options)


def _export(options: ExportOptions, command: str) -> None:
    if options.path is not None and options.formats != (LIST,) and holds_people(options.path):
        from tcfit_app.cli.export_people import run_export_people

        run_export_people(options.path, options)
        return
    from tcfit_app.cli.export_command import run_export

    run_export(options)


def _render(options: RenderOptions, command: str) -> None:
    from tcfit_app.cli.render_command import run_render

    run_render(options)


def _import(options: ImportOptions, command: str) -> None:
    from tcfit_app.cli.import_command import run_import

    run_import(options)


def _demo(options: DemoOptions, command: str) -> None:
    from tcfit_app.cli.demo_command import review_demo, run_demo

    if options.review:
        review_demo(options)
    else:
        run_demo(options, command=command)


def _detect(options: DetectOptions, command: str) -> None:
    from tcfit_app.cli.detect_command import run_detect

    run_detect(options)


def _evaluate(options: EvaluateOptions, command: str) -> None:
    from tcfit_app.cli.evaluate_command import run_evaluate

    run_evaluate(options, command=command)


def _batch(options: BatchOptions, command: str) -> int:
    from tcfit_app.cli.batch_command import run_batch

    return run_batch(options, command=command)


def _models(options: Models, command: str) -> None:
    from tcfit_app.cli.models_command import list_models, register_models

    if isinstance(options.action, ListModels):
        list_models()
    elif options.action.paths:
        register_models(list(options.action.paths), agreed=options.action.yes)
    else:
        raise InputError(
            "tcfit models add: no path given; expected model files, folders or downloaded archives, or the word "
            "mediapipe."
        )


def _settings(options: Settings, command: str) -> None:
    from fitting_core.config.toml import as_toml

    print(as_toml(fit_config(options.method), preset_name=options.method.preset or DEFAULT_PRESET), end="")


def _doctor(options: Doctor, command: str) -> int:
    from tcfit_app.cli.doctor import doctor

    return doctor()


COMMANDS: dict[str, tuple[type, Callable[[Any, str], int | None]]] = {
    "fit": (FitOptions, _fit),
    "new": (NewOptions, _new),
    "review": (ReviewOptions, _review),
    "demo": (DemoOptions, _demo),
    "detect": (DetectOptions, _detect),
    "import": (ImportOptions, _import),
    "export": (ExportOptions, _export),
    "render": (RenderOptions, _render),
    "evaluate": (EvaluateOptions, _evaluate),
    "batch": (BatchOptions, _batch),
    "models": (Models, _models),
    "settings": (Settings, _settings),
    "doctor": (Doctor, _doctor),
}
"""Each command's options, and what runs on them and may return an exit code; every function imports what it needs, so
that --help stays quick."""


def parse(arguments: Sequence[str]) -> Any:
    """The options that a command line, without the program's name, stands for.

    Raises:
        SystemExit: It asks for help, or is wrong; either has been printed.
    """
    options: Any = Union[tuple(Annotated[kind, subcommand(name)] for name, (kind, _) in COMMANDS.items())]  # noqa: UP007
    return tyro.cli(
        options,
        args=arguments,
        prog="tcfit",
        description="Fit SMPL-X bodies to monocular video, consistently over time.",
        config=(OmitArgPrefixes, OmitSubcommandPrefixes),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line.

    Args:
        arguments: Without the program's name; None: those of this process.

    Returns:
        The exit code: 0, 1 if `doctor` found something missing or clips of `batch` have failed, or one of those in
        ending.py.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    prepare_streams()
    if not _tells_events(given):
        return ended(lambda: _run(given))
    with json_lines(given[0]) as end:
        return end(ended(lambda: _run_told(given)))


def _tells_events(given: list[str]) -> bool:
    """Whether events are asked for."""
    kind, _ = COMMANDS.get(given[0] if given else "", (None, None))
    return OPTION in given and getattr(kind, "json", None) is False


def _run_told(given: list[str]) -> int | None:
    emit(Started(schema=SCHEMA, command=given[0], version=version()))
    return _run(given)


def _run(given: list[str]) -> int | None:
    os.getcwd()  # fails where that folder is gone, in which torch's libraries end the process
    options = parse(given)
    check_paths(options)
    run = dict(COMMANDS.values())[type(options)]
    return run(options, legible(shlex.join(["tcfit", *given])))
