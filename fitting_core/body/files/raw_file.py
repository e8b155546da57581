"""Open a body model file, npz or pickle, and hand out its arrays checked."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.errors import InputError, some_of
from fitting_core.files.npz import npz_names, read_npz
from fitting_core.files.pickles import MAX_BYTES, as_array, read_pickle
from fitting_core.files.regular import refusal

REQUIRED = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
HAND_KEYS = ("hands_componentsl", "hands_componentsr", "hands_meanl", "hands_meanr")
LANDMARKS = ("lmk_faces_idx", "lmk_bary_coords", "dynamic_lmk_faces_idx", "dynamic_lmk_bary_coords")
OWN_KEYPOINTS = "keypoint_vertices"
"""Optional key for a mesh that is not the official one: a vertex for each of SURFACE_KEYPOINTS, -1 for none."""
KEYS = (*REQUIRED, *HAND_KEYS, *LANDMARKS, OWN_KEYPOINTS, "gender")
ADVICE = "Download the model again from its official site, or run `tcfit models` to see the bodies found here."


@dataclass(frozen=True, kw_only=True)
class RawFile:
    """The unchecked content of a file."""

    path: Path
    values: dict[str, Any]
    """By key; None for keys that are not needed here."""
    hash: str
    """SHA-256 of the file."""

    def error(self, problem: str, advice: str = ADVICE) -> InputError:
        """An error to raise about this file: what was found and expected, and what to do."""
        return InputError(f"{self.path}: {problem}. {advice}")

    def array(self, key: str, shape: tuple[int | None, ...]) -> np.ndarray:
        """The array of a key. Raises InputError if it is not an array of finite numbers of this shape (None: any)."""
        try:
            value = as_array(self.values[key])
        except InputError as error:
            raise self.error(f"'{key}' is {error}") from error
        if value.dtype.kind not in "fiu":
            raise self.error(
                f"'{key}' holds {value.dtype} values, expected numbers",
                "Save it again as a plain numeric array (numpy.asarray(..., dtype=float)).",
            )
        if value.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, value.shape, strict=True)):
            found = " x ".join(map(str, value.shape)) or "of a single number"
            expected = " x ".join("any" if n is None else str(n) for n in shape)
            raise self.error(f"'{key}' has the shape {found}, expected {expected}")
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            bad = value.size - int(np.isfinite(value).sum())
            raise self.error(f"'{key}' holds {bad} values that are not finite (NaN or infinity), expected none")
        return value

    def floats(self, key: str, shape: tuple[int | None, ...], *, least: int = 64) -> np.ndarray:
        """The array of a key as float64, checked as `array` does; with `least` 32 as float32 where it is stored so."""
        value = self.array(key, shape)
        kind = value.dtype if value.dtype in (np.float32, np.float64) and least == 32 else np.float64
        return np.ascontiguousarray(value, dtype=kind)

    def indices(self, key: str, shape: tuple[int | None, ...], *, limit: int, first: int = 0) -> np.ndarray:
        """The array of a key as int64. Raises InputError as `array` does, or if its values are not whole numbers from
        first to below limit."""
        value = self.array(key, shape)
        whole = value.astype(np.int64)
        if (whole != value).any() or (value.size and (whole.min() < first or whole.max() >= limit)):
            found = f"values from {value.min()} to {value.max()}"
            raise self.error(f"'{key}' holds {found}, expected whole numbers from {first} to {limit - 1}")
        return whole


def read_raw(path: Path) -> RawFile:
    """Open a body model file. Raises InputError if the file is missing, unreadable, damaged, or lacks arrays that every
    body model has."""
    values, digest = _values(path, KEYS)
    raw = RawFile(path=path, values=values, hash=digest)
    _check_keys(raw)
    return raw


def vertex_count(path: Path) -> int:
    """Number of a body's vertices, of an npz file without reading the rest of it. Raises InputError if the file is
    missing, unreadable, damaged or no body model."""
    values, digest = _values(path, ("v_template",))
    raw = RawFile(path=path, values=values, hash=digest)
    _check_keys(raw)
    return len(raw.array("v_template", (None, 3)))


def _values(path: Path, keys: tuple[str, ...]) -> tuple[dict[str, Any], str]:
    """The file's values under these keys, None for its other keys, and its hash."""
    if not path.exists():
        raise InputError(f"{path}: does not exist, expected a body model file. {ADVICE}")
    if why := refusal(path, expected="a body model file"):
        raise InputError(f"{path}: {why}. {ADVICE}")
    if path.suffix.lower() not in BODY_READERS:
        expected = " or ".join(BODY_READERS)
        raise InputError(f"{path}: ends in '{path.suffix}', expected {expected}. Give the model file itself.")
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return BODY_READERS[path.suffix.lower()](path, keys), digest
    except ValueError as error:
        raise InputError(f"{path}: {error}. {ADVICE}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Check its permissions.") from error


def _read_npz(path: Path, keys: tuple[str, ...]) -> dict[str, Any]:
    """Only these keys: official files carry others (joint2num, part2num) that hold pickled objects."""
    arrays = read_npz(path, keys, most=MAX_BYTES)
    return {**dict.fromkeys(npz_names(path)), **arrays}


def _read_pickle(path: Path, keys: tuple[str, ...]) -> dict[str, Any]:
    with path.open("rb") as file:
        return {key: value if key in keys else None for key, value in read_pickle(file).items()}


BODY_READERS: dict[str, Callable[[Path, tuple[str, ...]], dict[str, Any]]] = {".npz": _read_npz, ".pkl": _read_pickle}
"""By the file's suffix."""


def _check_keys(raw: RawFile) -> None:
    if {"poses", "trans"} <= raw.values.keys():
        raise raw.error(
            "is a motion (it has 'poses' and 'trans'), expected a body model",
            "Give the model file itself, e.g. SMPLX_NEUTRAL.npz.",
        )
    missing = [key for key in REQUIRED if key not in raw.values]
    if missing:
        has = some_of(sorted(raw.values), most=12)
        raise raw.error(f"has no {', '.join(missing)} (it has {has}), expected a SMPL-X, SMPL-H or SMPL model")
