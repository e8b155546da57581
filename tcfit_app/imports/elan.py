"""Imports annotations of an .eaf file as notes on the frames of a project."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError, some_of
from fitting_core.io.eaf import Tier, frames_of, read_eaf
from fitting_core.keypoints import SIDES
from tcfit_app.analysis.hand_tiers import names_of
from tcfit_app.project.edits.remarks import NOTE_CHARACTERS, Note, NoteText, WriteNotes
from tcfit_app.project.project import Project

NOTES, FLAGS, REVIEW = "Notes", "Flags", "Review"
"""Tiers written by tcfit besides those of the hands; overlapping notes continue on Notes 2 and so on."""
OWN = frozenset((FLAGS, REVIEW, *(name for side in SIDES for name in names_of(side))))
"""Tiers that tcfit derives from other data: they do not become notes."""
_MOST = 20_000
"""Annotations of one import: two for each second of three hours. Many more hold up everybody's timeline."""
_NOTES_TIER = re.compile(rf"{NOTES}( \d+)?")


@dataclass(frozen=True, kw_only=True)
class ElanNotes:
    """The result of an import of notes, or its preview."""

    new: int
    changed: int
    """Notes whose text changes."""
    known: int
    """Annotations that already exist as notes."""
    outside: int
    """Annotations before the clip's first frame or after its last."""
    tiers: tuple[str, ...]
    """The tiers read."""

    def in_words(self) -> str:
        """For users."""
        parts = [f"{self.new} new notes"]
        parts += [f"{self.changed} with changed text"] if self.changed else []
        parts += [f"{self.known} already present"] if self.known else []
        parts += [f"{self.outside} outside of the clip ignored"] if self.outside else []
        return f"{', '.join(parts)} (tiers: {', '.join(self.tiers)})"


def import_notes(project: Project, path: Path, tiers: Sequence[str] = (), *, author: str = "") -> ElanNotes:
    """Store annotations as notes; a single undo removes them all. Raises InputError if it cannot be read, has no such
    tier or no annotations, one is too long, or the project cannot be written; nothing is stored then.

    An annotation on frames that already have a note with this text is skipped. If tcfit wrote the file, an annotation
    in one of its tiers of notes replaces the text of the note on the same frames, if there is exactly one.

    Args:
        project: Open for writing.
        path: The .eaf file; its times are those of the project's video.
        tiers: Names; empty: all except those that tcfit derives from other data.
        author: Who imports.
    """
    action, counted = notes_of(path, project, tiers)
    if action is not None:
        project.append(action, author=author)
    return counted


def notes_of(path: Path, project: Project, tiers: Sequence[str] = ()) -> tuple[WriteNotes | None, ElanNotes]:
    """The preview of `import_notes`; None if there is nothing to store. Raises InputError as it does."""
    source = project.clip.source
    found = read_eaf(path, "" if source is None else source.name)
    chosen = _chosen(found, tiers, path)
    if (count := sum(len(tier.annotations) for tier in chosen)) > _MOST:
        raise InputError(f"{path}: has {count:,} annotations; expected {_MOST:,} at most at a time. Choose tiers.")
    exported = any(tier.name in OWN for tier in found)
    clip, there = project.clip, list(project.notes)
    texts = {(note.frames, note.text) for note in there}
    wanted: list[NoteText] = []
    known = outside = changed = 0
    for tier in chosen:
        for annotation in tier.annotations:
            text = annotation.text.strip()
            frames = frames_of(annotation.start, annotation.end, clip.frame_rate)
            inside = range(max(frames.start - clip.first_frame, 0), min(frames.stop - clip.first_frame, len(clip)))
            if not text or not inside:
                outside += bool(text)
                continue
            if (inside, text) in texts:
                known += 1
                continue
            if len(text) > NOTE_CHARACTERS:
                raise InputError(
                    f"{path}: an annotation of the tier {tier.name} has {len(text):,} characters; expected "
                    f"{NOTE_CHARACTERS:,} at most for notes. Leave the tier out, or shorten it in ELAN."
                )
            own = exported and _NOTES_TIER.fullmatch(tier.name)
            replaces = _replaced(there, inside) if own else None
            if replaces is not None:
                there = [note for note in there if note.id != replaces]
                changed += 1
            texts.add((inside, text))
            wanted.append(NoteText(first=inside.start, last=inside.stop - 1, text=text, replaces=replaces))
    names = tuple(tier.name for tier in chosen)
    counted = ElanNotes(new=len(wanted) - changed, changed=changed, known=known, outside=outside, tiers=names)
    if not (wanted or known):
        raise InputError(f"{path}: has no annotations in this clip's frames (tiers: {some_of(names)}).")
    return (WriteNotes(notes=tuple(wanted)) if wanted else None), counted


def _chosen(found: Sequence[Tier], wished: Sequence[str], path: Path) -> list[Tier]:
    by_name = {tier.name: tier for tier in found}
    if unknown := [name for name in wished if name not in by_name]:
        raise InputError(f"{path}: has no tier {unknown[0]!r}; expected some of {some_of(by_name)}.")
    return [by_name[name] for name in wished] if wished else [tier for tier in found if tier.name not in OWN]


def _replaced(there: Sequence[Note], frames: range) -> int | None:
    found = [note.id for note in there if note.frames == frames]
    return found[0] if len(found) == 1 else None
