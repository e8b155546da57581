"""TOML of strangers."""

import re
import tomllib
from typing import Any

_DEEPEST = 32
"""Parts of a key. The parser's memory goes with the square: a key of 60 kB took 3.8 GB."""
_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_DEEP = re.compile(f"(?:{_PART}){{{_DEEPEST}}}")


def parsed_toml(text: str) -> dict[str, Any]:
    """The table that a text holds. Raises ValueError if it is not TOML, or nested deeper than anybody writes it."""
    if found := _DEEP.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"line {line} has a key of more than {_DEEPEST} parts with dots between them")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
