"""What is installed: the tested versions fit the declared ranges, and a built wheel holds all that tcfit needs."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = ("fitting_core", "tcfit_app", "assets")


def requirements() -> list[Requirement]:
    """All of the project's own, with those of tests and checks."""
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    everything = [Requirement(text) for group in groups for text in group]
    return [r for r in everything if r.name != PROJECT["name"]]


def pins() -> dict[str, str]:
    """Versions in constraints.txt by name."""
    lines = [line.strip() for line in (ROOT / "constraints.txt").read_text().splitlines()]
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in pairs}


@pytest.mark.parametrize("requirement", requirements(), ids=lambda r: r.name)
def test_the_tested_version_lies_in_the_declared_range(requirement: Requirement) -> None:
    tested = pins()[canonicalize_name(requirement.name)]
    assert requirement.specifier.contains(tested), f"constraints.txt has {tested}, pyproject.toml asks {requirement}"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """A wheel built from a copy of the sources, for building leaves files in the tree."""
    pytest.importorskip("setuptools", reason="setuptools is not installed, which builds the wheel")
    source = tmp_path_factory.mktemp("source")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source)
    build = "from setuptools import build_meta; print(build_meta.build_wheel('.'))"
    done = subprocess.run([sys.executable, "-c", build], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return zipfile.ZipFile(source / done.stdout.splitlines()[-1])


def test_a_wheel_holds_every_source_and_asset(wheel: zipfile.ZipFile) -> None:
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()]
    wanted = {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    assert wanted <= set(wheel.namelist())


def test_a_wheel_holds_licence_notice_and_command(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    for name in ("LICENSE", "NOTICE"):
        assert any(re.fullmatch(rf"tcfit-.*\.dist-info/licenses/{name}", entry) for entry in names)
    points = next(entry for entry in names if entry.endswith("entry_points.txt"))
    assert "tcfit = tcfit_app.cli.main:main" in wheel.read(points).decode()
