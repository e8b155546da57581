"""What `fitting_core` itself offers: every name, without loading torch before one is used, and its examples."""

import pkgutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

import fitting_core
from fitting_core.config.schema import PRESETS, SolverSettings

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
