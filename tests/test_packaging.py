"""What is installed: the tested versions fit the declared ranges, and a built wheel holds all that tcfit needs."""

import os
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
FOLDERS = {"fitting_core": "fitting_core", "tcfit_app": "tcfit_app", "assets": "fitting_core/assets"}
"""What is installed, and as what."""


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
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a copy of the sources, for building leaves files in the tree."""
    pytest.importorskip("setuptools", reason="setuptools is not installed, which builds the wheel")
    source = tmp_path_factory.mktemp("source")
    for folder in (*FOLDERS, "benchmarks", "build_assets", "evaluation"):
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source)
    build = "from setuptools import build_meta; print(build_meta.build_wheel('.'))"
    done = subprocess.run([sys.executable, "-c", build], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return source / done.stdout.splitlines()[-1]


@pytest.mark.thorough
def test_a_wheel_holds_every_source_and_asset(wheel: Path) -> None:
    wanted = {
        f"{place}/{path.relative_to(ROOT / folder).as_posix()}"
        for folder, place in FOLDERS.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert wanted <= set(zipfile.ZipFile(wheel).namelist())


@pytest.mark.thorough
def test_a_wheel_holds_licence_notice_and_command(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    names = archive.namelist()
    for name in ("LICENSE", "NOTICE"):
        assert any(re.fullmatch(rf"tcfit-.*\.dist-info/licenses/{name}", entry) for entry in names)
    points = next(entry for entry in names if entry.endswith("entry_points.txt"))
    assert "tcfit = tcfit_app.cli.main:main" in archive.read(points).decode()


@pytest.mark.thorough
def test_an_installed_wheel_finds_its_data_and_takes_no_other_names(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-compile"]
    subprocess.run([*pip, "--target", target, wheel], check=True)
    assert {path.name for path in target.iterdir() if path.suffix != ".dist-info"} == {
        "bin",
        "fitting_core",
        "tcfit_app",
    }
    code = """
from fitting_core import shipped
from fitting_core.body.files.registry import find_body
for path in (find_body(), shipped.DEMO_FOLDER / "video.mp4", shipped.LIFTER, shipped.POSE_PRIOR):
    assert path.is_file()
    print(path)
"""
    # Nothing of the user's own, among which a body would be found first.
    environment = {"PYTHONPATH": str(target), "HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    places = [Path(line) for line in run.stdout.splitlines()]
    assert len(places) == 4 and all(target / "fitting_core" / "assets" in path.parents for path in places)
