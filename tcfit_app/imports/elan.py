"""Notes from ELAN: annotations of an .eaf file as notes on the frames of a project."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting_core.errors import InputError, some_of
from fitting_core.io.annotations.annotations import Tier
from fitting_core.io.annotations.eaf import read_eaf
from fitting_core.io.annotations.frame_times import frames_of
from fitting_core.measure.hands.phases import SIDES
from tcfit_app.analysis.hand_tiers import names_of
from tcfit_app.project.edits.edit_log import NOTE_CHARACTERS, Note, NoteText, WriteNotes
from tcfit_app.project.project import Project

NOTES, FLAGS, REVIEW = "Notes", "Flags", "Review"
"""Tiers that tcfit writes besides those of the hands; notes that overlap go on to Notes 2 and so on."""
OWN = frozenset((FLAGS, REVIEW, *(name for side in SIDES for name in names_of(side))))
"""Tiers that tcfit writes from what it has anyway: they become no notes."""
_NOTES_TIER = re.compile(rf"{NOTES}( \d+)?")


@dataclass(frozen=True, kw_only=True)
class ElanNotes:
    """What an import of notes has done, or would do."""

    new: int
    changed: int
    """Notes that have another text now."""
    known: int
    """Annotations that are notes already."""
    outside: int
    """Annotations before the clip's first frame or after its last."""
    tiers: tuple[str, ...]
    """Those that were read."""

    def in_words(self) -> str:
        """For the user."""
        parts = [f"{self.new} new notes"]
        parts += [f"{self.changed} with another text"] if self.changed else []
        parts += [f"{self.known} here already"] if self.known else []
        parts += [f"{self.outside} left out, which are outside of the clip"] if self.outside else []
        return f"{', '.join(parts)} (tiers: {', '.join(self.tiers)})"


def import_notes(project: Project, path: Path, tiers: Sequence[str] = (), *, author: str = "") -> ElanNotes:
    """Keep annotations as notes; one undo takes all of them back.

    An annotation on frames that have a note with this text already is not kept again. If tcfit wrote the file, one of
    its tiers of notes gives its text to the note on the same frames, if there is one alone.

    Args:
        project: Open for writing.
        path: The .eaf file; its times are those of the project's video.
        tiers: Names; empty: all but those that tcfit writes from what it has anyway.
        author: Who imports.

    Raises:
        InputError: It cannot be read, has no such tier or no annotations, one is too long, or the project cannot be
            written; nothing is kept then.
    """
    action, told = notes_of(path, project, tiers)
    if action is not None:
        project.append(action, author=author)
    return told


def notes_of(path: Path, project: Project, tiers: Sequence[str] = ()) -> tuple[WriteNotes | None, ElanNotes]:
    """What `import_notes` would do; None if there is nothing to be kept. Raises InputError as it does."""
    source = project.clip.source
    found = read_eaf(path, "" if source is None else source.name)
    chosen = _chosen(found, tiers, path)
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
                    f"{NOTE_CHARACTERS:,} at most, as of notes. Leave the tier out, or shorten it in ELAN."
                )
            own = exported and _NOTES_TIER.fullmatch(tier.name)
            replaces = _replaced(there, inside) if own else None
            there = [note for note in there if note.id != replaces]
            changed += replaces is not None
            texts.add((inside, text))
            wanted.append(NoteText(first=inside.start, last=inside.stop - 1, text=text, replaces=replaces))
    names = tuple(tier.name for tier in chosen)
    told = ElanNotes(new=len(wanted) - changed, changed=changed, known=known, outside=outside, tiers=names)
    if not (wanted or known):
        raise InputError(f"{path}: has no annotations in this clip's frames (tiers: {some_of(names)}).")
    return (WriteNotes(notes=tuple(wanted)) if wanted else None), told


def _chosen(found: Sequence[Tier], wished: Sequence[str], path: Path) -> list[Tier]:
    by_name = {tier.name: tier for tier in found}
    if unknown := [name for name in wished if name not in by_name]:
        raise InputError(f"{path}: has no tier {unknown[0]!r}; expected some of {some_of(by_name)}.")
    return [by_name[name] for name in wished] if wished else [tier for tier in found if tier.name not in OWN]


def _replaced(there: Sequence[Note], frames: range) -> int | None:
    """The one note on these frames."""
    found = [note.id for note in there if note.frames == frames]
    return found[0] if len(found) == 1 else None
