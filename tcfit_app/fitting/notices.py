"""What the app tells its users once."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Notice:
    """Something that every browser is told once."""

    title: str
    text: str
    kind: Literal["info", "done", "error"] = "info"
