"""Pages without a browser, of a sample project and of a tiny one."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import viser

from fitting_core.body.model import BodyModel
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.project.project import Project
from tests.drivers.lone_page import LonePage, sample_project, tiny_page

ATTACK = "<img src=x onerror=alert(1)>"
Opener = Callable[[type], LonePage]


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Project]:
    with sample_project(tmp_path / "walk.tcfit", "first", ATTACK) as made:
        yield made


@pytest.fixture
def tested(page_of: Callable[..., LonePage], project: Project) -> LonePage:
    return page_of(project)


@pytest.fixture
def panel_of(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[Opener]:
    with ExitStack() as opened:
        yield lambda kind: opened.enter_context(tiny_page(panel_server, tmp_path / "p", tiny_body, kind))


def suspect(frame: int, *, reason: str = "left wrist 42 px off", joints: tuple[int, ...] = (7,)) -> Suspect:
    frames = range(frame, frame + 1)
    return Suspect(
        frame=frame, frames=frames, score=2.0, kind="cost", reason=reason, joints=joints, about=("left arm",), also=()
    )


def with_suspects(tested: LonePage, *found: Suspect) -> None:
    queue = ReviewQueue(left=found, looked_at=1)
    tested.page.tab.data.queue = lambda shown: queue  # pyright: ignore[reportAttributeAccessIssue]
