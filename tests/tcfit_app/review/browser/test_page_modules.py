"""The page's modules: what imports what, who touches viser's insides, and what the pure ones work out in Node."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from posixpath import dirname, join, normpath

import pytest

from tcfit_app.review.browser.channel import web_files

SOURCES = {path: content.decode() for path, content in web_files().items()}
IMPORT = re.compile(r"""^import\s(?:[^;]*?from\s)?"([^"]+)";$|[^@]\bimport\("([^"]+)"\)""", re.MULTILINE)
INSIDES = re.compile(
    "__viser|__r3f|messageQueue|drainMessageQueue|getRenderRequest|requestRender|nodeRefFromName|sendMessage|"
    "syncCanvasSize|cameraControl|projectionMatrix|matrixWorld|onAfterRender|onBeforeRender|SceneNode|Gui[A-Z]|"
    r"RunJavascript|mantine|uplot|\.geometry\b|\.material\b|\.userData\b"
)
"""viser's references and functions, its messages, three.js' objects and its elements' classes."""
DOOR = "/tcfit/viser/"


def imports(path: str) -> Iterator[str]:
    for static, dynamic in IMPORT.findall(SOURCES[path]):
        yield normpath(join(dirname(path), static or dynamic))


def code(source: str) -> str:
    """Without comments."""
    return re.sub(r"/\*.*?\*/|(?<!:)//[^\n]*", "", source, flags=re.DOTALL)


def test_the_reader_of_imports_finds_them():
    assert set(imports("/tcfit/main.js")) == {"/tcfit/viser/bridge.js", "/tcfit/page.js"}
    assert set(imports("/tcfit/picture/picking.js")) == {
        "/tcfit/connection.js",
        "/tcfit/menu.js",
        "/tcfit/viser/bridge.js",
        "/tcfit/picture/projection.js",
        "/tcfit/picture/skeleton.js",
    }
    assert "/tcfit/picture/dragging.js" in imports("/tcfit/page.js")


STARTS = ("/tcfit/main.js", "/tcfit/home/list.js")
"""The first modules of viser's page and of the list's."""


def test_every_import_is_there_and_every_module_is_reached():
    reached, waiting = set(), [*STARTS]
    while waiting:
        path = waiting.pop()
        assert path in SOURCES, path
        if path not in reached:
            reached.add(path)
            waiting.extend(imports(path))
    assert reached == set(SOURCES)


def test_no_modules_import_each_other_in_a_circle():
    order = list(TopologicalSorter({path: set(imports(path)) for path in SOURCES}).static_order())
    assert not {path for path in order if any(start in imports(path) for start in STARTS)}
    assert set(STARTS) <= set(order)


@pytest.mark.parametrize("path", [path for path in SOURCES if not path.startswith(DOOR)])
def test_only_the_bridge_touches_the_insides_of_viser(path: str):
    assert INSIDES.findall(code(SOURCES[path])) == []


def test_the_insides_are_known():
    touched = {word for path in SOURCES if path.startswith(DOOR) for word in INSIDES.findall(code(SOURCES[path]))}
    assert {"__viser", "messageQueue", "requestRender", "sendMessage", "mantine", ".material"} <= touched
    window = [path for path in SOURCES if "__viser" in code(SOURCES[path])]
    assert window == ["/tcfit/viser/bridge.js"]


TESTS = Path(__file__).with_name("scripts")
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="Node is not installed: the page's scripts are tested in browsers only")
@pytest.mark.parametrize("tested", sorted(TESTS.glob("*.test.js")), ids=lambda path: path.name)
def test_scripts(tested: Path, tmp_path: Path) -> None:
    for path, content in web_files().items():
        file = tmp_path / path.removeprefix("/tcfit/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    shutil.copytree(TESTS / "stubs", tmp_path, dirs_exist_ok=True)
    shutil.copy(tested, tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    assert NODE is not None
    done = subprocess.run([NODE, "--test", tested.name], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "# fail 0" in done.stdout and "# pass 0" not in done.stdout
