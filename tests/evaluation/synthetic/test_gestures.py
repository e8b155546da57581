"""Facial gestures on the free body, whatever its components are."""

import numpy as np
import pytest

from evaluation.synthetic.acting.performance import GESTURES, expression_of, expressions
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.shipped import FREE_FOLDER


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body(find_body(search=FREE_FOLDER))


def moved(body: BodyModel, coefficients: np.ndarray) -> np.ndarray:
    """Millimetres by which the 51 landmarks move."""
    vertices = body.expression_directions @ coefficients
    return 1000 * (vertices[body.landmark_vertices] * body.landmark_weights[..., None]).sum(1)


@pytest.mark.parametrize("gesture", GESTURES)
def test_landmarks_move_as_wanted_and_coefficients_stay_usual(body: BodyModel, gesture: str) -> None:
    coefficients = expression_of(body, gesture)
    found = moved(body, coefficients)
    for landmark, wanted in GESTURES[gesture].items():
        if np.linalg.norm(wanted) > 2:
            assert found[landmark] @ wanted > 0.25 * np.dot(wanted, wanted)
    assert np.abs(coefficients).max() < 3.5


def test_a_blink_closes_the_eyes(body: BodyModel) -> None:
    landmarks = (body.template[body.landmark_vertices] * body.landmark_weights[..., None]).sum(1) * 1000
    open_by = landmarks[[20, 21, 26, 27], 1] - landmarks[[24, 23, 30, 29], 1]
    closed = landmarks + moved(body, expression_of(body, "blink"))
    assert (closed[[20, 21, 26, 27], 1] - closed[[24, 23, 30, 29], 1] < 0.5 * open_by).all()


def test_gestures_add_up_over_time(body: BodyModel) -> None:
    strengths = {"blink": np.array([0.0, 1.0]), "smile": np.array([0.5, 0.0])}
    found = expressions(body, strengths)
    np.testing.assert_allclose(found[0], 0.5 * expression_of(body, "smile"))
    np.testing.assert_allclose(found[1], expression_of(body, "blink"))
