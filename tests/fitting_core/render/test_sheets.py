"""Sheets: views that show what they should, and cells in their places."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.render.sheets import Cell, View, beside, sheet, write_sheet


def flat(color: int, height: int, width: int) -> np.ndarray:
    return np.full((height, width, 3), color, np.uint8)


def test_a_view_sees_the_front_and_the_left():
    view = View(center=(0.0, 1.0, 0.0), extent=2.0, size=(200, 300))
    left, up, front = view.pixels(np.array([[0.5, 1, 0], [0, 1.5, 0], [0, 1, 0.5]]))
    assert left[0] > 140 and left[1] == pytest.approx(150), "the body faces us: its left is on our right"
    assert up[1] < 110 and up[0] == pytest.approx(100)
    np.testing.assert_allclose(front, (100, 150), atol=1e-9)
    (side,) = View(center=(0.0, 1.0, 0.0), extent=2.0, size=(200, 300), degrees=90).pixels(np.array([[0, 1, 0.5]]))
    assert side[0] < 60, "from its left, the front is on our left"
    (over,) = View(center=(0.0, 1.0, 0.0), extent=2.0, size=(200, 300), above=30).pixels(np.array([[0, 1, 0.5]]))
    assert over[1] > 160, "seen from above, what is in front is lower"


def test_cells_stand_in_rows():
    cells = [Cell(picture=flat(c, *size)) for c, size in ((10, (40, 30)), (20, (20, 30)), (30, (40, 10)))]
    picture = sheet(cells, 2)
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    assert height >= 40 and width >= 30
    values = [set(np.unique(picture[r : r + height, c : c + width])) for r in (0, height) for c in (0, width)]
    assert values == [{10, 255}, {20, 255}, {30, 255}, {255}]
    assert (picture == 20).sum() == 20 * 30 * 3, "small pictures are not stretched"


def test_captions_stay_within_their_cell():
    cells = [
        Cell(picture=flat(255, 20, 60), caption="a caption far too long for so small a cell"),
        Cell(picture=flat(255, 20, 60)),
    ]
    picture = sheet(cells, 2)
    half = picture.shape[1] // 2
    assert picture[:, :half].min() < 100 and picture[:, half:].min() == 255


def test_pictures_beside_each_other_keep_their_sizes():
    assert beside([flat(0, 10, 5), flat(0, 20, 7)]).shape == (20, 12, 3)


def test_a_sheet_is_written_whole_or_not_at_all(tmp_path: Path):
    cells = [Cell(picture=flat(7, 8, 8))]
    write_sheet(tmp_path / "sheet.png", cells, 1)
    assert (tmp_path / "sheet.png").read_bytes()[:4] == b"\x89PNG"
    for path in (tmp_path / "missing" / "sheet.png", tmp_path / "sheet.nothing"):
        with pytest.raises(InputError, match=r"sheet\.png"):
            write_sheet(path, cells, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]
