"""What the shipped free bodies are like: closed, symmetric, skinned, with keypoints and landmarks; and those before."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from build_assets.free_body.face.expressions import EXPRESSIONS
from build_assets.free_body.skin.skinning import JAW_OPENING, joint_mirror
from build_assets.free_body.skin.surface_keypoints import SMPLX_VERTICES
from fitting_core.body.files.former import former_body, is_former, same_shapes
from fitting_core.body.files.forms import PARENTS
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.io.known_shape import read_known_shape
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import BodyOf
from fitting_core.shipped import FREE_FOLDER
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.project.storage.run_record import BodyRecord

GENDERS = ("neutral", "male", "female")
MIRROR = np.array([-1.0, 1.0, 1.0])
FINGERS = ("thumb", "index", "middle", "ring", "pinky")

Arrays = dict[str, np.ndarray]


@cache
def load(gender: str) -> Arrays:
    with np.load(FREE_FOLDER / f"SMPLX_{gender.upper()}.npz", allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


@pytest.fixture(params=GENDERS)
def body(request: pytest.FixtureRequest) -> Arrays:
    return load(request.param)


@pytest.fixture
def neutral() -> Arrays:
    return load("neutral")


def shaped(body: Arrays, column: int, value: float) -> np.ndarray:
    return body["v_template"] + body["shapedirs"][..., column].astype(float) * value


def posed(body: Arrays, pose: dict[str, tuple[float, float, float]], *, corrected: bool = True) -> np.ndarray:
    """The mean body's vertices; pose: axis-angle in degrees by joint."""
    rotations = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    for name, degrees in pose.items():
        rotations[JOINT[name]] = Rotation.from_rotvec(degrees, degrees=True).as_matrix()
    vertices = body["v_template"].astype(float)
    joints = body["J_regressor"] @ vertices
    if corrected:
        vertices = vertices + body["posedirs"] @ (rotations[1:] - np.eye(3)).ravel()
    world = [np.eye(4)] * len(JOINTS)
    for joint, parent in enumerate(PARENTS):
        local = np.eye(4)
        local[:3, :3] = rotations[joint]
        local[:3, 3] = joints[joint] - (joints[parent] if parent >= 0 else 0)
        world[joint] = world[parent] @ local if parent >= 0 else local
    moved = np.stack(world)
    moved[:, :3, 3] -= np.einsum("jab,jb->ja", moved[:, :3, :3], joints)
    blended = np.einsum("vj,jab->vab", body["weights"], moved)
    return np.einsum("vab,vb->va", blended[:, :3, :3], vertices) + blended[:, :3, 3]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Litres inside a closed surface."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6 * 1e3)


def winding_number(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """How often a closed surface surrounds each point: 0 outside, 1 inside."""
    a, b, c = (vertices[faces[:, i]] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    sine = (a * np.cross(b, c)).sum(-1)
    cosine = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return 2 * np.arctan2(sine, cosine).sum(1) / (4 * np.pi)


def landmarks(body: Arrays, vertices: np.ndarray) -> np.ndarray:
    """Points 17 to 67."""
    return np.einsum("lk,lkd->ld", body["lmk_bary_coords"], vertices[body["f"][body["lmk_faces_idx"]]])


def test_surface_is_closed_and_oriented(neutral: Arrays) -> None:
    faces = neutral["f"].astype(int)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1]))
    assert len(np.unique(faces)) == len(neutral["v_template"])


@pytest.mark.parametrize(
    ("gender", "height", "litres"), [("neutral", 1.71, 74), ("male", 1.77, 81.5), ("female", 1.65, 67.4)]
)
def test_mean_bodies_are_adults(gender: str, height: float, litres: float) -> None:
    body = load(gender)
    assert np.ptp(body["v_template"][:, 1]) == pytest.approx(height, abs=0.01)
    assert volume(body["v_template"].astype(float), body["f"]) == pytest.approx(litres, abs=0.5)


def test_bodies_are_symmetric(body: Arrays) -> None:
    distance = np.abs(body["J"] - body["J"][joint_mirror()] * MIRROR).max()
    assert distance < 1e-5
    template = body["v_template"]
    mirrored = template * MIRROR
    assert (np.sort(template, axis=0)[:, 1:] == np.sort(mirrored, axis=0)[:, 1:]).all()
    assert np.abs(np.sort(template[:, 0]) - np.sort(mirrored[:, 0])).max() < 1e-6


@pytest.mark.parametrize("gender", ["neutral", *(pytest.param(g, marks=pytest.mark.thorough) for g in GENDERS[1:])])
def test_joints_are_inside_people_of_all_builds(gender: str) -> None:
    body = load(gender)
    for column, value, count in [(0, 0.0, len(JOINTS)), (3, -2.0, 25)]:
        vertices = shaped(body, column, value)
        joints = (body["J_regressor"] @ vertices)[:count]
        outside = np.flatnonzero(winding_number(joints, vertices, body["f"]) < 0.5)
        assert [JOINTS[joint] for joint in outside] == [], (column, value)


def test_shapes_within_two_deviations_are_plausible(body: Arrays) -> None:
    for column in range(10):
        for value in (-2.0, 2.0):
            vertices = shaped(body, column, value)
            height = np.ptp(vertices[:, 1])
            assert 1.45 < height < 2.0
            assert 14 < volume(vertices, body["f"]) / height**2 < 40, "body mass index at the density of water"
    assert np.ptp(shaped(body, 0, 2.0)[:, 1]) > np.ptp(shaped(body, 0, -2.0)[:, 1]) + 0.2
    assert volume(shaped(body, 3, 2.0), body["f"]) > 1.8 * volume(shaped(body, 3, -2.0), body["f"])


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("finger", FINGERS)
def test_fingertips_lie_beyond_the_last_joint(body: Arrays, side: str, finger: str) -> None:
    vertex = SMPLX_VERTICES[f"{side}_{finger}"]
    second, last = (body["J"][JOINT[f"{side}_{finger}{k}"]] for k in (2, 3))
    reach = body["v_template"][vertex] - last
    direction = (last - second) / np.linalg.norm(last - second)
    assert 0.015 < reach @ direction < 0.035
    assert np.linalg.norm(reach - reach @ direction * direction) < 0.008
    assert body["weights"][vertex].argmax() == JOINT[f"{side}_{finger}3"]


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_feet_ears_and_eyes_lie_where_they_belong(body: Arrays, side: str, sign: int) -> None:
    at = {name: body["v_template"][SMPLX_VERTICES[f"{side}_{name}"]] for name in ("big_toe", "small_toe", "heel")}
    ankle = body["J"][JOINT[f"{side}_ankle"]]
    ground = body["v_template"][:, 1].min()
    assert at["heel"][2] < ankle[2] < at["small_toe"][2] < at["big_toe"][2]
    assert sign * at["small_toe"][0] > sign * at["big_toe"][0] > 0
    assert all(point[1] < ground + 0.04 for point in at.values())
    ear, eye = (body["v_template"][SMPLX_VERTICES[f"{side}_{name}"]] for name in ("ear", "eye"))
    nose = body["v_template"][SMPLX_VERTICES["nose"]]
    assert sign * ear[0] > sign * eye[0] > 0 and ear[2] < eye[2] < nose[2]
    assert body["weights"][SMPLX_VERTICES[f"{side}_eye"], JOINT[f"{side}_eye"]] == 1


def test_landmarks_are_ordered_on_the_front_of_the_face(body: Arrays) -> None:
    points = landmarks(body, body["v_template"])
    by_number = dict(zip(range(17, 68), points, strict=True))
    assert (points[:, 2] > body["J"][JOINT["left_eye"], 2] - 0.02).all()
    brows, bridge = points[:10], points[10:14]
    assert (np.diff(brows[:, 0]) > 0).all(), "from the body's right to its left"
    assert (np.diff(bridge[:, 1]) < 0).all() and np.abs(bridge[:, 0]).max() < 1e-4
    assert by_number[36][0] < by_number[39][0] < 0 < by_number[42][0] < by_number[45][0]
    assert by_number[48][0] < by_number[60][0] < 0 < by_number[64][0] < by_number[54][0]
    order = [27, 33, 51, 62, 66, 57]
    heights = [by_number[number][1] for number in order]
    assert heights == sorted(heights, reverse=True)
    assert np.abs(by_number[36] - by_number[45] * MIRROR).max() < 2e-3
    assert (body["lmk_bary_coords"] >= 0).all()
    assert np.allclose(body["lmk_bary_coords"].sum(1), 1, atol=1e-6)


def test_expressions_move_the_face_only(neutral: Arrays) -> None:
    directions = neutral["shapedirs"][..., 10:]
    moved = np.linalg.norm(directions, axis=1).max(-1)
    face = neutral["weights"][:, [JOINT[name] for name in ("head", "jaw", "neck", "left_eye", "right_eye")]].sum(1)
    assert (face[moved > 5e-5] > 0.9).all()
    assert np.abs(np.einsum("jv,vdk->jdk", neutral["J_regressor"], directions)).max() < 3e-4
    assert directions.shape[-1] == len(EXPRESSIONS)
    assert (np.abs(directions).max((0, 1)) < 0.02).all(), "a coefficient of 1 is a mild expression"


def expressed(body: Arrays, name: str, value: float) -> dict[int, np.ndarray]:
    column = 10 + next(i for i, expression in enumerate(EXPRESSIONS) if expression.name == name)
    return dict(zip(range(17, 68), landmarks(body, shaped(body, column, value)), strict=True))


def test_expressions_do_what_they_are_called(neutral: Arrays) -> None:
    def height(name: str, value: float, upper: int, lower: int) -> float:
        points = expressed(neutral, name, value)
        return points[upper][1] - points[lower][1]

    def width(name: str, value: float) -> float:
        points = expressed(neutral, name, value)
        return points[54][0] - points[48][0]

    assert height("smile", 2, 48, 57) > height("smile", 0, 48, 57) + 0.003 > height("smile", -2, 48, 57) + 0.006
    assert width("lips protruded", 2) < width("lips protruded", 0) - 0.005 < width("lips protruded", -2) - 0.010
    assert height("lips apart", 2, 51, 57) > height("lips apart", -2, 51, 57) + 0.004
    assert height("brows raised", 2, 19, 37) > height("brows raised", -2, 19, 37) + 0.005
    assert height("eyes closed", 2, 37, 41) < 0.6 * height("eyes closed", 0, 37, 41)
    assert expressed(neutral, "mouth to the left", 2)[51][0] > 0.003
    assert height("left eye closed", 2, 44, 46) < height("left eye closed", 2, 37, 41) - 0.003


def test_jaw_opens_the_mouth(body: Arrays) -> None:
    rest = landmarks(body, body["v_template"])
    opened = landmarks(body, posed(body, {"jaw": (np.degrees(JAW_OPENING), 0, 0)}))
    drop = dict(zip(range(17, 68), (rest - opened)[:, 1], strict=True))
    assert drop[57] > 0.015 and drop[66] > 0.015
    assert abs(drop[51]) < 0.003 and abs(drop[33]) < 0.001


@pytest.mark.parametrize(
    "pose",
    [
        {"left_elbow": (0.0, -110.0, 0.0)},
        {"right_elbow": (0.0, 110.0, 0.0)},
        {"left_knee": (110.0, 0.0, 0.0)},
        {"left_shoulder": (0.0, 0.0, -70.0)},
        {"left_shoulder": (80.0, 0.0, 0.0)},
        {"left_hip": (-90.0, 0.0, 0.0)},
    ],
    ids=str,
)
def test_correctives_preserve_volume(neutral: Arrays, pose: dict[str, tuple[float, float, float]]) -> None:
    rest = volume(neutral["v_template"].astype(float), neutral["f"])
    lost = {c: abs(rest - volume(posed(neutral, pose, corrected=c), neutral["f"])) for c in (False, True)}
    assert lost[True] < lost[False]


# --- free bodies of before: fits that were made with them keep their joints ---


NEUTRAL = "b80a4e1a310670de6a96bd076779535d2b09b128d9b51c5383c9a9b3389d8503"
MALE = "68a33223dd840cc2d45984290aefd7e2fd45f965cc19378e6a72c2266b0fd1d1"
FORMER_JOINTS = {
    "left_hip": (112, -445, 43),
    "left_knee": (132, -829, 50),
    "left_ankle": (144, -1265, 28),
    "left_elbow": (444, 61, 62),
    "left_wrist": (679, 61, 62),
    "right_shoulder": (-183, 61, 62),
}
"""Millimetres, as printed of the former neutral file."""


@pytest.mark.parametrize("name", FORMER_JOINTS)
def test_a_former_body_has_the_joints_of_its_file(name: str) -> None:
    body = former_body(NEUTRAL)
    assert body is not None and body.hash == NEUTRAL
    np.testing.assert_allclose(1000 * body.rest_joints[JOINT[name]], FORMER_JOINTS[name], atol=0.6)


def test_its_keypoints_lie_where_todays_joints_do(free_body: BodyModel) -> None:
    body = former_body(NEUTRAL)
    assert body is not None and len(body.keypoint_offsets) == 8
    for name, offset in body.keypoint_offsets.items():
        keypoint = body.rest_joints[JOINT[offset.joint]] + offset.offset
        assert np.linalg.norm(keypoint - free_body.rest_joints[JOINT[name]]) < 0.008


def test_runs_and_references_of_before_find_it() -> None:
    for found in (
        Bodies().of(BodyRecord(kind="smplx", gender="neutral", hash=NEUTRAL, source="/gone/SMPLX_NEUTRAL.npz")),
        body_of(BodyOf(kind="smplx", gender="neutral", hash=NEUTRAL)),
    ):
        assert found is former_body(NEUTRAL)


def test_shapes_carry_over_to_the_body_of_today(free_body: BodyModel, tmp_path: Path) -> None:
    np.savez(tmp_path / "fit.npz", betas=np.linspace(-1, 1, 10), body_hash=NEUTRAL)
    found = read_known_shape(tmp_path / "fit.npz", body_hash=free_body.hash)
    np.testing.assert_array_equal(found.betas, np.linspace(-1, 1, 10))
    assert not same_shapes(MALE, free_body.hash) and not same_shapes("", free_body.hash)
    assert is_former(MALE) and not is_former(free_body.hash) and former_body(free_body.hash) is None
