"""Facial gestures on the free body, whatever its components are."""

import numpy as np
import pytest

from evaluation.synthetic.acting.performance import GESTURES, expression_of
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
