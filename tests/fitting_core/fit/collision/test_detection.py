"""Finding colliding triangles: the narrow phase, the broad phase, body parts, and posed bodies."""

from dataclasses import replace
from fractions import Fraction
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fitting_core.body.bounding_tree import build_tree
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, JOINTS
from fitting_core.body.params import BodyParams
from fitting_core.fit.collision.detection import (
    LEAF_SIZE,
    body_collision_finder,
    body_parts,
    collision_finder,
    neighbouring_parts,
    overlapping_triangles,
    triangles_intersect,
)

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


def soup(seed, count, size):
    """Separate triangles of about this size in the unit cube."""
    rng = np.random.default_rng(seed)
    vertices = (rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))).reshape(-1, 3)
    return vertices, np.arange(3 * count).reshape(count, 3)


@settings(max_examples=150, deadline=None)
@given(grid_pairs)
def test_triangles_that_touch_or_are_coplanar(pair):
    expected = intersect_by_separating_axes(*pair)
    assert triangles_intersect(*pair[:, None].astype(float))[0] == expected
    assert triangles_intersect(*pair[::-1, None].astype(float))[0] == expected


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_triangles_in_general_position(seed):
    pairs = np.random.default_rng(seed).standard_normal((20, 2, 3, 3))
    assert triangles_intersect(pairs[:, 0], pairs[:, 1]).tolist() == [intersect_by_separating_axes(*p) for p in pairs]


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
def test_neighbouring_parts(free_body, a, b, expected):
    ignored = neighbouring_parts(free_body.parents, body_parts(free_body), free_body.faces)
    assert ignored[JOINT[a], JOINT[b]] == ignored[JOINT[b], JOINT[a]] == expected


def test_hands_in_the_thighs_collide_with_these_only_and_nothing_does_at_rest(free_body):
    """What touches in the rest pose never counts."""
    rest, finder = BodyParams.neutral(1), body_collision_finder(free_body)
    lowered = rest.body_pose.clone()
    lowered[0, 3 * (JOINT["left_shoulder"] - 1) + 2] = -1.45
    still, posed = (Mesh(free_body)(params)[0].numpy() for params in (rest, replace(rest, body_pose=lowered)))
    assert len(finder.find(free_body.template)) == len(finder.find(still)) == 0
    names = {JOINTS[part] for part in body_parts(free_body)[finder.find(posed)].reshape(-1)}
    arm = {"left_elbow", "left_wrist", *(f"left_{finger}1" for finger in ("thumb", "index", "middle", "ring", "pinky"))}
    assert "left_hip" in names and names & arm and names <= arm | {"left_hip", "pelvis"}
    resting = replace(free_body, template=posed.astype(float))
    assert len(body_collision_finder(resting).find(resting.template)) == 0
