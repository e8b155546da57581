"""The outlines of bodies. No browser."""

import numpy as np
import trimesh

from tcfit_app.review.scene.nodes import edges_of, outline


def test_the_outline_of_a_ball_is_its_circle():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    lines = outline(np.add(ball.vertices, [0.1, -0.2, 2.0]), ball.faces)
    radii = np.linalg.norm(lines[..., :2] - [0.1, -0.2], axis=-1)
    assert len(lines) > 40 and radii.min() > 0.97 * 0.3 and radii.max() <= 0.3 + 1e-6
    ends, counts = np.unique(lines.reshape(-1, 3).round(6), axis=0, return_counts=True)
    assert (counts % 2 == 0).all() and len(ends) == len(lines), "it is closed"


def test_an_edge_has_the_faces_of_both_its_sides_and_a_rim_the_one_that_it_has():
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    edges = edges_of(faces)
    found = {tuple(ends): set(sides) for ends, sides in zip(edges.ends.tolist(), edges.sides.tolist(), strict=True)}
    assert found == {(0, 1): {0}, (0, 2): {0}, (1, 2): {0, 1}, (1, 3): {1}, (2, 3): {1}}
    assert edges_of(faces) is edges
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    assert len(outline(flat, faces)) == 4


def test_where_a_body_is_not_sure_its_outline_is_broken():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    vertices = np.add(ball.vertices, [0.0, 0.0, 2.0])
    whole = outline(vertices, ball.faces, np.full(len(vertices), 255, np.uint8))
    assert np.array_equal(whole, outline(vertices, ball.faces))
    broken = outline(vertices, ball.faces, np.where(vertices[:, 0] < 0, 100, 255).astype(np.uint8))
    for left, share in ((False, 1.0), (True, 0.5)):
        before, after = (((lines[..., 0].mean(1) < -0.02) == left).sum() for lines in (whole, broken))
        assert before > 20 and abs(after / before - share) < 0.1
