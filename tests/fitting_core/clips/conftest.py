"""Videos to read clips of."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.samples.media import write_film


@pytest.fixture
def video(tmp_path: Path) -> Callable[..., Path]:
    """video(count, name="walk.avi"): a grey video of 320 x 240, 25 frames per second, each frame another grey."""

    def write(count: int, name: str = "walk.avi") -> Path:
        return write_film(tmp_path / name, (np.full((240, 320, 3), 40 + t, np.uint8) for t in range(count)))

    return write
