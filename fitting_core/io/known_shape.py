"""A shape that is already known: betas from a result of tcfit, or from any npz or JSON that has them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fitting_core.body.files.former import same_shapes
from fitting_core.body.model import N_BETAS
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.files.regular import StrPath, regular_file
from fitting_core.io.result_files import FIT_NAME
from fitting_core.results.given_start import KnownShape

_MOST = 64 * 2**20
"""Bytes of a JSON file with ten numbers and other content."""
_LARGEST = 50.0
"""Betas are standard deviations among people; larger values are something else."""
_EXPECTED = f"expected a result of tcfit, or an npz or JSON file with {N_BETAS} betas"


def read_known_shape(path: StrPath, *, body_hash: str = "") -> KnownShape:
    """The shape of a result's folder, its fit.npz or summary.json, or another npz or JSON file with `betas`.

    Of more than ten betas, as in AMASS, the first ten are taken: they are ordered by how much of a shape they explain.

    Args:
        path: Folder or file.
        body_hash: Of the body model that is to have the shape; a file that was made with another one is refused. Empty:
            it is not compared.

    Raises:
        InputError: The file is missing, has no betas, or those of another body.
    """
    path = Path(path)
    file = path / FIT_NAME if path.is_dir() else path
    try:
        reader = _READERS.get(file.suffix.lower())
        if reader is None:
            raise ValueError("it is neither npz nor JSON")
        betas, made_with = reader(file)
        found = np.asarray(betas, float)
        found = found[0] if found.ndim == 2 and len(found) == 1 else found
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{file}: has no shape ({_told(error)}); {_EXPECTED}.") from error
    if found.ndim != 1 or len(found) < N_BETAS or not (np.abs(found) < _LARGEST).all():
        raise InputError(f"{file}: its betas are of the shape {found.shape} or no numbers near 0; {_EXPECTED}.")
    if body_hash and made_with and not same_shapes(made_with, body_hash):
        raise InputError(
            f"{file}: its betas belong to another body model, where they mean another shape. Fit with the body that it "
            "was made with, or find the shape again."
        )
    return KnownShape(betas=found[:N_BETAS].copy(), source=path.name)


def _of_npz(file: Path) -> tuple[Any, str]:
    arrays = read_npz(file, ("betas", "body_hash"))
    return arrays["betas"], str(arrays.get("body_hash", ""))


def _of_json(file: Path) -> tuple[Any, str]:
    content = msgspec.json.decode(regular_file(file, most=_MOST).read_bytes(), type=dict[str, Any])
    body = content.get("body")
    return content["betas"], str(body.get("hash", "")) if isinstance(body, dict) else ""


_READERS: dict[str, Callable[[Path], tuple[Any, str]]] = {".npz": _of_npz, ".json": _of_json}


def _told(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return f"lacks {error}" if isinstance(error, KeyError) else str(error)
