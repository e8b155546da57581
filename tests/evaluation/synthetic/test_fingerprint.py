"""Generated clips in the cache are made anew when anything that shapes them has changed."""

import shutil
from pathlib import Path

import pytest

from evaluation.synthetic.fingerprint import fingerprint
from tests.test_import_graph import MODULES, ROOT, graph, reached

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources."""
    folder = tmp_path_factory.mktemp("copy")
    for package in ("fitting_core", "evaluation"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.mark.parametrize("generator", ["suite", "motion_suite.clips"])
def test_every_module_that_takes_part_counts(root: Path, generator: str):
    start = f"evaluation.synthetic.{generator}"
    modules = {start} | reached(graph(), start)
    assert {"fitting_core.body.mesh", "fitting_core.body.rotations", "fitting_core.camera"} <= modules
    before = fingerprint(root=root)
    for module in sorted(modules):
        file = root / MODULES[module].relative_to(ROOT)
        content = file.read_bytes()
        file.write_bytes(content + b"# changed\n")
        assert fingerprint(root=root) != before, module
        file.write_bytes(content)
    assert fingerprint(root=root) == before


def test_what_it_is_made_of_counts_too(root: Path):
    found = {fingerprint(*parts, root=root) for parts in ([], ["simple_1"], ["simple_2"], ["simple_1", "abc"])}
    assert len(found) == 4


def test_other_modules_do_not_count(root: Path):
    before = fingerprint(root=root)
    (root / "fitting_core" / "fit" / "fitting.py").write_bytes(b"")
    assert fingerprint(root=root) == before
