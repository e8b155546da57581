"""Body model files for tests: every form that users bring, on a mesh as small as the form allows."""

import io
import pickle
import sys
import types
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse

from fitting_core.body.files.forms import KINDS
from fitting_core.body.model import SURFACE_KEYPOINTS

VERTICES = 60
FACES = 40


def body_arrays(
    kind: str = "smplx", *, vertices: int = VERTICES, columns: int | None = None, hands: bool = True, seed: int = 0
) -> dict[str, np.ndarray]:
    """Arrays of a body file with random numbers; a mesh that is not the official one names its keypoint vertices."""
    rng = np.random.default_rng(seed)
    form = KINDS[kind]
    joints = len(form.joints)
    weights = rng.random((vertices, joints)) * (rng.random((vertices, joints)) < 0.1) + 1e-3
    regressor = rng.random((joints, vertices)) * (rng.random((joints, vertices)) < 0.1) + 1e-4
    arrays: dict[str, np.ndarray] = {
        "v_template": rng.uniform(-0.9, 0.9, (vertices, 3)),
        "shapedirs": rng.normal(0, 0.01, (vertices, 3, columns or (20 if kind == "smplx" else 10))),
        "posedirs": rng.normal(0, 0.001, (vertices, 3, 9 * (joints - 1))),
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "kintree_table": np.stack([np.array(form.parents), np.arange(joints)]).astype(np.uint32),
        "f": rng.integers(0, vertices, (FACES, 3)).astype(np.uint32),
    }
    if vertices < form.vertices:
        arrays["keypoint_vertices"] = np.arange(len(SURFACE_KEYPOINTS))
    if hands and kind != "smpl":
        arrays |= {f"hands_components{s}": np.linalg.qr(rng.normal(size=(45, 45)))[0] for s in "lr"}
        arrays |= {f"hands_mean{s}": rng.normal(0, 0.1, 45) for s in "lr"}
    if kind == "smplx":
        arrays |= _landmarks(rng)
    return arrays


def full_size_body(kind: str, **options: Any) -> dict[str, np.ndarray]:
    """A body with as many vertices as the official mesh, all zeros but for its first ones: quick to write."""
    small, vertices = body_arrays(kind, **options), KINDS[kind].vertices
    full = {key: value for key, value in small.items() if key != "keypoint_vertices"}
    for key in ("v_template", "shapedirs", "posedirs"):
        full[key] = np.zeros((vertices, *small[key].shape[1:]), dtype=np.float32)
        full[key][:VERTICES] = small[key]
    full["weights"] = np.zeros((vertices, small["weights"].shape[1]))
    full["weights"][:, 0] = 1
    full["J_regressor"] = np.zeros((small["weights"].shape[1], vertices))
    full["J_regressor"][:, :VERTICES] = small["J_regressor"]
    return full


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)
    return path


def write_pickle(path: Path, arrays: dict[str, Any], *, protocol: int = 2) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(arrays, protocol=protocol))
    return path


def write_smpl_pickle(path: Path, arrays: dict[str, Any]) -> Path:
    """As the official SMPL pickles are: sparse regressor, chumpy arrays, a selection, and a computed expression."""
    with fake_chumpy() as chumpy:
        wide = np.concatenate([arrays["shapedirs"], np.ones((*arrays["shapedirs"].shape[:2], 2))], axis=2)
        flat = np.arange(wide.size).reshape(wide.shape)[:, :, :-2].reshape(-1)
        content = arrays | {
            "J_regressor": scipy.sparse.csc_matrix(arrays["J_regressor"]),
            "weights": chumpy.ch.Ch(x=arrays["weights"], _dirty_vars={"x"}),
            "posedirs": chumpy.ch.Ch(x=arrays["posedirs"]),
            "v_template": chumpy.ch.Ch(x=arrays["v_template"]),
            "shapedirs": chumpy.reordering.Select(
                a=chumpy.ch.Ch(x=wide), idxs=flat, preferred_shape=arrays["shapedirs"].shape
            ),
            "J": chumpy.reordering.transpose(a=chumpy.ch.MatVecMult(mtx=1), axes=None),
            "bs_style": "lbs",
        }
        return write_pickle(path, content)


@contextmanager
def fake_chumpy():
    """Modules under chumpy's names, only while a pickle is written, with classes that pickle as its own do."""

    def init(self: Any, **state: Any) -> None:
        self.__dict__.update(state)

    modules = {name: types.ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")}
    for module, name in (("ch", "Ch"), ("ch", "MatVecMult"), ("reordering", "Select"), ("reordering", "transpose")):
        owner = modules[f"chumpy.{module}"]
        setattr(owner, name, type(name, (), {"__init__": init, "__module__": owner.__name__}))
        setattr(modules["chumpy"], module, owner)
    sys.modules.update(modules)
    try:
        yield modules["chumpy"]
    finally:
        for name in modules:
            del sys.modules[name]


def python2_pickle(arrays: dict[str, np.ndarray]) -> bytes:
    """The bytes that Python 2 and its numpy wrote (protocol 2, byte strings, modules of old)."""
    out = io.BytesIO()
    out.write(b"\x80\x02}(")
    for key, value in arrays.items():
        out.write(_python2_string(key.encode()) + _python2_array(value))
    out.write(b"u.")
    return out.getvalue()


def _python2_string(text: bytes) -> bytes:
    return b"T" + len(text).to_bytes(4, "little") + text


def _python2_int(number: int) -> bytes:
    return b"J" + number.to_bytes(4, "little", signed=True)


def _python2_array(value: np.ndarray) -> bytes:
    code = value.dtype.str[1:].encode()
    dtype = b"cnumpy\ndtype\n" + _python2_string(code) + b"K\x00K\x01\x87R(K\x03" + _python2_string(b"<")
    dtype += b"NNN" + _python2_int(-1) + _python2_int(-1) + b"K\x00tb"
    empty = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85" + _python2_string(b"b") + b"\x87R"
    shape = b"(" + b"".join(_python2_int(n) for n in value.shape) + b"t"
    return empty + b"(K\x01" + shape + dtype + b"\x89" + _python2_string(value.tobytes()) + b"tb"


def _landmarks(rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {
        "lmk_faces_idx": rng.integers(0, FACES, 51),
        "lmk_bary_coords": rng.dirichlet((1, 1, 1), 51),
        "dynamic_lmk_faces_idx": rng.integers(0, FACES, (79, 17)),
        "dynamic_lmk_bary_coords": rng.dirichlet((1, 1, 1), (79, 17)),
    }
