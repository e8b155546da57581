"""The page's modules as text: what imports what, and who touches viser's insides."""

import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
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
