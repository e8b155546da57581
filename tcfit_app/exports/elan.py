"""A project for ELAN: an .eaf file with notes and marks of frames, and what the hands of a fit do."""

from collections.abc import Sequence
from pathlib import Path

from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.io.eaf import Annotation, Tier, milliseconds_of, write_eaf
from fitting_core.measure.hands.handshapes import HandshapeSet, read_handshapes
from fitting_core.measure.hands.phases import spans_of
from fitting_core.motion import Progress
from tcfit_app.analysis.hand_tiers import annotations, hand_tiers
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.exports.source import ExportSource
from tcfit_app.imports.elan import FLAGS, NOTES, REVIEW
from tcfit_app.project.edits.remarks import Note
from tcfit_app.project.project import Project

_HANDSHAPES = "handshapes.toml"
"""In the project's folder: the user's own set, if any."""
_STATES = {
    "flag": ("flagged", "Needs attention"),
    "checked": ("looks fine", "A reviewer has looked at it"),
    None: ("not reviewed", "Without a mark"),
}
"""Names and meanings of the marks of frames."""


def write_elan(source: ExportSource, path: Path, progress: Progress) -> None:
    """Notes, flags and the state of review as they are now, and the hands of the chosen fit. Raises InputError if there
    is no fit yet, or the project's own set of handshapes cannot be read."""
    posed = source.fit.posed(source.clip)
    with Project.open(source.folder, read_only=True) as project:
        said = _said(posed, project)
    progress(0.2)
    file = source.folder / _HANDSHAPES
    shapes = HandshapeSet(posed.meshes.body, read_handshapes(file) if file.exists() else HANDSHAPES)
    hands = hand_tiers(posed, shapes)
    progress(0.9)
    video = source.clip.source
    media = video if video is not None and video.is_file() else None
    write_eaf(path, [*said, *hands], media=media)


def _said(posed: PosedFit, project: Project) -> list[Tier]:
    """Notes and marks of the frames of a fit, which may be a part of the project's."""
    clip, shift = posed.clip, posed.clip.first_frame - project.clip.first_frame
    marks = project.marks.states()
    states = [marks.get(shift + t) for t in range(len(clip))]
    words = dict(_STATES.values())
    flagged, _ = _STATES["flag"]
    review = spans_of([_STATES[state][0] for state in states])
    flags = [span for span in review if span.label == flagged]
    return [
        *_notes(project.notes, posed, project.clip.first_frame),
        Tier(name=FLAGS, kind="flag", annotations=annotations(posed, flags), vocabulary={flagged: words[flagged]}),
        Tier(name=REVIEW, kind="review", annotations=annotations(posed, review), vocabulary=words),
    ]


def _notes(notes: Sequence[Note], posed: PosedFit, first: int) -> list[Tier]:
    """As few tiers as there are notes on one frame, at least one: annotations of a tier must not overlap."""
    clip, tiers = posed.clip, [list[Annotation]()]
    shown = range(clip.first_frame, clip.first_frame + len(clip))
    for note in notes:
        frames = range(max(first + note.frames.start, shown.start), min(first + note.frames.stop, shown.stop))
        if not frames:
            continue
        start, end = milliseconds_of(frames, clip.frame_rate)
        free = next((tier for tier in tiers if not tier or tier[-1].end <= start), None)
        if free is None:
            free = []
            tiers.append(free)
        free.append(Annotation(start=start, end=end, text=note.text))
    names = [NOTES, *(f"{NOTES} {n}" for n in range(2, len(tiers) + 1))]
    return [Tier(name=name, kind="note", annotations=tuple(t)) for name, t in zip(names, tiers, strict=True)]
