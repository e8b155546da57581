"""How the canvas is divided among posters. No browser."""

import pytest

from tcfit_app.review.scene.poses import Rectangle, Window
from tcfit_app.review.scene.windows import Arrangement, divide

CANVAS = Window(width=1000, height=566)
LANDSCAPE, PORTRAIT = 16 / 9, 9 / 16


def size(window: Rectangle) -> tuple[float, float]:
    return window[2] - window[0], window[3] - window[1]


@pytest.mark.parametrize("arrangement", ["beside", "stacked", "wipe"])
@pytest.mark.parametrize("width", [LANDSCAPE, PORTRAIT])
@pytest.mark.parametrize("side", [None, 0.6])
def test_whole_pictures_have_room_in_windows_of_one_size(arrangement: Arrangement, width: float, side: float | None):
    division = divide(CANVAS, pictures=2, width=width, side=side, arrangement=arrangement)
    one, other = division.windows[:2]
    assert size(one) == pytest.approx(size(other)) and size(one) == pytest.approx(division.room)
    assert division.scale * width < size(one)[0] and division.scale < size(one)[1]
    fit = max(division.scale * width / size(one)[0], division.scale / size(one)[1])
    assert fit > 0.9, "as large as they can be"
    assert all(
        0 <= left < right <= 1000.01 and 0 <= top < bottom <= 566.01 for left, top, right, bottom in (one, other)
    )
    assert (one == other) == (arrangement == "wipe")
    if side is not None:
        left, top, right, bottom = division.windows[2]
        assert (right, top, bottom) == (1000, 0, 566) and left > other[2]
        assert right - left == pytest.approx(side * division.scale), "its plate fills it"


@pytest.mark.parametrize(
    ("width", "height", "picture", "expected"),
    [
        (1000, 600, PORTRAIT, "beside"),
        (1900, 700, LANDSCAPE, "beside"),
        (1000, 900, LANDSCAPE, "stacked"),
        (400, 1200, PORTRAIT, "stacked"),
    ],
)
def test_pictures_are_stacked_where_that_makes_them_larger(
    width: int, height: int, picture: float, expected: Arrangement
):
    canvas = Window(width=width, height=height)
    chosen = divide(canvas, pictures=2, width=picture)
    assert chosen.arrangement == expected
    both = [divide(canvas, pictures=2, width=picture, arrangement=way).scale for way in ("beside", "stacked")]
    assert chosen.scale == max(both)


def test_a_part_of_the_picture_fills_each_window():
    division = divide(CANVAS, pictures=2, width=LANDSCAPE)
    scale = division.scale_of(0.2, 0.1)
    assert max(0.2 * scale / division.room[0], 0.1 * scale / division.room[1]) == pytest.approx(1 / 1.03)
