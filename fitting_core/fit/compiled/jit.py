"""How the kernels are compiled, and where the result is kept."""

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

from fitting_core.files.atomic import scratch_folder
from fitting_core.files.regular import at_home

# NaN and infinity are told apart (no "nnan", "ninf"): costs beyond the camera and failed solves are such numbers.
_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "reassoc", "nsz", "arcp"}, "error_model": "numpy"}
FOLDER_VARIABLE = "TCFIT_KERNELS"
"""Names another folder for what was compiled: one that several users share, or that comes with an image."""
_SOURCES = ("compiled", "terms", "fused")
"""Folders of `fit` whose files hold functions that are compiled."""
_helpers: list[Callable] = []
"""Those that numba does not know yet. It is imported with the first kernel: that takes 0.7 s, and whoever only looks at
a term shall not wait for it."""


@cache
def kept_in() -> Path:
    """Where this version's kernels are kept once they are compiled.

    A folder for each installation, Python, processor and state of the sources: numba itself tells all these
    apart, but looks at the file of a kernel alone, and not at the helpers that are compiled into it.
    """
    import llvmlite.binding
    import numba

    sources = Path(__file__).resolve().parents[1]
    processor = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag} {processor} {sources}".encode())
    for source in sorted(path for folder in _SOURCES for path in (sources / folder).glob("*.py")):
        digest.update(source.read_bytes())
    given = os.environ.get(FOLDER_VARIABLE)
    parent = at_home(given) if given else platformdirs.user_cache_path("tcfit") / "kernels"
    return parent / digest.hexdigest()[:16]


@cache
def _folder() -> Path:
    """The same where it can be written, as numba wants it; else a copy that goes with the process."""
    folder = kept_in()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        scratch = ExitStack()
        copy = scratch.enter_context(scratch_folder())
        atexit.register(scratch.close)
        if folder.is_dir():
            shutil.copytree(folder, copy, dirs_exist_ok=True)
        return copy
    return folder


def helper(function: Callable) -> Any:
    """A function that kernels call; it is compiled with each of them, and stays a plain one for Python."""
    _helpers.append(function)
    return function


def kernel(function: Callable) -> Any:
    """A function that Python calls: compiled once and kept, and other threads run meanwhile.

    It stands behind all helpers that it calls: numba is told of them here.
    """
    import numba
    from numba.extending import register_jitable

    while _helpers:
        register_jitable(**_OPTIONS)(_helpers.pop())
    config: Any = numba.config  # pyright: ignore[reportPrivateImportUsage]
    before, config.CACHE_DIR = config.CACHE_DIR, str(_folder())
    try:
        return numba.njit(nogil=True, cache=True, **_OPTIONS)(function)
    finally:
        config.CACHE_DIR = before
