"""What `fitting_core` itself offers: every name, without loading torch before one is used, and its examples."""

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

import fitting_core
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.detect.detectors import DETECTORS
from tests.samples.fake_detector import FakeDetector, known, one_person
from tests.samples.posed_clips import CAMERA, clip_of, motion

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
QUICK = replace(PRESETS["tcfit"], relay_rounds=0, limb_flips=False, settings=SolverSettings(iterations=2))


@pytest.mark.parametrize("name", fitting_core.__all__)
def test_a_public_name_is_there(name: str):
    assert getattr(fitting_core, name).__class__ is not ModuleType
    assert name in dir(fitting_core)


def test_no_public_name_is_that_of_a_folder_or_module():
    """It would name the module as soon as somebody had imported that."""
    assert not {module.name for module in pkgutil.iter_modules(fitting_core.__path__)} & set(fitting_core.__all__)


def test_any_other_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'fit_clips'"):
        fitting_core.__getattr__("fit_clips")


def test_the_package_loads_nothing_before_a_name_is_used():
    code = (
        "import sys, fitting_core; dir(fitting_core); from fitting_core import Clip, PRESETS, read_clip;"
        "print(sorted({'torch', 'pyrender'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def blocks(text: str) -> list[str]:
    """Blocks of Python."""
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def imported_by(text: str) -> Iterator[tuple[str, str]]:
    """Modules of ours, and the names that a text's examples take from them."""
    for node in (node for block in blocks(text) for node in ast.walk(ast.parse(block))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "fitting_core":
            yield from ((node.module or "", alias.name) for alias in node.names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_examples_import_what_is_there(page: Path):
    for module, name in imported_by(page.read_text()):
        assert hasattr(importlib.import_module(module), name), (module, name)
        assert module != "fitting_core" or name in fitting_core.__all__


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file of the examples, walk.mp4, and a detector that finds its keypoints."""
    keypoints = clip_of(motion(4), noise=2.0).keypoints
    monkeypatch.setitem(DETECTORS, "mediapipe", known(FakeDetector(one_person(keypoints))))
    video = cv2.VideoWriter(str(tmp_path / "walk.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, CAMERA.size)
    for _ in range(len(keypoints)):
        video.write(np.zeros((*CAMERA.size[::-1], 3), np.uint8))
    video.release()
    monkeypatch.chdir(tmp_path)


def whole_examples() -> list[str]:
    """Of the package's own text and of the README: what fits a clip from its first import on."""
    texts = [fitting_core.__doc__ or "", PAGES[0].read_text()]
    return sorted({block for text in texts for block in blocks(text) if "fit_clip(" in block})


@pytest.mark.parametrize("example", whole_examples())
def test_an_example_runs(
    example: str, walk: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setitem(PRESETS, "tcfit", QUICK)
    exec(example, {})
    assert "torch.Size([4, 63])" in capsys.readouterr().out
