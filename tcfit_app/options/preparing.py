"""Preparation of a fit: body, device, output folder, compiled kernels."""

import os
import sys
from pathlib import Path

import torch

from fitting_core.body.files.registry import find_body
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import sweep
from fitting_core.files.regular import at_home
from fitting_core.fit.fused import ready
from fitting_core.io.result_files import RESULT_NAMES, is_result
from fitting_core.shipped import FREE_FOLDER
from tcfit_app.options.fit import BodyOptions

MOST_THREADS = 256
"""More than this is a typing error."""


def check_out(folder: Path, *, overwrite: bool) -> None:
    """Raise InputError if the output folder is a file, cannot be written, or contains other files than a result and
    `overwrite` is not given."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder, which may not exist yet.")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(there, os.W_OK):
        raise InputError(
            f"--out {folder}: cannot be written, because {there} is read-only. Allow writing, or choose another folder."
        )
    if overwrite or is_result(folder) or not folder.exists():
        return
    sweep(folder)  # delete the remains of killed processes
    if names := sorted(entry.name for entry in folder.iterdir() if entry.name not in RESULT_NAMES):
        raise InputError(
            f"--out {folder}: contains files that are not a result of tcfit ({some_of(names, most=4)}). "
            "Choose another folder, or give --overwrite to write the result beside them."
        )


def prepare_solver(config: FitConfig, threads: int) -> None:
    """Set the threads of a fit (0: one for each core), and check the device.

    Torch uses one thread: its operations are small, and two threads took six times the processor time.

    Raises:
        InputError: The device does not work.
    """
    if not 0 <= threads <= MOST_THREADS:
        raise InputError(f"--threads is {threads}; expected 0 (one for each core) to {MOST_THREADS}.")
    torch.set_num_threads(1)
    ready.use(threads=threads)
    try:
        torch.zeros(1, device=config.device, dtype=getattr(torch, config.precision))
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"--device {config.device} cannot be used with {config.precision} ({reason}). Use --device cpu; "
            "`tcfit doctor` shows the devices that torch finds."
        ) from error


def compile_kernels(config: FitConfig) -> None:
    """Compile the solver's kernels if this fit can use them and they are not compiled yet. Call it last."""
    if config.device == "cpu" and config.precision == "float64" and config.solver == "lm":
        ready.prepare(lambda text: print(text, file=sys.stderr, flush=True))


def body_file(options: BodyOptions) -> Path:
    """The body model's file. Raises InputError if it is missing, or --models is given beside a path."""
    given = at_home(options.body_model)
    if not (given.suffix or given.exists() or len(given.parts) > 1):
        try:
            return find_body(model=options.body_model, gender=options.gender, search=options.models)
        except InputError as error:
            if not FREE_FOLDER.is_dir() or (options.body_model == "smplx" and options.models is None):
                raise
            raise InputError(f"{error} Or leave out --body-model and --models to use the free body.") from error
    if options.models is not None:
        raise InputError(f"--body-model {given}, a file, cannot be combined with --models {options.models}.")
    return find_body(gender=options.gender, search=given)
