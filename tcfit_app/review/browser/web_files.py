"""The page's modules as files: what a browser may fetch of them, and under which address."""

import hashlib
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).with_name("web")
_LOADER = "load.js"
"""The one that is no module: the server has the page run it."""


@cache
def web_files() -> dict[str, bytes]:
    """The page's modules by the path at which it fetches them, such as "/tcfit/picture/overlay.js"."""
    found = sorted(path for path in _FOLDER.rglob("*.js") if path.name != _LOADER)
    return {f"/tcfit/{path.relative_to(_FOLDER).as_posix()}": path.read_bytes() for path in found}


@cache
def web_version() -> str:
    """Another one for every change of the modules."""
    parts = [part for path, content in web_files().items() for part in (path.encode(), content)]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def loader() -> str:
    """A JavaScript function that loads the modules: of their version and paths, viser's version, and the calls
    to keep."""
    return (_FOLDER / _LOADER).read_text(encoding="utf-8")
