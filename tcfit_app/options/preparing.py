"""What a fit needs before it begins: its body, a working device, a folder that may be written."""

import os
import sys
from pathlib import Path

import torch

from fitting_core.body.files.registry import find_body
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError, some_of
from fitting_core.files.regular import at_home
from fitting_core.fit.fused import ready
from fitting_core.io.result_files import is_result
from fitting_core.shipped import FREE_FOLDER
from tcfit_app.options.fit import BodyOptions

MOST_THREADS = 256
"""More than this is a typing error."""


def check_out(folder: Path, *, overwrite: bool) -> None:
    """Refuse to write among files that are not tcfit's. Raises InputError if the folder is a file, cannot be written,
    or holds something other than a result and `overwrite` is not given."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder, which need not exist.")
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(there, os.W_OK):
        raise InputError(
            f"--out {folder}: cannot be written, for {there} is read-only. Allow writing, or choose another."
        )
    if overwrite or is_result(folder) or not folder.exists() or not any(folder.iterdir()):
        return
    names = sorted(entry.name for entry in folder.iterdir())
    raise InputError(
        f"--out {folder}: holds files that are not a result of tcfit ({some_of(names, most=4)}). "
        "Choose another folder, or give --overwrite to write the result among them."
    )


def prepare_solver(config: FitConfig, threads: int) -> None:
    """Set the threads of a fit (0: one for each core), and check that the device works.

    Torch itself computes on one: its operations are small, and threads that wait for each other took six times the CPU.

    Raises:
        InputError: The device is not there.
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
    """Compile the solver's kernels if this fit can use them and nobody has yet; to be called when all else is right."""
    if config.device == "cpu" and config.precision == "float64" and config.solver == "lm":
        ready.prepare(lambda text: print(text, file=sys.stderr, flush=True))


def body_file(options: BodyOptions) -> Path:
    """The body model's file. Raises InputError if there is none, or --models is given beside a path."""
    given = at_home(options.body_model)
    if not (given.suffix or given.exists() or len(given.parts) > 1):
        try:
            return find_body(model=options.body_model, gender=options.gender, search=options.models)
        except InputError as error:
            if not FREE_FOLDER.is_dir() or (options.body_model == "smplx" and options.models is None):
                raise
            raise InputError(f"{error} Or leave out --body-model and --models: there is a free body.") from error
    if options.models is not None:
        raise InputError(
            f"--body-model {given} is a file and --models {options.models} a folder to search: give one of them."
        )
    return find_body(gender=options.gender, search=given)
