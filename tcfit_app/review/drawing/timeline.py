"""The timeline of one tab: its rows, marks, the running fit, selected frames and the cursor."""

import textwrap
from collections.abc import Iterable

import numpy as np

from fitting_core.io.people_file import Span
from fitting_core.results.provenance import Provenance
from tcfit_app.analysis.body_regions import full_name
from tcfit_app.analysis.suspicion import Suspect
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.edits.remarks import Note
from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.page_states import FitSpan, spans
from tcfit_app.review.drawing.rows import CHOICES, Rows, with_plot
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.tab.on_show import SLOTS

_MIXED_UP = 3.0
"""Score of frames in which a person may be someone else: like the worst findings."""
_NOTE_CHARACTERS = 160
"""Characters of a note shown in a tooltip."""


class Timeline:
    """Draws one tab's timeline; called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._reviewing = gestures.tab, gestures.reviewing
        self._rows = Rows(gestures.tab)

    def plot(self, name: str, *, shown: bool) -> None:
        """Add or remove a row of PLOTS. Raises InputError if there are too many."""
        self._tab.set(plots=with_plot(self._tab.state.plots, name, shown=shown))

    def draw(self) -> None:
        """Send what changed."""
        frames = self._tab.state.frames
        chosen = None if frames is None else states.ChosenRange(first=frames[0], last=frames[-1])
        self._tab.channel.send("range", chosen)
        self._draw_strip()
        self._rows.draw()
        self._draw_marks()
        self._draw_keyframes()
        self._draw_suspicions()
        self._draw_provenance()
        self._draw_fit()

    def _draw_strip(self) -> None:
        tab, clip = self._tab, self._tab.session.project.footage
        strip = states.Timeline(
            length=tab.length, frame_rate=clip.frame_rate, first_frame=clip.first_frame, choices=CHOICES
        )
        tab.channel.send("timeline", strip)

    def _draw_marks(self) -> None:
        project = self._tab.session.project
        key = project.keypoints_version, project.marks_version
        self._tab.channel.send("marks", self._tab.once("marks", key, self._marks))

    def _marks(self) -> states.Marks:
        project, marks = self._tab.session.project, self._tab.session.project.marks.states()
        by_state = {state: [f for f, mark in marks.items() if mark == state] for state in ("flag", "checked")}
        return states.Marks(
            edited=spans(project.marked("touched")),
            bad=spans(project.marked("bad")),
            flagged=spans(by_state["flag"]),
            checked=spans(by_state["checked"]),
            notes=tuple(map(written, project.notes)),
        )

    def _draw_keyframes(self) -> None:
        key = self._tab.session.project.keypoints_version, self._tab.state.selection
        self._tab.channel.send("keyframes", self._tab.once("keyframes", key, self._keyframes))

    def _keyframes(self) -> states.Keyframes:
        project, joints = self._tab.session.project, self._tab.state.selection
        frames = np.array(project.marked("key"), int)
        key = project.corrected.key[frames]
        chosen = (key[:, list(joints)] if joints else key).any(1)
        return keyframes(frames[chosen], joints)

    def _draw_suspicions(self) -> None:
        tab, queue, looking = self._tab, self._reviewing.queue, self._reviewing.looking
        suspects, uncertain = () if queue is None else queue.left, tab.someone.uncertain

        def made() -> states.Suspicions:
            mixed = (_mixed_up(span, tab.first_frame, tab.length) for span in uncertain)
            found = [*map(_suspicion, suspects), *(one for one in mixed if one)]
            in_order = sorted(found, key=lambda one: (one.first, one.frame))
            return states.Suspicions(found=tuple(in_order), looking=looking)

        tab.channel.send("suspicions", tab.once("suspicions", (suspects, uncertain, looking), made))

    def _draw_provenance(self) -> None:
        tab = self._tab
        fits = {fit.version: (tab.shown.title(side), fit) for side in SLOTS if (fit := tab.shown.fit(side)) is not None}
        known = {(title, key): f.result.provenance for key, (title, f) in fits.items() if f.result is not None}
        found = tab.once(
            "provenance",
            tuple(known),
            lambda: tuple(origins(title, own) for (title, _), own in known.items() if own is not None),
        )
        tab.channel.send("provenance", states.Provenance(fits=found) if found else None)

    def _draw_fit(self) -> None:
        tab = self._tab
        people = tab.session.source.people if tab.session.source.busy else None
        jobs = tab.session.jobs.values()
        found = tuple(span for job in jobs if job.started for span in fit_spans(job, self._frames_of(job)))
        if people is not None:
            found = tuple(FitSpan(first=done[0], last=done[-1], state="found") for done in people.done)
        tab.channel.send("fit", states.Fit(spans=found) if found else None)

    def _frames_of(self, job: RunningJob) -> range:
        run = self._tab.session.fits.run(job.run) if job.run is not None else None
        return run.frames if run is not None and run.frames else range(self._tab.length)


def _mixed_up(span: Span, first_frame: int, length: int) -> states.Suspicion | None:
    """Frames in which this may be someone else, for the timeline; None if they are outside the clip."""
    first, last = max(span[0] - first_frame, 0), min(span[1] - first_frame, length - 1)
    if first > last:
        return None
    reason = "may be someone else from here on: see Who is who in the panel Review"
    return states.Suspicion(first=first, last=last, frame=first, key="", score=_MIXED_UP, reason=reason)


def origins(label: str, provenance: Provenance) -> states.Origins:
    """Where the frames of a fit came from."""
    texts, which = provenance.sentences()
    return states.Origins(label=label, texts=texts, which=tuple(which.tolist()))


def written(note: Note) -> states.WrittenNote:
    """A note for the timeline."""
    text = textwrap.shorten(note.text, _NOTE_CHARACTERS, placeholder=" …")
    return states.WrittenNote(first=note.frames[0], last=note.frames[-1], text=text)


def keyframes(frames: Iterable[int], joints: tuple[int, ...]) -> states.Keyframes:
    """Frames with keyframes of some keypoints, or of any."""
    subject = "a keypoint" if not joints else f"one of {len(joints)} selected keypoints"
    if len(joints) == 1:
        subject = full_name(joints[0])
    return states.Keyframes(frames=tuple(int(frame) for frame in frames), subject=subject)


def _suspicion(suspect: Suspect) -> states.Suspicion:
    """An entry of the review queue for the timeline."""
    return states.Suspicion(
        first=suspect.frames[0],
        last=suspect.frames[-1],
        frame=suspect.frame,
        key=suspect.key,
        score=round(suspect.score, 2),
        reason=suspect.reason,
    )


def fit_spans(job: RunningJob, frames: range) -> list[FitSpan]:
    """The progress of a job in each of its frames."""
    if job.phase == 2:
        return [FitSpan(first=frames[0], last=frames[-1], state="phase1")]
    now, rest = ("done", "phase2") if job.phase == 3 else ("phase1", "fitting")
    done = [FitSpan(first=w.start, last=w.stop - 1, state=now) for w in job.windows]
    start = max((w.stop for w in job.windows), default=frames.start)
    return [*done, FitSpan(first=start, last=frames[-1], state=rest)] if start < frames.stop else done
