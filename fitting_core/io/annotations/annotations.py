"""What is written about stretches of time, in tiers as annotation programs have them."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """A text about a stretch of time."""

    start: int
    """Milliseconds from the beginning of the video."""
    end: int
    """Milliseconds; behind `start`."""
    text: str


@dataclass(frozen=True, kw_only=True)
class Tier:
    """Annotations of one kind, in the order of their time. In files of tcfit they do not overlap."""

    name: str
    kind: str = ""
    """What tiers of one kind have in common: the vocabulary, and whether they have a parent. ELAN: linguistic type."""
    annotations: tuple[Annotation, ...]
    vocabulary: Mapping[str, str] = field(default_factory=dict)
    """The only texts that the tier has, each with what it means; empty: any text."""
    parent: str = ""
    """The name of the tier whose annotations these belong to, one to each of the same time; empty: of none."""
