"""Division of the canvas among posters: each has its own window, and all pictures show the same part. Without viser.

There is one camera, which looks at one picture. The page draws each poster as if its window's centre were the canvas's,
clipped to its window: so the wheel zooms all pictures at once, each about the same pixel.
"""

from dataclasses import dataclass
from typing import Literal

from tcfit_app.review.scene.poses import Rectangle, Window

Arrangement = Literal["beside", "stacked", "wipe"]
"""Of two pictures: side by side, one above the other, or superimposed with a divider."""
_GAP = 8.0
"""Gap between two windows, CSS pixels."""
MARGIN = 1.03
"""Room for a picture, relative to its size."""
_CLEARLY = 1.05
"""How much larger stacking must make the pictures to be chosen by default."""


@dataclass(frozen=True, kw_only=True)
class Division:
    """The posters' windows, in CSS pixels of the canvas."""

    windows: tuple[Rectangle, ...]
    """Of the pictures, all of one size, then of the side view if any."""
    scale: float
    """Pixels per image height at which a window shows the whole picture."""
    arrangement: Arrangement

    @property
    def room(self) -> tuple[float, float]:
        """Width and height of the pictures' windows."""
        left, top, right, bottom = self.windows[0]
        return right - left, bottom - top

    def scale_of(self, width: float, height: float) -> float:
        """Pixels per image height at which a part of a picture fills its window; its size in image heights."""
        return min(self.room[0] / width, self.room[1] / height) / MARGIN


def divide(
    canvas: Window, *, pictures: int, width: float, side: float | None = None, arrangement: Arrangement | None = None
) -> Division:
    """Windows for posters.

    Args:
        canvas: The available space.
        pictures: One or two.
        width: Of a picture, in image heights.
        side: Width of the side view's plate on the right, in image heights, if any.
        arrangement: Of two pictures; None: side by side, or stacked if that makes them clearly larger.
    """
    if pictures == 1:
        return _divided(canvas, 1, width, side, "beside")
    if arrangement is not None:
        return _divided(canvas, pictures, width, side, arrangement)
    beside, stacked = (_divided(canvas, pictures, width, side, way) for way in ("beside", "stacked"))
    return stacked if stacked.scale > _CLEARLY * beside.scale else beside


def _divided(canvas: Window, pictures: int, width: float, side: float | None, arrangement: Arrangement) -> Division:
    columns = pictures if arrangement == "beside" else 1
    rows = pictures if arrangement == "stacked" else 1
    plate = 0.0 if side is None else side
    across = max(canvas.width - _GAP * (columns - 1 + (side is not None)), 1.0)
    down = max(canvas.height - _GAP * (rows - 1), 1.0)
    scale = min(across / (columns * width + plate), down / rows) / MARGIN
    room = (across - plate * scale) / columns, down / rows
    places = [
        (column * (room[0] + _GAP), row * (room[1] + _GAP)) for row in range(rows) for column in range(columns)
    ] * (pictures if arrangement == "wipe" else 1)
    windows = [(x, y, x + room[0], y + room[1]) for x, y in places]
    if side is not None:
        windows.append((canvas.width - plate * scale, 0.0, canvas.width, max(canvas.height, 1.0)))
    return Division(windows=tuple(windows), scale=scale, arrangement=arrangement)
