"""Plugins: the package that docs/plugins.md shows, installed and used; and broken ones, which never take tcfit down."""

import logging
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import pytest
import viser

from fitting_core import plugins
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.result_files import write_result
from fitting_core.keypoints import INDEX
from tcfit_app import plugin_api
from tcfit_app.cli import doctor
from tcfit_app.cli.main import main
from tcfit_app.exports.table import exports
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.panels.review_panel import ReviewPanel
from tests.drivers.lone_page import tiny_page
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_fit

PAGE = Path(__file__).parents[2] / "docs" / "plugins.md"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pip has put the package of the page."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("packages")
    blocks = dict(BLOCK.findall(PAGE.read_text()))
    (source / "pyproject.toml").write_text(blocks["toml"])
    (source / "tcfit_lab.py").write_text(blocks["python"])
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run([*pip, "--target", target, source], check=True, capture_output=True, text=True)
    return target


@pytest.fixture
def on_path(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """For packages that a test adds: they are forgotten when it ends."""
    plugins.forget()
    yield monkeypatch
    monkeypatch.undo()
    for name in ("tcfit_lab", "odd"):
        sys.modules.pop(name, None)
    plugins.forget()


@pytest.fixture
def lab(installed: Path, on_path: pytest.MonkeyPatch) -> None:
    """The package of the page can be imported."""
    on_path.syspath_prepend(installed)


@pytest.fixture
def odd(tmp_path: Path, on_path: pytest.MonkeyPatch):
    """Makes a package "odd" of some code and entry points, as pip leaves it."""

    def make(code: str, **groups: str) -> None:
        folder = tmp_path / "packages"
        about = folder / "odd-0.1.dist-info"
        about.mkdir(parents=True)
        (folder / "odd.py").write_text(code)
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: odd\nVersion: 0.1\n")
        points = "".join(f"[tcfit.{group}]\n{line}\n" for group, line in groups.items())
        (about / "entry_points.txt").write_text(points)
        on_path.syspath_prepend(folder)

    return make


# --- the package of the page ---


def test_its_reader_reads(lab: None, tmp_path: Path):
    path = tmp_path / "walk.points.csv"
    path.write_text("frame,keypoint,x,y,confidence\n0,nose,10,20,0.5\n2,left_wrist,30,40,1\n")
    found = read_detections(path)
    assert len(found) == 3 and found.frames[2][0, INDEX["left_wrist"]].tolist() == [30, 40, 1]
    path.write_text("frame,keypoint,x,y,confidence\n")
    with pytest.raises(InputError, match="has no rows; expected frame,keypoint"):
        read_detections(path)
    path.write_text("frame,keypoint,x,y,confidence\n0,knee,10,20,0.5\n")
    with pytest.raises(InputError, match=r"as points as CSV.*does not work: KeyError: 'knee'.*tcfit-lab 1\.0"):
        read_detections(path)


def test_its_export_is_written_from_the_command_line(
    lab: None, tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture
):
    write_result(tmp_path / "fit", waving_fit(2.0), sample_clip(), free_body)
    assert main(["export", "--formats", "list"]) == 0
    assert re.search(r"^pelvis +Pelvis \(CSV\): Where it is$", capsys.readouterr().out, re.MULTILINE)
    assert main(["export", str(tmp_path / "fit"), "--formats", "pelvis", "--out", str(tmp_path)]) == 0
    rows = (tmp_path / "walk.pelvis.csv").read_text().splitlines()
    assert len(rows) == 7 and rows[1].startswith("7,")


def test_the_panel_export_has_it_and_hands_it_out(
    lab: None, tmp_path: Path, tiny_body: BodyModel, panel_server: viser.ViserServer
):
    with tiny_page(panel_server, tmp_path / "p", tiny_body, ExportPanel) as tested:
        tested.page.tab.set(folds=frozenset({"export.formats"}))
        assert "Pelvis (CSV)" in tested.html()
        tested.fit()
        tested.press("export.begin", "pelvis")
        tested.settle()
        ((name, content),) = tested.downloads.items()
        assert name.endswith(".pelvis.csv") and content.startswith(b"frame,x,y,z\n")


def test_the_doctor_lists_it(lab: None):
    said = {check.found for check in doctor.check_plugins()}
    assert said == {"tcfit.readers: points-csv, of tcfit-lab 1.0", "tcfit.exports: pelvis, of tcfit-lab 1.0"}


def test_without_plugins_the_doctor_says_so(on_path: pytest.MonkeyPatch):
    assert [check.found for check in doctor.check_plugins()] == ["none"]


# --- broken ones ---

API = "from tcfit_app.plugin_api import *\n"
EXPORT = API + "E = Export(title='T', group='Blender', suffix='.t', hint='', write={})\n"


@pytest.mark.parametrize(
    ("code", "line", "reason"),
    [
        ("import nowhere_at_all", "mine = odd:E", "odd:E cannot be imported.*No module named 'nowhere_at_all'"),
        ("1 / 0", "mine = odd:E", "cannot be imported.*ZeroDivisionError"),
        ("raise SystemExit('no')", "mine = odd:E", "cannot be imported.*SystemExit: no"),
        ("", "mine = odd:E", "cannot be imported.*has no attribute 'E'"),
        ("E = 3", "mine = odd:E", "of the type int; expected Export"),
        (EXPORT.format("print"), "glb = odd:E", "tcfit itself has 'glb'; another name is needed"),
        (EXPORT.format("print"), "My Own = odd:E", "its name is not of small letters"),
        (EXPORT.format("print").replace("Blender", "Music"), "mine = odd:E", "its group is 'Music'; expected one of"),
        (EXPORT.format("print").replace("'.t'", "'../t'"), "mine = odd:E", "its suffix is '../t'"),
        (EXPORT.format("print").replace("'T'", "7"), "mine = odd:E", "its title is of the type int; expected a text"),
    ],
)
def test_an_export_that_cannot_be_used_is_left_out(
    odd, code: str, line: str, reason: str, caplog: pytest.LogCaptureFixture
):
    own = set(exports())
    plugins.forget()
    odd(code, exports=line)
    with caplog.at_level(logging.WARNING):
        assert set(exports()) == own == set(exports())
    (said,) = [record.message for record in caplog.records]
    assert re.search(reason, said) and "odd 0.1" in said and "update the package" in said
    assert [check.status for check in doctor.check_plugins()] == ["warning"]


@pytest.mark.parametrize(("fault", "name"), [("/ 0", "ZeroDivisionError"), ("and exit(7)", "SystemExit: 7")])
def test_an_export_that_fails_while_it_writes(
    odd, fault: str, name: str, tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture
):
    odd(EXPORT.format(f"lambda source, path, progress: path.write_text('half') {fault}"), exports="mine = odd:E")
    write_result(tmp_path / "fit", waving_fit(2.0), sample_clip(), free_body)
    assert main(["export", str(tmp_path / "fit"), "--formats", "mine", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "T cannot be written" in said and name in said and "odd 0.1" in said
    assert not list(tmp_path.glob("*.t"))


def test_an_export_that_closes_the_output_and_goes_elsewhere(
    odd, tmp_path: Path, free_body: BodyModel, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    doing = (
        "def write(source, path, progress):\n    path.write_text('x')\n    os.chdir(os.sep)\n    sys.stdout.close()\n"
    )
    odd("import os, sys\n" + doing + EXPORT.format("write"), exports="mine = odd:E")
    write_result(tmp_path / "fit", waving_fit(2.0), sample_clip(), free_body)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdout", StringIO())
    assert main(["export", "fit", "--formats", "mine", "--out", "new"]) == 1
    assert "a plugin closed standard output" in capsys.readouterr().err
    assert [path.suffix for path in (tmp_path / "new").iterdir()] == [".t"]


def test_what_ends_an_export_passes_through_a_plugin(odd, tmp_path: Path):
    odd(EXPORT.format("lambda source, path, progress: progress(0.5)"), exports="mine = odd:E")

    class Cancelled(Exception):
        pass

    def stop(share: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        exports()["mine"].write(None, tmp_path / "x", stop)  # pyright: ignore[reportArgumentType]
    assert not plugins.faults()


@pytest.mark.parametrize("group", ["findings", "metrics"])
def test_a_plugin_of_a_removed_group_is_named_with_what_replaces_it(odd, group: str, tmp_path: Path):
    odd("raise AssertionError('imported')", **{group: "mine = odd:f"})
    (check,) = doctor.check_plugins()
    assert check.status == "warning" and f"tcfit.{group}: mine: tcfit no longer has {group}" in check.found
    assert "compute them in an export" in check.found
    plugins.forget()
    (tmp_path / "a.txt").write_text("?")
    with pytest.raises(InputError):
        read_detections(tmp_path / "a.txt")
    assert [fault.name for fault in plugins.faults()] == ["mine"], "named by any command that asks for plugins"


def test_reader_that_raises_a_keyboard_interrupt_in_a_child_process_is_named(odd, tmp_path: Path):
    """Fits in the background run in processes that ignore Ctrl-C."""
    reading = "def stop(path):\n    raise KeyboardInterrupt\n"
    reader = "R = KeypointReader(title='T', recognises=lambda path, start: path.suffix == '.s', read=stop)\n"
    (tmp_path / "a.s").write_text("?")
    odd(API + reading + reader, readers="mine = odd:R")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            read_detections(tmp_path / "a.s")
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with pytest.raises(InputError, match=r"cannot be read as T.*'mine'.*KeyboardInterrupt.*odd 0.1"):
            read_detections(tmp_path / "a.s")
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_reader_that_fails_leaves_the_formats_of_tcfit(odd, tmp_path: Path):
    code = API + "R = KeypointReader(title='R', recognises=lambda path, start: exit(7), read=print)\n"
    code += "S = KeypointReader(title='S', recognises=lambda path, start: path.suffix == '.s', read=print)\n"
    odd(code, readers="r = odd:R\ns = odd:S")
    with pytest.raises(InputError, match="is not a readable keypoint format"):
        (tmp_path / "a.txt").write_text("?")
        read_detections(tmp_path / "a.txt")
    (tmp_path / "a.s").write_text("?")
    with pytest.raises(InputError, match=r"cannot be read as S.*it returned NoneType; expected Detections"):
        read_detections(tmp_path / "a.s")


def test_the_panel_review_tells_of_them(odd, tmp_path: Path, tiny_body: BodyModel, panel_server: viser.ViserServer):
    odd("1 / 0", exports="mine = odd:E")
    exports()
    with tiny_page(panel_server, tmp_path / "p", tiny_body, ReviewPanel) as tested:
        assert "odd 0.1" in tested.html() and "ZeroDivisionError" in tested.html()


# --- what stays ---


def test_every_name_is_there():
    for name in plugin_api.__all__:
        assert getattr(plugin_api, name).__name__ == name


def test_the_page_names_them_all():
    text = PAGE.read_text()
    assert not [name for name in plugin_api.__all__ if name not in text]
    assert all(f"`{group}`" in text for group in plugins.GROUPS)


def test_nothing_of_a_plugin_is_imported_before_it_is_asked_for(lab: None):
    assert "tcfit_lab" not in sys.modules
    assert "pelvis" in exports() and "tcfit_lab" in sys.modules
