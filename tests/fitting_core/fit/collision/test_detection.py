"""Finding colliding triangles: the exact test, the broad phase, body parts, and posed bodies."""

from fractions import Fraction
from itertools import combinations, product

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from fitting_core.body.bounding_tree import build_tree
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import JOINT, JOINTS, N_JOINTS, BodyModel
from fitting_core.fit.collision.broad_phase import LEAF_SIZE, overlapping_triangles
from fitting_core.fit.collision.detection import body_collision_finder, collision_finder
from fitting_core.fit.collision.intersection import orientation, triangles_intersect
from fitting_core.fit.collision.parts import body_parts, neighbouring_parts, parts_of_faces
from fitting_core.shipped import FREE_FOLDER

grid_pairs = hnp.arrays(np.int64, (2, 3, 3), elements=st.integers(-2, 2))


def intersect_by_separating_axes(first, second):
    """Reference in rational arithmetic: closed triangles are disjoint exactly if a candidate axis separates them."""
    a, b = ([[Fraction(x) for x in corner] for corner in np.asarray(triangle).tolist()] for triangle in (first, second))
    edges_a, edges_b = ([np.subtract(t[(k + 1) % 3], t[k]) for k in range(3)] for t in (a, b))
    normal_a, normal_b = np.cross(edges_a[0], edges_a[1]), np.cross(edges_b[0], edges_b[1])
    if not normal_a.any() or not normal_b.any():
        return False
    axes = [normal_a, normal_b, *(np.cross(u, v) for u, v in product(edges_a, edges_b))]
    axes += [np.cross(normal_a, u) for u in edges_a] + [np.cross(normal_b, u) for u in edges_b]
    spans = [([np.dot(axis, p) for p in a], [np.dot(axis, p) for p in b]) for axis in axes]
    return not any(max(p) < min(q) or max(q) < min(p) for p, q in spans)


def all_intersecting_pairs(vertices, faces):
    pairs = [(s, t) for s, t in combinations(range(len(faces)), 2) if not set(faces[s]) & set(faces[t])]
    return [pair for pair in pairs if intersect_by_separating_axes(*vertices[faces[list(pair)]])]


def soup(seed, count, size):
    """Separate triangles of about this size in the unit cube."""
    rng = np.random.default_rng(seed)
    vertices = (rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))).reshape(-1, 3)
    return vertices, np.arange(3 * count).reshape(count, 3)


@settings(max_examples=300, deadline=None)
@given(grid_pairs)
def test_intersection_is_exact_where_triangles_touch_or_are_coplanar(pair):
    expected = intersect_by_separating_axes(*pair)
    assert triangles_intersect(*pair[:, None].astype(float))[0] == expected
    assert triangles_intersect(*pair[::-1, None].astype(float))[0] == expected


@settings(max_examples=200, deadline=None)
@given(grid_pairs, st.sampled_from([0.1, 1 / 3, 1e-7, 1e7]), st.integers(-3, 3))
def test_intersection_is_exact_for_rounded_coordinates(pair, scale, shift):
    pair = pair * scale + shift / 7
    assert triangles_intersect(*pair[:, None])[0] == intersect_by_separating_axes(*pair)


def test_orientation_decides_what_floats_cannot():
    a, b, c = np.array([[[12.0, 12.0, 0.0]], [[24.0, 24.0, 0.0]], [[0.0, 0.0, 1.0]]])
    ulp = 2.0**-53
    d = np.array([[0.5 + ulp * 2, 0.5, 0.25], [0.5, 0.5, 0.25], [0.5 - ulp, 0.5, 0.25]])
    a, b, c = (np.repeat(x, 3, axis=0) for x in (a, b, c))
    assert orientation(a, b, c, d).tolist() == [1, 0, -1]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([0.01, 0.1, 1.0]), st.integers(1, 4))
def test_broad_phase_finds_what_all_pairs_find(seed, count, size, n_groups):
    vertices, faces = soup(seed, count, size)
    groups = np.unique(np.random.default_rng(seed).integers(0, n_groups, count), return_inverse=True)[1]
    wanted = np.array(
        [(a, b) for a, b in combinations(range(groups.max(initial=-1) + 1), 2) if (a + b) % 3 < 2] + [(0, 0)]
    )
    wanted = wanted[wanted.max(axis=1) <= groups.max(initial=-1)]
    other_pose = vertices[np.random.default_rng(seed).permutation(len(vertices))]
    tree = build_tree(other_pose[faces].mean(axis=1), leaf_size=LEAF_SIZE, groups=groups)
    found = [tuple(pair) for pair in overlapping_triangles(tree, vertices, faces, wanted)]

    low, high = vertices[faces].min(axis=1), vertices[faces].max(axis=1)
    pairs = [
        pair for pair in combinations(range(count), 2) if tuple(sorted(groups[list(pair)])) in set(map(tuple, wanted))
    ]
    expected = {(s, t) for s, t in pairs if (low[s] <= high[t]).all() and (low[t] <= high[s]).all()}
    assert len(found) == len(set(found))
    assert set(found) == expected


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.1, 0.3]))
def test_collisions_of_a_soup(seed, size):
    vertices, faces = soup(seed, 15, size)
    faces[::5, 0] = faces[1::5, 1]  # some triangles share a vertex
    assert list(map(tuple, collision_finder(vertices, faces).find(vertices))) == all_intersecting_pairs(vertices, faces)


def test_closed_surfaces_collide_only_while_they_overlap():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    for distance, collide in [(0.0, True), (0.15, True), (0.21, False)]:
        vertices = np.concatenate([ball.vertices, ball.vertices + np.array([distance, 0.003, 0.001])])
        pairs = collision_finder(vertices, faces).find(vertices)
        assert (len(pairs) > 0) == collide
        assert (pairs[:, 0] < len(ball.faces)).all() and (pairs[:, 1] >= len(ball.faces)).all()


def test_ignored_parts_do_not_count():
    vertices, faces = soup(3, 200, 0.1)
    parts = np.arange(200) % 3 * 5
    ignored = np.eye(11, dtype=bool)
    ignored[0, 5] = ignored[5, 0] = True
    pairs = collision_finder(vertices, faces).find(vertices)
    kept = ~ignored[parts[pairs[:, 0]], parts[pairs[:, 1]]]
    assert 0 < kept.sum() < len(pairs)
    np.testing.assert_array_equal(
        collision_finder(vertices, faces, parts=parts, ignored=ignored).find(vertices), pairs[kept]
    )


def tube(start, end, radius):
    return trimesh.creation.cylinder(radius=radius, segment=[start, end], sections=24).subdivide()


def model_of(pieces, parents):
    """A body model with one rigid mesh per joint name."""
    names, meshes = zip(*pieces, strict=True)
    mesh = trimesh.util.concatenate(meshes)
    weights = np.zeros((len(mesh.vertices), N_JOINTS))
    weights[np.arange(len(weights)), np.repeat([JOINT[n] for n in names], [len(m.vertices) for m in meshes])] = 1
    count = len(weights)
    return BodyModel(
        kind="smplx",
        gender="neutral",
        template=np.array(mesh.vertices),
        shape_directions=np.broadcast_to(0.0, (count, 3, 10)),
        expression_directions=np.broadcast_to(0.0, (count, 3, 10)),
        pose_directions=np.broadcast_to(0.0, (count, 3, 486)),
        joint_regressor=np.broadcast_to(0.0, (N_JOINTS, count)),
        skinning_weights=weights,
        parents=parents,
        faces=np.array(mesh.faces),
        hand_components=np.zeros((2, 45, 45)),
        hand_mean=np.zeros((2, 45)),
        surface_keypoints={},
        landmark_vertices=np.zeros((51, 3), dtype=int),
        landmark_weights=np.zeros((51, 3)),
        contour_vertices=np.zeros((79, 17, 3), dtype=int),
        contour_weights=np.zeros((79, 17, 3)),
    )


_BODY_PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15]
_FINGER_PARENTS = [
    wrist if k == 0 else joint - 1
    for wrist, first in ((20, 25), (21, 40))
    for joint, k in ((first + i, i % 3) for i in range(15))
]
SMPLX_PARENTS = np.array(_BODY_PARENTS + _FINGER_PARENTS)


@pytest.fixture(scope="module")
def tubes():
    """Torso, forearm, hand and a finger as tubes; a box rests inside the torso, as eyes rest inside a head."""
    pieces = [
        ("spine1", tube([0, 0, 0], [0, 0.5, 0], 0.15)),
        ("left_elbow", tube([0.4, 0.25, 0], [0.6, 0.25, 0], 0.04)),
        ("left_wrist", tube([0.59, 0.25, 0], [0.7, 0.25, 0], 0.05)),
        ("left_index3", tube([0.69, 0.25, 0.02], [0.76, 0.25, 0.02], 0.01)),
        ("left_foot", trimesh.creation.box([0.4, 0.05, 0.05]).apply_translation([0, 0.05, 0.0])),
    ]
    return model_of(pieces, SMPLX_PARENTS)


def test_triangles_that_intersect_at_rest_never_count(tubes):
    parts = body_parts(tubes)
    ignored = neighbouring_parts(tubes.parents, parts, tubes.faces)
    every = collision_finder(tubes.template, tubes.faces, parts=parts, ignored=ignored)
    assert len(every.find(tubes.template)) > 0
    assert len(body_collision_finder(tubes).find(tubes.template)) == 0


def test_hand_through_torso_collides_with_the_torso_only(tubes):
    arm = tubes.template[:, 0] > 0.35
    turned = tubes.template.copy()
    turned[arm] = (turned[arm] - [0.4, 0.25, 0]) * [-1, 1, -1] + [0.4, 0.25, 0]
    parts = body_parts(tubes)
    pairs = body_collision_finder(tubes).find(turned)
    names = {frozenset((JOINTS[parts[s]], JOINTS[parts[t]])) for s, t in pairs}
    assert names == {frozenset(("spine1", "left_wrist"))}


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ("left_elbow", "left_wrist", True),
        ("left_hip", "right_hip", True),
        ("left_middle1", "left_ring1", True),
        ("left_index1", "left_wrist", True),
        ("left_index1", "right_index1", False),
        ("left_thumb1", "left_pinky1", False),
        ("left_wrist", "spine3", False),
        ("left_wrist", "head", False),
        ("left_knee", "right_knee", False),
    ],
)
def test_neighbouring_parts(tubes, a, b, expected):
    ignored = neighbouring_parts(SMPLX_PARENTS, body_parts(tubes), tubes.faces)
    assert ignored[JOINT[a], JOINT[b]] == ignored[JOINT[b], JOINT[a]] == expected


def pose_body(body, rotations):
    """Linear blend skinning without correctives; rotations are axis-angle by joint name."""
    joints, parents = body["J_regressor"] @ body["v_template"], body["kintree_table"][0]
    transforms = np.tile(np.eye(4), (N_JOINTS, 1, 1))
    for j in range(N_JOINTS):
        transforms[j, :3, :3] = Rotation.from_rotvec(rotations.get(JOINTS[j], (0.0, 0.0, 0.0))).as_matrix()
        transforms[j, :3, 3] = joints[j] - (joints[parents[j]] if j else 0)
        transforms[j] = (transforms[parents[j]] if j else np.eye(4)) @ transforms[j]
    transforms[:, :3, 3] -= np.einsum("jab,jb->ja", transforms[:, :3, :3], joints)
    blended = np.tensordot(body["weights"], transforms, axes=1)
    return np.einsum("vab,vb->va", blended[:, :3, :3], body["v_template"]) + blended[:, :3, 3]


def test_free_body_with_its_hand_in_its_thigh():
    with np.load(find_body(search=FREE_FOLDER), allow_pickle=False) as body:
        body = dict(body)
    faces, parents = body["f"].astype(np.int64), body["kintree_table"][0].astype(np.int64)
    parts = parts_of_faces(body["weights"], faces)
    ignored = neighbouring_parts(parents, parts, faces)
    finder = collision_finder(body["v_template"], faces, parts=parts, ignored=ignored).without_resting(
        body["v_template"]
    )
    assert len(finder.find(pose_body(body, {}))) == 0
    pairs = finder.find(pose_body(body, {"left_shoulder": (0, 0, -1.5)}))
    names = {JOINTS[part] for part in parts[pairs].reshape(-1)}
    arm = {"left_elbow", "left_wrist", *(f"left_{finger}1" for finger in ("thumb", "index", "middle", "ring", "pinky"))}
    assert "left_hip" in names and names & arm and names <= arm | {"left_hip", "pelvis"}
