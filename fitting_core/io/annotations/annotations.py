"""Texts about stretches of time, in tiers as annotation programs have them."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Annotation:
    """A text about a stretch of time."""

    start: int
    """Milliseconds from the beginning of the video."""
    end: int
    """Milliseconds; after `start`."""
    text: str


@dataclass(frozen=True, kw_only=True)
class Tier:
    """Annotations of one kind, ordered by time. In files of tcfit they do not overlap."""

    name: str
    kind: str = ""
    """What tiers of one kind share: the vocabulary, and whether they have a parent. ELAN: linguistic type."""
    annotations: tuple[Annotation, ...]
    vocabulary: Mapping[str, str] = field(default_factory=dict)
    """The only texts that the tier may have, each with its meaning; empty: any text."""
    parent: str = ""
    """Name of the parent tier, with one annotation for each of these at the same time; empty: no parent."""
