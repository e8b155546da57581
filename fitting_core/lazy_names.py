"""Names of a package, each imported when it is first used (PEP 562): only what is asked for is loaded."""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(module: str, file: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a module that offers what it imports under `if TYPE_CHECKING`.

    That block is the table of the names: type checkers and editors follow it as it is, and this reads it off the file.

    Args:
        module: `__name__` of the module.
        file: Its `__file__`.
    """
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: node.module or "" for node in imports for alias in node.names}

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        return getattr(import_module(homes[name]), name)

    return sorted(homes), get, lambda: sorted({*vars(sys.modules[module]), *homes})
