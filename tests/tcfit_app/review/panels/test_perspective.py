"""What a focal length means, in words."""

import numpy as np
import pytest

from fitting_core.keypoints import COUNT, INDEX, Keypoints
from tcfit_app.review.panels.fit.perspective import (
    LENSES,
    Perspective,
    focal_of_lens,
    metre_in_pixels,
)

SIZE = (1920, 1080)


def person(metre: float, *, hips: bool = True) -> Keypoints:
    """Who stands upright before the camera, in five frames; in one of them a shoulder is far off."""
    xy, confidence = np.zeros((5, COUNT, 2)), np.zeros((5, COUNT))
    for side, sign in (("left", 1), ("right", -1)):
        for name, x, y in (("shoulder", 0.185, 0.0), ("hip", 0.185, 0.5)):
            xy[:, INDEX[f"{side}_{name}"]] = (900 + sign * metre * x, 300 + metre * y)
            confidence[:, INDEX[f"{side}_{name}"]] = 0.9 if hips or name == "shoulder" else 0.1
    xy[3, INDEX["left_shoulder"]] = (5000, 300)
    return Keypoints(xy=xy, confidence=confidence)


@pytest.mark.parametrize("hips", [True, False])
def test_the_person_s_distance_follows_from_trunk_or_shoulders(hips: bool):
    metre = metre_in_pixels(person(200.0, hips=hips))
    assert metre == pytest.approx(200.0)
    assert Perspective(focal=1000.0, size=SIZE, metre=metre).distance == pytest.approx(5.0)


def test_a_longer_lens_sees_less_from_farther_away():
    short, long = (
        Perspective(focal=focal_of_lens(n, SIZE), size=SIZE, metre=400.0) for n in ("wide 24", "portrait 85")
    )
    assert short.angle > 3 * long.angle and short.millimetres == pytest.approx(24)
    assert short.words == (
        "24 mm (35 mm equivalent), 76° wide; the person is about 3.1 m away. An outstretched hand looks 24 % larger"
    )
    assert long.words.endswith("about 10.8 m away. An outstretched hand looks 6 % larger")
    assert set(LENSES) >= {"phone 28"}


def test_what_is_not_known_or_cannot_be():
    nothing = Keypoints(xy=np.zeros((3, COUNT, 2)), confidence=np.zeros((3, COUNT)))
    assert metre_in_pixels(nothing) is None
    alone = Perspective(focal=1000.0, size=SIZE, metre=None)
    assert alone.words == "20 mm (35 mm equivalent), 88° wide"
    near = Perspective(focal=100.0, size=SIZE, metre=200.0)
    assert near.words.endswith("about 0.5 m away, which is hardly possible")
