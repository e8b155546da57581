"""Fixtures for all tests."""

import os
import uuid
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.detect import stored
from fitting_core.fit.fused import ready
from fitting_core.render import renderer
from fitting_core.shipped import FREE_FOLDER
from tests.samples.tiny_body import make_tiny_body

# Small problems: on a busy machine two threads that wait for each other take ten times as long as one.
torch.set_num_threads(1)
ready.use(threads=1)
# The first call of an autograd function takes many times as long as the others.
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")


@pytest.hookimpl(tryfirst=True)  # xdist reads the groups in the same hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Where several processes share the tests: a file's stay together, for they share what it sets up. Those that need
    a browser run first, in two rows. On two cores a page may miss what it waits for: such a test is tried once more,
    and `-rR` names it."""
    browsing = {item: "browser" in getattr(item, "fixturenames", ()) for item in items}
    rows = in_two_rows(Counter(item.path for item, browses in browsing.items() if browses))
    for item, browses in browsing.items():
        item.add_marker(pytest.mark.xdist_group(rows[item.path] if browses else item.path.name))
        if browses:
            item.add_marker(pytest.mark.flaky(reruns=1))
    items.sort(key=lambda item: not browsing[item])


def in_two_rows(tests: Counter[Path]) -> dict[Path, str]:
    """About as many tests in one as in the other, a file's in the same."""
    rows, lengths = {}, Counter({"browser 1": 0, "browser 2": 0})
    for path, count in tests.most_common():
        rows[path] = min(lengths, key=lengths.__getitem__)
        lengths[rows[path]] += count
    return rows


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real development data, which is not part of the project; tests that need it skip without it."""
    default = Path(__file__).parents[1] / ".." / "shared" / "data"
    folder = Path(os.environ.get("TCFIT_SHARED_DATA", default)).resolve()
    if not folder.is_dir():
        pytest.skip(f"the shared development data is not at {folder} (TCFIT_SHARED_DATA names another place)")
    return folder


@pytest.fixture(autouse=True)
def keypoint_store(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where detections are kept: of each test's own, in place of the user's cache."""
    folder = tmp_path_factory.getbasetemp() / "found keypoints" / uuid.uuid4().hex
    monkeypatch.setattr(stored, "users_folder", lambda: folder)
    return folder


@pytest.fixture
def in_torch() -> Iterator[None]:
    """The objective without its compiled kernels."""
    ready.use(kernels=False)
    yield
    ready.use(kernels=True)


@pytest.fixture(scope="session")
def off_screen_gl() -> None:
    """Tests that draw skip without it."""
    if renderer.off_screen_gl() is None:
        pytest.skip("no off-screen OpenGL here (apt-get install libegl1 libgl1)")


@pytest.fixture(scope="session")
def tiny_body() -> BodyModel:
    """A synthetic body of 440 vertices in float64 (see tiny_body.py)."""
    return make_tiny_body()


@pytest.fixture(scope="session")
def free_body() -> BodyModel:
    """The free neutral body that comes with tcfit."""
    return load_body(find_body(search=FREE_FOLDER))
