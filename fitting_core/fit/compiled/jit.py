"""How kernels are compiled, and where the result is stored."""

import atexit
import hashlib
import inspect
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

import platformdirs

from fitting_core.files.atomic import scratch_folder
from fitting_core.files.regular import at_home

# "nnan" and "ninf" stay off: points behind the camera and failed solves are represented by infinity and NaN.
_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "reassoc", "nsz", "arcp"}, "error_model": "numpy"}
FOLDER_VARIABLE = "TCFIT_KERNELS"
"""Environment variable for the folder of compiled kernels: one shared by several users, or part of an image."""
_SOURCES = ("compiled", "terms", "fused")
"""Folders of `fit` with compiled functions."""
_HAS_DOCSTRING: int = getattr(inspect, "CO_HAS_DOCSTRING", inspect.CO_OPTIMIZED)
"""Flag of a function's code. Before Python 3.14, one without a docstring has None in its place."""
_helpers: list[Callable] = []
"""Kernels not registered with numba yet. It is imported with the first kernel, because that takes 0.7 s, which code
that only inspects a term should not wait for."""


@cache
def kept_in() -> Path:
    """The folder of this version's compiled kernels.

    One for each installation, Python, processor and state of the code: numba itself distinguishes all these, but
    checks only a kernel's own file, not the helpers compiled into it.
    """
    import llvmlite.binding
    import numba

    sources = Path(__file__).resolve().parents[1]
    processor = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag} {processor} {sources}".encode())
    for source in sorted(path for folder in _SOURCES for path in (sources / folder).glob("*.py")):
        module = SourceFileLoader(source.stem, str(source)).get_code(source.stem)
        assert module is not None, f"{source} has code"
        for part in code_parts(module):
            digest.update(part.encode())
    given = os.environ.get(FOLDER_VARIABLE)
    parent = at_home(given) if given else platformdirs.user_cache_path("tcfit") / "kernels"
    return parent / digest.hexdigest()[:16]


def code_parts(code: CodeType) -> Iterator[str]:
    """Everything that a module's code does, as text: comments, docstrings and (outside classes) lines do not count."""
    yield f"{code.co_name} {code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars}"
    # Where a code object has a docstring, it is the first constant. Comprehensions and lambdas have none.
    named = not code.co_name.startswith("<")
    documented = "__doc__" in code.co_names or (named and bool(code.co_flags & _HAS_DOCSTRING))
    for position, value in enumerate(code.co_consts):
        if isinstance(value, CodeType):
            yield from code_parts(value)
        elif not (documented and position == 0):
            # The order of a set of strings differs between processes.
            yield repr(sorted(value, key=repr) if isinstance(value, frozenset) else value)


@cache
def _folder() -> Path:
    """That folder if it is writable, as numba requires; otherwise a temporary copy for this process."""
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
    """A function called by kernels; it is compiled with each of them, and stays a plain function for Python."""
    _helpers.append(function)
    return function


def kernel(function: Callable) -> Any:
    """A function called from Python: compiled once and cached, and run without the global interpreter lock.

    Define it after all helpers it calls: they are registered with numba here.
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
