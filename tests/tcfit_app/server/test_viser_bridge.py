"""The one door to viser: another version is refused in plain words, and nobody goes past the door."""

import ast
import io
from contextlib import redirect_stderr
from pathlib import Path

import pytest
import viser

from fitting_core.errors import InputError
from tcfit_app.cli.main import main
from tcfit_app.server import viser_bridge
from tcfit_app.server.serving import review_server

ROOT = Path(__file__).parents[3]
PRIVATE = {
    *("_websock_server", "_websock_connection", "_websock_interface", "_impl", "_format", "_data", "_gui_api"),
    *("_gui_input_handle_from_uuid", "_container_handle_from_uuid"),
}
"""Attributes of viser's objects that are not its documented API, as far as tcfit has ever used them."""


def test_the_viser_that_is_installed_is_the_one_that_was_tested():
    viser_bridge.check()
    assert viser.__version__ == viser_bridge.TESTED
    assert f'"viser=={viser_bridge.TESTED}"' in (ROOT / "pyproject.toml").read_text()


@pytest.mark.parametrize("version", ["1.2.0", "1.0.9", "1.10.0", "0.2.23"])
def test_another_version_is_refused(version: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viser, "__version__", version)
    with pytest.raises(InputError, match=rf"^tcfit needs viser 1\.1\.x, found {version}\. Install it: pip install"):
        viser_bridge.check()


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(viser_bridge._messages, "SetCameraFovMessage")
    with pytest.raises(InputError, match=r"found 1\.1\.1, which lacks viser\._messages\.SetCameraFovMessage\."):
        viser_bridge.check()


def test_a_server_whose_widgets_cannot_be_found_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viser_bridge, "_NEEDED_OF_GUI", ("_gui_input_handle_from_uuid", "_nothing"))
    with (
        pytest.raises(InputError, match=r"which lacks _nothing\. Install it"),
        review_server("A clip", port=0, open_browser=False, say=lambda text: None),
    ):
        pass


def test_a_review_does_not_start_with_another_version(demo_project: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viser, "__version__", "1.2.0")
    said = io.StringIO()
    with redirect_stderr(said):
        code = main(["review", str(demo_project), "--port", "0", "--no-browser"])
    assert code != 0
    assert "tcfit needs viser 1.1.x, found 1.2.0" in said.getvalue()
    assert "Traceback" not in said.getvalue()


def _past_the_door(tree: ast.AST) -> list[str]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "viser":
            names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
            found += [name for name in names if name.startswith("_") or name == "infra"]
        if isinstance(node, ast.Attribute) and node.attr in PRIVATE:
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            found += [node.attr] if owner != "self" else []
    return found


def test_the_search_finds_who_goes_past_the_door():
    source = "from viser import _messages\nfrom viser.infra import x\nself.node._impl.uuid\nself._data"
    assert sorted(_past_the_door(ast.parse(source))) == ["_impl", "_messages", "infra"]


def test_nobody_else_touches_what_viser_does_not_document():
    files = [path for path in (ROOT / "tcfit_app").rglob("*.py") if path.name != "viser_bridge.py"]
    past = {path.name: found for path in files if (found := _past_the_door(ast.parse(path.read_text())))}
    assert past == {}
