"""Body model files: every form reads into the same 55 joints, and what is wrong is said."""

import hashlib
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse

from fitting_core.body.files.forms import KINDS, plain_hand_components
from fitting_core.body.files.reading import load_body
from fitting_core.body.model import SURFACE_KEYPOINTS
from fitting_core.errors import InputError
from tests.samples.body_files import (
    VERTICES,
    body_arrays,
    fake_chumpy,
    full_size_body,
    python2_pickle,
    write_npz,
    write_pickle,
    write_smpl_pickle,
)

ARRAYS = [
    "template",
    "shape_directions",
    "expression_directions",
    "pose_directions",
    "joint_regressor",
    "skinning_weights",
    "hand_components",
    "hand_mean",
    "landmark_weights",
    "contour_weights",
]
INDICES = ["parents", "faces", "landmark_vertices", "contour_vertices"]


def test_smplx_arrays_are_those_of_the_file(tmp_path: Path):
    arrays = body_arrays("smplx")
    path = write_npz(tmp_path / "SMPLX_FEMALE.npz", arrays | {"joint2num": np.array({"pelvis": 0}, dtype=object)})
    body = load_body(path)
    assert (body.kind, body.gender, body.source) == ("smplx", "female", path)
    assert body.hash == hashlib.sha256(path.read_bytes()).hexdigest()
    np.testing.assert_array_equal(body.template, arrays["v_template"])
    np.testing.assert_array_equal(body.shape_directions, arrays["shapedirs"][:, :, :10])
    np.testing.assert_array_equal(body.expression_directions, arrays["shapedirs"][:, :, 10:])
    np.testing.assert_array_equal(body.pose_directions.reshape(-1, 3, 486), arrays["posedirs"])
    np.testing.assert_array_equal(body.joint_regressor, arrays["J_regressor"])
    np.testing.assert_array_equal(body.skinning_weights, arrays["weights"])
    np.testing.assert_array_equal(body.hand_components[1], arrays["hands_componentsr"])
    np.testing.assert_array_equal(body.hand_mean[0], arrays["hands_meanl"])
    np.testing.assert_array_equal(body.landmark_vertices, arrays["f"][arrays["lmk_faces_idx"]])
    np.testing.assert_array_equal(body.contour_vertices[40, 3], arrays["f"][arrays["dynamic_lmk_faces_idx"][40, 3]])
    assert all(getattr(body, name).dtype == np.float64 for name in ARRAYS)
    assert all(getattr(body, name).dtype == np.int64 for name in INDICES)


@pytest.mark.parametrize("kind", KINDS)
def test_official_meshes_have_their_keypoint_vertices(tmp_path: Path, kind: str):
    body = load_body(write_npz(tmp_path / "body.npz", full_size_body(kind)))
    nose, right_big_toe, left_thumb = {"smplx": (9120, 8463, 5361)}.get(kind, (332, 6617, 2746))
    assert tuple(body.surface_keypoints) == tuple(SURFACE_KEYPOINTS)
    assert body.surface_keypoints["nose"] == nose
    assert body.surface_keypoints["right_big_toe"] == right_big_toe
    assert body.surface_keypoints["left_thumb"] == left_thumb


def _posed(template, directions, regressor, weights, parents, rotations):
    """Linear blend skinning of any tree, written plainly: the reference for the conversion."""
    template = template + np.einsum("vcp,p->vc", directions, (rotations[1:] - np.eye(3)).reshape(-1))
    joints = regressor @ template
    transforms = []
    for j, parent in enumerate(parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] - (joints[parent] if parent >= 0 else 0)
        transforms.append(local if parent < 0 else transforms[parent] @ local)
    moved = np.stack(
        [t[:3, :3] @ (template.T - j[:, None]) + t[:3, 3:] for t, j in zip(transforms, joints, strict=True)]
    )
    return np.einsum("vj,jcv->vc", weights, moved)


@pytest.mark.parametrize("kind", ["smplh", "smpl"])
def test_posed_body_is_that_of_the_file(tmp_path: Path, kind: str):
    """The 55-joint form moves every vertex as the file's own joints would, SMPL's hands being rigid with the wrists."""
    arrays = body_arrays(kind)
    body = load_body(write_npz(tmp_path / f"{kind}_male.npz", arrays))
    form, rng = KINDS[kind], np.random.default_rng(1)
    vectors = rng.normal(0, 0.5, (55, 3))
    rotations = scipy.spatial.transform.Rotation.from_rotvec(vectors).as_matrix()
    own = np.stack([rotations[j] if i < form.kept else np.eye(3) for i, j in enumerate(form.joints)])
    expected = _posed(
        arrays["v_template"], arrays["posedirs"], arrays["J_regressor"], arrays["weights"], form.parents, own
    )
    directions = body.correctives_of(np.arange(len(body.template)))
    found = _posed(body.template, directions, body.joint_regressor, body.skinning_weights, body.parents, rotations)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_file_without_hands_gets_plain_ones(tmp_path: Path):
    body = load_body(write_npz(tmp_path / "SMPLH_male.npz", body_arrays("smplh", hands=False)))
    np.testing.assert_array_equal(body.hand_components[0], plain_hand_components())
    assert not body.hand_mean.any()


def _python3(path: Path, arrays: dict[str, Any], protocol: int) -> Path:
    return write_pickle(
        path, arrays | {"J_regressor": scipy.sparse.csc_matrix(arrays["J_regressor"])}, protocol=protocol
    )


def _big_endian(array: np.ndarray) -> np.ndarray:
    return array.astype(array.dtype.newbyteorder(">"))


def _big_endian_sparse(arrays: dict[str, Any]) -> Any:
    matrix = scipy.sparse.csc_matrix(arrays["J_regressor"])
    matrix.indices, matrix.indptr = _big_endian(matrix.indices), _big_endian(matrix.indptr)
    return matrix


PICKLES: dict[str, Callable[[Path, dict[str, Any]], Any]] = {
    **{f"protocol {n}": lambda path, arrays, n=n: _python3(path, arrays, n) for n in range(6)},
    "chumpy": write_smpl_pickle,
    "python 2": lambda path, arrays: path.write_bytes(python2_pickle(arrays)),
    "csr": lambda path, arrays: write_pickle(
        path, arrays | {"J_regressor": scipy.sparse.csr_matrix(arrays["J_regressor"])}
    ),
    "coo": lambda path, arrays: write_pickle(
        path, arrays | {"J_regressor": scipy.sparse.coo_matrix(arrays["J_regressor"])}
    ),
    "big-endian": lambda path, arrays: write_pickle(path, {key: _big_endian(a) for key, a in arrays.items()}),
    "big-endian sparse": lambda path, arrays: write_pickle(path, arrays | {"J_regressor": _big_endian_sparse(arrays)}),
    "fortran order": lambda path, arrays: write_pickle(path, {key: np.asfortranarray(a) for key, a in arrays.items()}),
    "scipy of old": lambda path, arrays: path.write_bytes(
        _python3(path, arrays, 2).read_bytes().replace(b"scipy.sparse._csc", b"scipy.sparse.csc")
    ),
    "numpy 2 as numpy 1": lambda path, arrays: path.write_bytes(
        write_pickle(path, arrays).read_bytes().replace(b"numpy._core.", b"numpy.core.")
    ),
}


@pytest.mark.parametrize("form", PICKLES)
@pytest.mark.parametrize("kind", ["smplx", "smpl"])
def test_pickles_read_as_npz_does(tmp_path: Path, kind: str, form: str):
    arrays = body_arrays(kind)
    expected = load_body(write_npz(tmp_path / "body_f.npz", arrays))
    path = tmp_path / "basicmodel_f_lbs_10_207_0_v1.1.0.pkl"
    PICKLES[form](path, arrays)
    body = load_body(path)
    assert (body.kind, body.gender) == (kind, "female")
    for name in ARRAYS + INDICES:
        np.testing.assert_array_equal(getattr(body, name), getattr(expected, name))


class _Runs:
    """A pickle of this runs a command when a plain unpickler reads it."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self):
        return os.system, (f"touch {self.marker}",)


@pytest.mark.parametrize("protocol", range(6))
def test_pickle_that_runs_code_is_refused_and_not_run(tmp_path: Path, protocol: int):
    path = write_pickle(tmp_path / "a.pkl", body_arrays() | {"x": _Runs(tmp_path / "ran")}, protocol=protocol)
    with pytest.raises(InputError, match=r"a\.pkl.*system.*could run code"):
        load_body(path)
    assert not (tmp_path / "ran").exists()
    pickle.loads(path.read_bytes())
    assert (tmp_path / "ran").exists()  # so the pickle would have run


HOSTILE = [
    (b"cbuiltins\neval\n(V1\ntR.", r"asks for builtins\.eval"),
    (b"c__builtin__\neval\n(V1\ntR.", r"asks for __builtin__\.eval"),
    (b"cbuiltins\ngetattr\n.", r"asks for builtins\.getattr"),
    (b"cnumpy\nload\n.", r"asks for numpy\.load"),
    (b"cnumpy.f2py\ncompile\n.", r"asks for numpy\.f2py\.compile"),
    (b"cfunctools\npartial\n.", r"asks for functools\.partial"),
    (b"ccopyreg\n_reconstructor\n(cbuiltins\nset\ncbuiltins\nobject\nNtR.", "the pickle holds a Kept"),
    (b"\x80\x04\x8c\x08builtins\x8c\x15object.__subclasses__\x93.", r"asks for builtins\.object\.__sub"),
    (b"\x80\x04\x8c\x06chumpy\x8c\x14Ch.array.__globals__\x93.", "expected a dictionary"),
    (b"Pid\n.", "refers to an object outside the file"),
]


@pytest.mark.parametrize(("stream", "message"), HOSTILE)
def test_hostile_streams_are_refused(tmp_path: Path, stream: bytes, message: str):
    path = tmp_path / "a.pkl"
    path.write_bytes(stream)
    with pytest.raises(InputError, match=rf"a\.pkl: .*({message})"):
        load_body(path)


BROKEN_INDICES: dict[str, Callable[[Any], None]] = {
    "index too large": lambda matrix: matrix.indices.__setitem__(3, 10**6),
    "index negative": lambda matrix: matrix.indices.__setitem__(3, -1),
    "pointer back": lambda matrix: matrix.indptr.__setitem__(4, -5),
    "pointer outside": lambda matrix: matrix.indptr.__setitem__(-1, 10**9),
    # scipy takes the last pointer for the number of entries, checks nothing if that is 0, and crashes the process.
    "pointer past a full check": lambda matrix: matrix.indptr.__setitem__(slice(1, None), [10**9] * 59 + [0]),
}


@pytest.mark.parametrize("case", BROKEN_INDICES)
def test_sparse_indices_outside_are_refused(tmp_path: Path, case: str):
    matrix = scipy.sparse.csc_matrix(body_arrays("smpl")["J_regressor"])
    BROKEN_INDICES[case](matrix)
    with pytest.raises(InputError, match="'J_regressor' is a sparse matrix that is damaged"):
        load_body(write_pickle(tmp_path / "a.pkl", body_arrays("smpl") | {"J_regressor": matrix}))


def test_huge_sparse_matrix_is_refused(tmp_path: Path):
    matrix = scipy.sparse.csc_matrix((10**7, 10**7))
    with pytest.raises(InputError, match="sparse matrix of shape"):
        load_body(write_pickle(tmp_path / "a.pkl", body_arrays("smpl") | {"J_regressor": matrix}))


def test_chumpy_expression_where_numbers_are_needed_is_refused(tmp_path: Path):
    with fake_chumpy() as chumpy:
        path = write_pickle(tmp_path / "a.pkl", body_arrays("smpl") | {"weights": chumpy.ch.MatVecMult(mtx=1)})
    with pytest.raises(InputError, match="'weights' is a chumpy expression"):
        load_body(path)


def _with(key: str, change: Callable[[np.ndarray], Any]) -> Callable[[], dict[str, Any]]:
    def arrays() -> dict[str, Any]:
        content: dict[str, Any] = body_arrays()
        return content | {key: change(content[key])}

    return arrays


def _without(key: str) -> dict[str, np.ndarray]:
    return {k: v for k, v in body_arrays().items() if k != key}


def _one(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(array: np.ndarray) -> np.ndarray:
        array = array.astype(float)
        array.reshape(-1)[7] = value
        return array

    return change


MALFORMED: dict[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "motion": (lambda: {"poses": np.zeros((9, 156)), "trans": np.zeros((9, 3))}, "is a motion"),
    "other npz": (lambda: {"image": np.zeros(3)}, "has no v_template, .*it has image"),
    "empty": (dict, "it has nothing"),
    "no weights": (lambda: _without("weights"), "has no weights"),
    "NaN template": (_with("v_template", _one(np.nan)), "'v_template' holds 1 values that are not finite"),
    "infinite posedirs": (_with("posedirs", _one(np.inf)), "'posedirs' holds 1 values that are not finite"),
    "NaN regressor": (_with("J_regressor", _one(np.nan)), "'J_regressor' holds 1 values"),
    "objects": (_with("weights", lambda a: a.astype(object)), "'weights' is an array of Python objects"),
    "text": (_with("f", lambda a: a.astype(str)), "'f' holds <U.* values, expected numbers"),
    "16 shapes": (
        _with("shapedirs", lambda a: np.repeat(a, 2, axis=2)[:, :, :26]),
        "has 26 shape directions, expected 20",
    ),
    "flat template": (_with("v_template", lambda a: a.reshape(-1)), "'v_template' has the shape 180, expected any x 3"),
    "posedirs of SMPL": (
        _with("posedirs", lambda a: a[:, :, :207]),
        "'posedirs' has the shape 60 x 3 x 207, expected 60 x 3 x 486",
    ),
    "fewer weights": (_with("weights", lambda a: a[:-1]), "'weights' has the shape 59 x 55, expected 60 x 55"),
    "transposed regressor": (_with("J_regressor", lambda a: a.T), "'J_regressor' has the shape 60 x 55"),
    "hand model": (_with("J_regressor", lambda a: a[:16]), "has 16 joints like a MANO hand"),
    "odd joints": (_with("J_regressor", lambda a: a[:30]), "has 30 joints, expected 55"),
    "face outside": (_with("f", _one(60)), "'f' holds values from .* to 60.*expected whole numbers from 0 to 59"),
    "broken face": (_with("f", _one(1.5)), "expected whole numbers"),
    "landmark outside": (_with("lmk_faces_idx", _one(40)), "'lmk_faces_idx' holds values"),
    "few landmarks": (_with("lmk_faces_idx", lambda a: a[:5]), "'lmk_faces_idx' has the shape 5, expected 51"),
    "contour bins": (_with("dynamic_lmk_faces_idx", lambda a: a[:39]), "has the shape 39 x 17, expected 79 x 17"),
    "hand of 12": (_with("hands_componentsl", lambda a: a[:12]), "'hands_componentsl' has the shape 12 x 45"),
    "weights off": (_with("weights", lambda a: a * 2), "skinning weights that miss a sum of 1 by up to 1,"),
    "negative weight": (_with("weights", _one(-0.001)), "none below 0"),
    "regressor off": (_with("J_regressor", lambda a: a * 0), "joint regressor rows that miss a sum of 1"),
    "millimetres": (_with("v_template", lambda a: a * 1000), "expected a body in metres"),
    "other tree": (_with("kintree_table", lambda a: a[:, ::-1]), "another joint tree"),
    "gender": (
        lambda: body_arrays() | {"gender": np.array("robot")},
        "gender 'robot', expected neutral, male, female or child",
    ),
    "other mesh": (lambda: _without("keypoint_vertices"), "has 60 vertices, expected the 10475 of SMPL-X"),
    "keypoint outside": (_with("keypoint_vertices", _one(60)), "'keypoint_vertices' holds .* from -1 to 59"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_file_says_what_is_wrong(tmp_path: Path, case: str):
    make, message = MALFORMED[case]
    path = write_npz(tmp_path / "SMPLX_NEUTRAL.npz", make())
    with pytest.raises(InputError, match=message) as error:
        load_body(path)
    assert str(path) in str(error.value)


def _cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def _flip_middle(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 3 + 40] = bytes(40)
    path.write_bytes(content)


DAMAGE: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "cut npz": ("a.npz", lambda p: _cut(p, 5000), "not a complete npz archive"),
    "empty npz": ("a.npz", lambda p: _cut(p, 0), "not a complete npz archive"),
    "flipped npz": ("a.npz", _flip_middle, "is damaged"),
    "text as npz": (
        "a.npz",
        lambda p: p.write_text("version https://git-lfs.github.com"),
        "not a complete npz archive",
    ),
    "cut pkl": ("a.pkl", lambda p: _cut(p, 5000), "damaged or incomplete"),
    "empty pkl": ("a.pkl", lambda p: _cut(p, 0), "damaged or incomplete"),
    "list as pkl": ("a.pkl", lambda p: p.write_bytes(pickle.dumps([1, 2])), "holds a list, expected a dictionary"),
    "html as pkl": ("a.pkl", lambda p: p.write_text("<html>sign in</html>"), "damaged or incomplete"),
    "other suffix": ("a.obj", lambda p: None, r"ends in '\.obj', expected \.npz or \.pkl"),
    "gone": ("a.npz", lambda p: p.unlink(), "does not exist"),
    "folder": ("a.npz", lambda p: (p.unlink(), p.mkdir()), "is a folder"),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_damaged_file_says_what_is_wrong(tmp_path: Path, case: str):
    name, damage, message = DAMAGE[case]
    path = tmp_path / name
    written = (
        write_pickle(path, body_arrays()) if path.suffix == ".pkl" else write_npz(tmp_path / "b.npz", body_arrays())
    )
    written.rename(path)
    damage(path)
    with pytest.raises(InputError, match=message) as error:
        load_body(path)
    assert str(path) in str(error.value)


def test_npz_that_unpacks_too_large_is_refused_before_unpacking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **body_arrays())
    with zipfile.ZipFile(path) as archive:
        size = sum(m.file_size for m in archive.infolist())
    monkeypatch.setattr("fitting_core.body.files.raw_file.MAX_BYTES", size - 1)
    with pytest.raises(InputError, match="unpacks to"):
        load_body(path)
    monkeypatch.setattr("fitting_core.body.files.raw_file.MAX_BYTES", size)
    assert len(load_body(path).template) == VERTICES


def test_a_body_in_use_is_not_read_again_and_a_changed_file_is(tmp_path: Path):
    arrays = body_arrays("smplx")
    path = write_npz(tmp_path / "SMPLX_NEUTRAL.npz", arrays)
    body = load_body(path)
    assert load_body(path) is body
    os.utime(write_npz(path, arrays | {"v_template": 1.1 * arrays["v_template"]}), ns=(1, 1))
    np.testing.assert_array_equal(load_body(path).template, 1.1 * body.template)
