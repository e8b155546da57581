"""Read a SMPL-X, SMPL-H or SMPL file into a BodyModel."""

import re
from pathlib import Path, PurePath
from weakref import WeakValueDictionary

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.files import forms
from fitting_core.body.files.forms import FORMS, Form
from fitting_core.body.files.raw_file import HAND_KEYS, OWN_KEYPOINTS, RawFile, read_raw
from fitting_core.body.model import N_BETAS, N_EXPRESSION, SURFACE_KEYPOINTS, BodyModel
from fitting_core.files.pickles import as_array
from fitting_core.files.regular import StrPath

_GENDERS = {name: name for name in ("neutral", "male", "female", "child")} | {
    "n": "neutral",
    "m": "male",
    "f": "female",
}
_OTHER_MODELS = {16: "a MANO hand", 5: "a FLAME head", 33: "a SMAL animal", 35: "a SMAL animal"}

_IN_USE: WeakValueDictionary[tuple[Path, int, int], BodyModel] = WeakValueDictionary()
"""By file, its time and its size: a command asks for the same body in many places, and SMPL-X takes long to read."""


def load_body(path: StrPath) -> BodyModel:
    """Read a body model file: SMPL-X, SMPL-H or SMPL, `.npz` or `.pkl`; the body itself where it is in use already.

    The number of joints tells the kind (55, 52, 24); all are brought into SMPL-X's 55-joint form. In SMPL-H the jaw and
    the eyes sit on the head and in SMPL also the fingers on the wrists, without skin; SMPL's hand joints merge into the
    wrists. Of the shape directions the first 10 are read; expressions are the 10 columns after SMPL-X's shape part (10
    of 20, 300 of 400 columns), zero for the others. A file without hand components gets `plain_hand_components` and a
    zero mean. The gender is that of the file, else that of its name or folder, else neutral.

    Raises:
        InputError: The file is missing, damaged, not a body model, or holds what does not fit together.
    """
    path = Path(path)
    try:
        stat = path.stat()
    except OSError:
        return _read(path)  # which tells what is wrong
    key = (path.absolute(), stat.st_mtime_ns, stat.st_size)
    body = _IN_USE.get(key)
    if body is None:
        body = _IN_USE[key] = _read(path)
    return body


def _read(path: Path) -> BodyModel:
    raw = read_raw(path)
    template = raw.floats("v_template", (None, 3))
    form = _form(raw, vertices=len(template))
    _check_size(raw, template)
    _check_tree(raw, form)
    faces = raw.indices("f", (None, 3), limit=len(template))
    joints, columns = len(form.joints), 9 * (len(form.joints) - 1)
    shape, expression = _directions(raw, form, len(template))
    landmark_vertices, landmark_weights = _landmarks(raw, faces, "", (51,))
    contour_vertices, contour_weights = _landmarks(raw, faces, "dynamic_", (79, 17))
    components, mean = _hands(raw)
    return BodyModel(
        kind=form.kind,
        gender=_gender(raw) or "neutral",
        template=template,
        shape_directions=shape,
        expression_directions=expression,
        pose_directions=forms.pose_directions_in_55(
            form, raw.floats("posedirs", (len(template), 3, columns), least=32)
        ),
        joint_regressor=_regressor(raw, (joints, len(template)))[list(form.regressor_rows)],
        skinning_weights=forms.weights_in_55(form, _weights(raw, (len(template), joints))),
        parents=np.array(forms.PARENTS, dtype=np.int64),
        faces=faces,
        hand_components=components,
        hand_mean=mean,
        surface_keypoints=_surface_keypoints(raw, form, len(template)),
        landmark_vertices=landmark_vertices,
        landmark_weights=landmark_weights,
        contour_vertices=contour_vertices,
        contour_weights=contour_weights,
        source=raw.path,
        hash=raw.hash,
    )


def gender_of_name(path: PurePath) -> str | None:
    """Gender by the file's name, or by its folder's for names like `female/model.npz`; None if unknown."""
    for name in (path.stem, path.parent.name):
        words = re.split(r"[^a-z]+", name.lower())
        found = {_GENDERS[word] for word in words if word in _GENDERS}
        if len(found) == 1:
            return found.pop()
    return None


def _form(raw: RawFile, *, vertices: int) -> Form:
    joints = len(raw.array("J_regressor", (None, vertices)))
    if joints not in FORMS:
        other = f" like {_OTHER_MODELS[joints]}" if joints in _OTHER_MODELS else ""
        known = ", ".join(f"{n} ({form.title})" for n, form in FORMS.items())
        raise raw.error(f"has {joints} joints{other}, expected {known}", "Give a model of the whole body.")
    return FORMS[joints]


def _check_size(raw: RawFile, template: Float[np.ndarray, "V 3"]) -> None:
    height = float(np.ptp(template, axis=0).max())
    if not 0.2 < height < 5.0:
        raise raw.error(f"measures {height:.3g} at its longest, expected a body in metres (0.2 to 5)")


def _check_tree(raw: RawFile, form: Form) -> None:
    """Joints are known by their place, so the tree must be the one that goes with their names."""
    table = raw.array("kintree_table", (2, len(form.joints))).astype(np.int64)
    parents = np.where(table[0] >= 2**31, -1, table[0])
    if (table[1] != np.arange(len(form.joints))).any() or tuple(parents) != form.parents:
        raise raw.error(f"has another joint tree ('kintree_table') than {form.title}")


def _directions(raw: RawFile, form: Form, vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """Shape and expression directions, (V,3,10) each."""
    directions = raw.array("shapedirs", (vertices, 3, None))
    columns = directions.shape[2]
    if form.expression_starts is None:
        if columns < N_BETAS:
            raise raw.error(f"has {columns} shape directions, expected at least {N_BETAS}")
        return _ten(directions, 0), np.zeros((vertices, 3, N_EXPRESSION))
    if columns not in form.expression_starts:
        expected = " or ".join(
            f"{n} ({start} shape + {n - start} expression)" for n, start in form.expression_starts.items()
        )
        raise raw.error(f"has {columns} shape directions, expected {expected}")
    return _ten(directions, 0), _ten(directions, form.expression_starts[columns])


def _ten(directions: np.ndarray, start: int) -> Float[np.ndarray, "V 3 10"]:
    return np.ascontiguousarray(directions[:, :, start : start + 10], dtype=np.float64)


def _regressor(raw: RawFile, shape: tuple[int, int]) -> Float[np.ndarray, "J V"]:
    regressor = raw.floats("J_regressor", shape)
    off = float(np.abs(regressor.sum(axis=1) - 1).max())
    if off > 1e-2:
        raise raw.error(f"has joint regressor rows that miss a sum of 1 by up to {off:.2g}, expected sums of 1")
    return regressor


def _weights(raw: RawFile, shape: tuple[int, int]) -> Float[np.ndarray, "V J"]:
    weights = raw.floats("weights", shape)
    off = float(np.abs(weights.sum(axis=1) - 1).max())
    if off > 1e-2 or weights.min() < -1e-6:
        raise raw.error(
            f"has skinning weights that miss a sum of 1 by up to {off:.2g}, expected sums of 1, none below 0"
        )
    return weights


def _landmarks(
    raw: RawFile, faces: Int[np.ndarray, "F 3"], prefix: str, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and barycentric weights of landmarks, zero rows if the file has none."""
    triangles, weights = f"{prefix}lmk_faces_idx", f"{prefix}lmk_bary_coords"
    if triangles not in raw.values or weights not in raw.values:
        empty = (0, *shape[1:], 3)
        return np.zeros(empty, dtype=np.int64), np.zeros(empty)
    return faces[raw.indices(triangles, shape, limit=len(faces))], raw.floats(weights, (*shape, 3))


def _hands(raw: RawFile) -> tuple[Float[np.ndarray, "2 45 45"], Float[np.ndarray, "2 45"]]:
    if not all(key in raw.values for key in HAND_KEYS):
        return np.stack([forms.plain_hand_components()] * 2), np.zeros((2, 45))
    components = np.stack([raw.floats(f"hands_components{side}", (45, 45)) for side in "lr"])
    return components, np.stack([raw.floats(f"hands_mean{side}", (45,)) for side in "lr"])


def _surface_keypoints(raw: RawFile, form: Form, vertices: int) -> dict[str, int]:
    if OWN_KEYPOINTS in raw.values:
        own = raw.indices(OWN_KEYPOINTS, (len(SURFACE_KEYPOINTS),), limit=vertices, first=-1)
        return {name: int(v) for name, v in zip(SURFACE_KEYPOINTS, own, strict=True) if v >= 0}
    if vertices < form.vertices:
        raise raw.error(
            f"has {vertices} vertices, expected the {form.vertices} of {form.title}, whose keypoint vertices are known",
            f"Use the official mesh, or add a '{OWN_KEYPOINTS}' array of {len(SURFACE_KEYPOINTS)} vertices (-1: none).",
        )
    return form.surface_keypoints()


def _gender(raw: RawFile) -> str | None:
    stored = raw.values.get("gender")
    if stored is None:
        return gender_of_name(raw.path)
    value = as_array(stored).reshape(-1)
    word = (value.astype(str)[0] if value.dtype.kind in "SU" and len(value) else str(stored)).lower()
    if word not in _GENDERS:
        raise raw.error(f"has the gender '{word}', expected neutral, male, female or child")
    return _GENDERS[word]
