"""Generated clips in the cache are made anew when anything that shapes them has changed."""

import shutil
from pathlib import Path

import pytest

from fitting_core.synthetic.fingerprint import fingerprint
from tests.test_import_graph import MODULES, ROOT, graph, inside, reached


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of fitting_core's sources."""
    folder = tmp_path_factory.mktemp("copy") / "fitting_core"
    return shutil.copytree(ROOT / "fitting_core", folder, ignore=shutil.ignore_patterns("__pycache__"))


@pytest.mark.parametrize("generator", ["suite", "demo_clip", "motion_suite.clips"])
def test_every_module_that_takes_part_counts(package: Path, generator: str):
    start = f"fitting_core.synthetic.{generator}"
    modules = {start} | {module for module in reached(graph(), start) if inside(module, "fitting_core")}
    assert {"fitting_core.body.mesh", "fitting_core.body.rotations", "fitting_core.camera"} <= modules
    before = fingerprint(package=package)
    for module in sorted(modules):
        file = package / MODULES[module].relative_to(ROOT / "fitting_core")
        content = file.read_bytes()
        file.write_bytes(content + b"# changed\n")
        assert fingerprint(package=package) != before, module
        file.write_bytes(content)
    assert fingerprint(package=package) == before


def test_what_it_is_made_of_counts_too(package: Path):
    found = {fingerprint(*parts, package=package) for parts in ([], ["simple_1"], ["simple_2"], ["simple_1", "abc"])}
    assert len(found) == 4


def test_other_modules_do_not_count(package: Path):
    before = fingerprint(package=package)
    (package / "fit" / "fitting.py").write_bytes(b"")
    assert fingerprint(package=package) == before
