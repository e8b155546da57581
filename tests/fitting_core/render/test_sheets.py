"""Sheets: views that show what they should, and cells in their places."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.render.sheets import Cell, View, write_sheet


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


def test_a_sheet_is_written_whole_or_not_at_all(tmp_path: Path):
    cells = [Cell(picture=flat(7, 8, 8))]
    write_sheet(tmp_path / "sheet.png", cells, 1)
    assert (tmp_path / "sheet.png").read_bytes()[:4] == b"\x89PNG"
    for path in (tmp_path / "missing" / "sheet.png", tmp_path / "sheet.nothing"):
        with pytest.raises(InputError, match=r"sheet\.png"):
            write_sheet(path, cells, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]
