"""The standard set of markers: where anatomy has them, on bodies of any mesh; a user's own sets, and broken ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.files.reading import load_body
from fitting_core.body.markers.marker_set import STANDARD, MarkerSet, marker_places, read_marker_set
from fitting_core.body.markers.places import PLACES, standard_vertices
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError
from fitting_core.shipped import FREE_FOLDER
from tests.samples.scenes import random_params

GENDERS = ("NEUTRAL", *(pytest.param(gender, marks=pytest.mark.thorough) for gender in ("MALE", "FEMALE")))


@pytest.fixture(scope="module", params=GENDERS)
def body(request: pytest.FixtureRequest) -> BodyModel:
    return load_body(FREE_FOLDER / f"SMPLX_{request.param}.npz")


REST = BodyParams(**{name: torch.zeros_like(value) for name, value in vars(random_params(1)).items()})


@pytest.fixture(scope="module")
def resting(body: BodyModel) -> dict[str, np.ndarray]:
    """Where the markers are in the rest pose: x to the body's left, y up, z forward."""
    return dict(zip(PLACES, marker_places(body, REST, STANDARD)[0], strict=True))


def joint(body: BodyModel, name: str) -> np.ndarray:
    return body.rest_joints[JOINT[name]]


def test_markers_lie_where_anatomy_has_them(body: BodyModel, resting: dict[str, np.ndarray]):
    m = resting
    knee, ankle, wrist, elbow = (joint(body, f"left_{name}") for name in ("knee", "ankle", "wrist", "elbow"))
    assert 0.03 < m["LKNE"][0] - knee[0] < 0.10 and 0.03 < knee[0] - m["LKNM"][0] < 0.10
    assert abs(m["LKNE"][1] - knee[1]) < 0.02 and abs(m["LKNM"][1] - knee[1]) < 0.02
    assert m["LANK"][0] > ankle[0] > m["LMED"][0] and abs(m["LANK"][1] - ankle[1]) < 0.02
    assert m["LHEE"][2] < ankle[2] < m["LTOE"][2] and abs(m["LHEE"][1] - m["LTOE"][1]) < 0.03
    assert m["LVMH"][0] > m["LTOE"][0] > m["LFMH"][0]
    assert m["LWRA"][2] > wrist[2] > m["LWRB"][2] and np.linalg.norm(m["LWRA"] - m["LWRB"]) < 0.10
    assert m["LELB"][1] > elbow[1] > m["LELM"][1] and m["LFIN"][0] > wrist[0] + 0.05
    assert m["LSHO"][1] > joint(body, "left_shoulder")[1] + 0.02
    asis = np.linalg.norm(m["LASI"] - m["RASI"])
    psis = np.linalg.norm(m["LPSI"] - m["RPSI"])
    assert 0.20 < asis < 0.33 and 0.06 < psis < 0.14 and m["LASI"][2] > m["LPSI"][2] + 0.1
    heights = [m[name][1] for name in ("LFHD", "C7", "CLAV", "STRN", "LASI", "LTHI", "LKNE", "LTIB", "LANK", "LTOE")]
    assert heights == sorted(heights, reverse=True)
    assert m["C7"][2] < m["CLAV"][2] and m["T10"][2] < m["STRN"][2] and m["LFHD"][2] > m["LBHD"][2]
    assert m["RBAK"][0] < -0.05 and m["RBAK"][2] < joint(body, "spine3")[2]


def test_markers_are_off_the_skin_by_their_radius(body: BodyModel, resting: dict[str, np.ndarray]):
    skin = Mesh(body)(REST)[0].numpy()  # the template, but for the hands' mean pose
    for name, vertex in standard_vertices(body).items():
        assert np.linalg.norm(resting[name] - skin[vertex]) == pytest.approx(0.007, abs=1e-5)
    assert len(set(standard_vertices(body).values())) == len(PLACES)


def test_vertices_are_where_the_ray_leaves_the_skin(free_body: BodyModel):
    """The same with other triangles: each vertex as a body of its own, and a mesh turned inside out."""
    expected = standard_vertices(free_body)
    assert standard_vertices(replace(free_body, faces=free_body.faces[:, ::-1].copy())) == expected
    order = np.random.default_rng(0).permutation(len(free_body.template))
    place = np.argsort(order)
    mixed = replace(
        free_body,
        template=free_body.template[order],
        skinning_weights=free_body.skinning_weights[order],
        joint_regressor=free_body.joint_regressor[:, order],
        faces=place[free_body.faces],
        surface_keypoints={name: int(place[v]) for name, v in free_body.surface_keypoints.items()},
    )
    assert {name: int(order[v]) for name, v in standard_vertices(mixed).items()} == expected


def test_markers_move_with_the_body(free_body: BodyModel):
    """A body that is turned as a whole and carried away takes its markers along."""
    params = random_params(3).to(dtype=torch.float32)
    there = marker_places(free_body, params, STANDARD)
    turn = Rotation.from_rotvec([0.3, -1.1, 0.4])
    orient = Rotation.from_rotvec(params.global_orient.numpy())
    turned = replace(params, global_orient=torch.as_tensor((turn * orient).as_rotvec(), dtype=torch.float32))
    again = marker_places(free_body, turned, STANDARD)
    for before, after in zip(there, again, strict=True):
        moved = turn.apply(before)
        np.testing.assert_allclose(after - after.mean(0), moved - moved.mean(0), atol=1e-5)


def test_what_is_in_a_file_is_what_is_taken(tmp_path: Path):
    (tmp_path / "own.toml").write_text('[markers]\nA = 17\nHip = "LASI"\nK = "right_knee"\n')
    assert read_marker_set(tmp_path / "own.toml") == MarkerSet({"A": 17, "Hip": "LASI", "K": "right_knee"}, 0.007)


@pytest.mark.parametrize("content", ["[markers]\r\nA = 17\r\n", '{"markers": {"A": 17}}'])
def test_a_byte_order_mark_does_no_harm(tmp_path: Path, content: str):
    """Editors on Windows put one before everything."""
    (tmp_path / "own.toml").write_text(content, encoding="utf-8-sig", newline="")
    assert read_marker_set(tmp_path / "own.toml") == MarkerSet({"A": 17})


BROKEN = {
    "empty": ("", "has none in"),
    "no markers": ("[markers]\n", 'has 0 in "markers"'),
    "toml": ("[markers\n", "cannot be read"),
    "json": ('{"markers": ', "cannot be read"),
    "a list": ('{"markers": [1]}', "has none in"),
    "negative": ("[markers]\nA = -1\n", "the marker A sits on -1; expected a vertex's number"),
    "a share": ("[markers]\nA = 1.5\n", "sits on 1.5"),
    "yes": ("[markers]\nA = true\n", "sits on True"),
    "elsewhere": ('[markers]\nA = "LTAIL"\n', "sits on 'LTAIL'; expected .* LFHD, LBHD"),
    "radius": ("radius = -3\n[markers]\nA = 1\n", "its radius is -3; expected millimetres"),
    "radius as text": ('radius = "7 mm"\n[markers]\nA = 1\n', "its radius is '7 mm'"),
    "another key": ("units = 1\n[markers]\nA = 1\n", "has 'units'; expected"),
    "a name with a tab": ('[markers]\n"A\\tB" = 1\n', "a marker is named"),
    "a name of umlauts": ('[markers]\n"Hüfte" = 1\n', "signs of ASCII"),
    "many": ("[markers]\n" + "".join(f"M{i} = {i}\n" for i in range(201)), "has 201 in"),
    "nested": ('{"markers": ' + "[" * 100000, "cannot be read"),
    "huge": ("#" * 2**21, "expected at most"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_broken_files_are_refused(tmp_path: Path, kind: str):
    content, said = BROKEN[kind]
    (tmp_path / "own.toml").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=said) as error:
        read_marker_set(tmp_path / "own.toml")
    assert "own.toml" in str(error.value) and len(str(error.value)) < 900
