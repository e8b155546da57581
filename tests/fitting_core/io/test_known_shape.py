"""A shape that is known: the files that may say it, and those that do not."""

import json
from pathlib import Path

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.io.known_shape import read_known_shape

BETAS = [0.1 * i for i in range(10)]


@pytest.mark.parametrize("shape", [(10,), (1, 10), (16,)])
def test_npz_and_json_are_read(tmp_path: Path, shape: tuple[int, ...]):
    betas = np.resize([*BETAS, *[9.0] * 6][: shape[-1]], shape)
    np.savez(tmp_path / "fit.npz", betas=betas, poses=np.zeros((3, 165)))
    (tmp_path / "shape.json").write_text(json.dumps({"betas": betas.tolist(), "frames": {"a": [1]}}))
    for path in (tmp_path / "fit.npz", tmp_path, tmp_path / "shape.json"):
        assert np.allclose(read_known_shape(path).betas, BETAS) and read_known_shape(path).source == path.name


def test_the_shape_of_another_body_is_refused(tmp_path: Path):
    (tmp_path / "shape.json").write_text(json.dumps({"betas": BETAS, "body": {"hash": "ours", "kind": "smplx"}}))
    np.savez(tmp_path / "fit.npz", betas=BETAS, body_hash="ours")
    for path in (tmp_path / "shape.json", tmp_path / "fit.npz"):
        assert np.allclose(read_known_shape(path, body_hash="ours").betas, BETAS)
        with pytest.raises(InputError, match="belong to another body model"):
            read_known_shape(path, body_hash="another")


WRONG = {
    "nothing.npz": (None, "No such file"),
    "cut.npz": (b"PK\x03\x04", "not a complete npz"),
    "motion.npz": ({"poses": np.zeros((2, 165))}, "lacks 'betas'"),
    "frames.npz": ({"betas": np.zeros((7, 10))}, r"of the shape \(7, 10\)"),
    "few.npz": ({"betas": np.zeros(5)}, r"of the shape \(5,\)"),
    "huge.npz": ({"betas": np.full(10, 1e9)}, "no numbers near 0"),
    "words.npz": ({"betas": np.array(["a"] * 10)}, "could not convert"),
    "text.json": (b"{", "has no shape"),
    "list.json": (b"[1, 2]", "has no shape"),
    "other.json": (b'{"height": 1.7}', "lacks 'betas'"),
    "null.json": (b'{"betas": null}', "of the shape"),
    "nan.json": (b'{"betas": [null, 0, 0, 0, 0, 0, 0, 0, 0, 0]}', "no numbers near 0"),
    "photo.jpg": (b"", "neither npz nor JSON"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_shape_is_told(tmp_path: Path, name: str):
    content, said = WRONG[name]
    path = tmp_path / name
    if isinstance(content, dict):
        np.savez(path, **content)
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=said) as refused:
        read_known_shape(path)
    assert str(path) in str(refused.value) and "10 betas" in str(refused.value)
