"""The file of a free body."""

from pathlib import Path

import numpy as np

from fitting_core.files.atomic import replacing

BodyArrays = dict[str, np.ndarray]
"""The arrays of one file by their keys."""


def write_body(path: Path, arrays: BodyArrays) -> None:
    """Writes a body's file whole or not at all; equal arrays give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType] - it takes any key for an array
