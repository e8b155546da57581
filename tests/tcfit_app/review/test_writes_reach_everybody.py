"""What is written into the project is known to everybody, whatever becomes of the tab that asked for it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.drivers.lone_page import LonePage
from tests.samples.media import write_images
from tests.samples.project_samples import FRAMES

FIRST = 7
"""The number in the video of the sample clip's frame 0."""


def images(folder: Path, *, seed: int = 0) -> Path:
    return write_images(folder, *(f"{frame:03}.png" for frame in range(FIRST + FRAMES)), seed=seed)


def camera(path: Path) -> Path:
    K = [[700.0, 0, 320], [0, 700, 240], [0, 0, 1]]
    np.savez(path, R=np.eye(3), t=np.zeros(3), K=K)
    return path


@dataclass(frozen=True)
class Write:
    """What somebody asks for in a panel, and what stands for what others know of it."""

    make: Callable[[Path], Path]
    field: str
    command: str
    known: Callable[[LonePage], object]
    told: str


WRITES = {
    "video": Write(images, "New location", "review.relink", lambda page: page.page.tab.data.video, "Video found"),
    "camera": Write(
        lambda path: camera(path.with_suffix(".npz")),
        "Camera file",
        "fit.camera",
        lambda page: page.page.tab.session.project.keypoints_version,
        "Camera replaced",
    ),
}


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES.keys())
def test_a_write_is_known_though_its_tab_was_closed_meanwhile(sample_page: LonePage, tmp_path: Path, write: Write):
    before = write.known(sample_page)
    sample_page.field(write.field)._impl.value = str(write.make(tmp_path / "given"))
    sample_page.press(write.command)
    sample_page.page.close()
    sample_page.settle()
    assert write.known(sample_page) != before
    assert [notice.title for notice in sample_page.notices] == [write.told]
