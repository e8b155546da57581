"""Each malformed file gives a clear error that names it, in the library and on the command line; nothing is written."""

import re
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from tcfit_app.cli.main import main
from tests.fitting_core.io.malformed import KEYPOINTS, Case
from tests.fitting_core.io.malformed_cameras import CAMERAS
from tests.fitting_core.io.malformed_laboratory import LABORATORY
from tests.fitting_core.io.malformed_learned import LEARNED
from tests.fitting_core.io.malformed_models import MODELS
from tests.fitting_core.io.malformed_per_image import PER_IMAGE
from tests.fitting_core.io.malformed_references import REFERENCES
from tests.fitting_core.io.malformed_results import RESULTS

CASES = {**KEYPOINTS, **RESULTS, **LEARNED, **PER_IMAGE, **MODELS, **REFERENCES, **CAMERAS, **LABORATORY}
LONG = "more objects than the memory holds"
"""Takes seconds to be read, whatever it is given as."""


def files_in(folder: Path) -> dict[str, bytes | None]:
    """All that is in a folder, by path; None for folders."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the working folder, of somebody who has no models."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "nobody"))
    folder = tmp_path / "broken"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] * name.endswith(LONG)) for name in CASES]
)
def test_a_clear_error_and_nothing_written(name: str, broken: Path):
    case: Case = CASES[name]
    path = case.make(broken)
    before = files_in(broken)
    with pytest.raises(InputError, match=case.says) as error:
        case.read(path)
    message = str(error.value)
    assert (case.name or path.name) in message
    assert len(message) < 700 and "Traceback" not in message and not re.search(r"<\w+ object at", message)
    assert files_in(broken) == before


COMMANDS: dict[str, list[str]] = {
    "openpose NaN": ["new", "--keypoints", "{}", "--out", "made"],
    "openpose nested": ["fit", "--keypoints", "{}", "--out", "made"],
    "coco hand of 20": ["new", "--keypoints", "{}", "--out", "made"],
    "pose truncated points": ["new", "--keypoints", "{}", "--out", "made"],
    "an unknown text": ["fit", "--keypoints", "{}", "--out", "made"],
    "video is a text": ["new", "{}", "--keypoints", ".", "--out", "made"],
    "body pickle bomb": ["models", "add", "{}"],
    "vposer truncated": ["models", "add", "{}"],
    "config unknown setting": ["fit", "--config", "{}", "--keypoints", ".", "--out", "made"],
    "project of a newer tcfit": ["review", "--no-browser", "{}"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_on_the_command_line(name: str, broken: Path, capsys: pytest.CaptureFixture):
    case = CASES[name]
    path = case.make(broken)
    before = files_in(broken)
    # A project that was opened for writing keeps its lock's file.
    assert main([part.replace("{}", str(path)) for part in COMMANDS[name]]) == 2
    err = capsys.readouterr().err
    assert "tcfit: " in err and "Traceback" not in err
    assert re.search(case.says, err.replace("\n", " ")) or path.name in err
    assert {name: data for name, data in files_in(broken).items() if Path(name).name != "project.lock"} == before
