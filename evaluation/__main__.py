"""`python -m evaluation`: the method on clips of known truth, and the generator of the demo clip."""

import shlex
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import tyro
from tyro.conf import OmitSubcommandPrefixes, subcommand

from evaluation.options import ActedOptions, DemoOptions, MotionOptions
from fitting_core.errors import InputError
from tcfit_app.cli.ending import ended

Options = (
    Annotated[ActedOptions, subcommand("acted")]
    | Annotated[MotionOptions, subcommand("motion")]
    | Annotated[DemoOptions, subcommand("demo")]
)
_MODULES = {ActedOptions: "acted", MotionOptions: "motion", DemoOptions: "synthetic.demo_clip"}
"""Each has `run`, which takes the options and the command's text."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, without the program's name; None: that of this process. Returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    return ended(lambda: _run(given))


def _run(given: list[str]) -> None:
    options = tyro.cli(
        Options, args=given, prog="python -m evaluation", description=__doc__, config=(OmitSubcommandPrefixes,)
    )
    for name in ("every", "jobs"):
        if getattr(options, name, 1) < 1:
            raise InputError(f"--{name} is {getattr(options, name)}; expected 1 or more.")
    import_module(f"evaluation.{_MODULES[type(options)]}").run(options, shlex.join(["evaluation", *given]))


if __name__ == "__main__":
    sys.exit(main())
