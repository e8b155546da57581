"""The Review panel: leads through suspicious frames, and relinks a video that was moved."""

from functools import partial
from pathlib import Path
from typing import ClassVar

import viser

from fitting_core.errors import InputError
from fitting_core.plugins import faults
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.project.storage.media import RELINK
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.reviewing import kinds_of
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    choices,
    heading,
    line,
    opener,
    paragraph,
    progress_bar,
    row,
    table,
)
from tcfit_app.review.panels.elements.selected_frames import unseen
from tcfit_app.review.panels.notes import Notes
from tcfit_app.review.panels.who_is_who import WhoIsWho

_MOST = 40
"""Entries listed; a checked one makes room for the next."""
KIND_WORDS = {
    "failed": "Failed",
    "swap": "Swapped",
    "reprojection": "Off",
    "steady": "Off for a while",
    "jump": "Jumps",
    "detection": "Detection jumps",
    "depth": "Depth",
    "frozen": "Frozen",
    "confidence": "Lost",
}
"""Kinds of findings, as users read them."""
_FEW = 5
"""Number of entries that need no filters."""
_CLIPS = {"next_clip": "Next clip", "previous_clip": "Previous clip", "list": "All clips"}
"""What their buttons say."""


class ReviewPanel:
    """The review queue."""

    title: ClassVar[str] = "Review"
    icon: ClassVar[viser.IconName] = viser.Icon.CHECKLIST

    def __init__(self, gestures: Gestures) -> None:
        self._gestures = gestures
        self._tab = tab = gestures.tab
        self._found: ReviewQueue | None = None
        self._looking = False
        """A newer queue is being computed."""
        self._problem = ""
        self._flagged: list[int] = []
        self._damage = Board(tab)
        self._media = Board(tab)
        self._relink = FileInput(
            tab,
            "review.relink",
            self._find_video,
            path=TextRow("New location", "Video file, or folder of images"),
            button="Relink the video",
            missing="Type the video's new location: its file, or the folder of its images.",
        )
        self._head = Board(tab)
        self._who_is_who = WhoIsWho(gestures)
        self._queue = Board(tab)
        self._notes = Notes(gestures)

    @property
    def _suspects(self) -> tuple[Suspect, ...]:
        """Those listed."""
        return () if self._found is None else self._gestures.reviewing.listed(self._found.left)

    def _entry(self, key: str) -> Suspect:
        found = [] if self._found is None else [s for s in self._found.left if s.key == key]
        if not found:
            raise InputError("This entry is no longer in the queue: its frames were checked or refitted.")
        return found[0]

    def _go(self, entry: str) -> None:
        self._gestures.reviewing.show(self._entry(entry))

    def _find_video(self, path: Path | viser.UploadedFile) -> None:
        assert isinstance(path, Path)
        relink = partial(self._tab.session.project.relink, path)
        self._relink.read("Looking for the video", lambda _: relink(), lambda _: self._found_video(), writes=True)

    def _found_video(self) -> None:
        session = self._tab.session
        media = session.project.media
        if media.problem:
            session.tell(Notice(title="Video linked, but it differs from the original", text=media.problem))
        else:
            session.tell(Notice(title="Video found", text=str(media.path and media.path.resolve()), kind="done"))

    # --- drawing ---

    def draw(self) -> None:
        """Update from the tab's state."""
        tab, session = self._tab, self._tab.session
        self._draw_damage()
        self._draw_media()
        shown = tab.shown.b
        self._look(shown)
        self._flagged = tab.once("flags", session.project.marks_version, self._flagged_frames)
        where = self._applies()
        self._draw_head(where, fine=self._gestures.reviewing.fine, flagged=set(tab.chosen_frames) <= set(self._flagged))
        self._who_is_who.draw()
        self._queue.show(*self._entries(self._here(), fitted=shown is not None))
        self._notes.draw()

    def _flagged_frames(self) -> list[int]:
        marks = self._tab.session.project.marks.all()
        return [frame for frame, mark in marks.items() if mark.state == "flag"]

    def _look(self, shown: Shown | None) -> None:
        data = self._tab.data
        self._found = self._gestures.reviewing.queue
        self._problem = "" if shown is None or self._found is not None else data.problem("suspects", shown)
        lags = self._tab.session.edit_follower.lags
        self._looking = shown is not None and not self._problem and (lags or data.queue(shown) is None)

    def _here(self) -> int | None:
        """The position in the queue of the entry on show."""
        frame = self._tab.state.frame
        places = [i for i, suspect in enumerate(self._suspects) if frame in suspect.frames]
        exact = [i for i in places if self._suspects[i].frame == frame]
        return next(iter(exact + places), None)

    def _draw_head(self, where: str, *, fine: bool, flagged: bool) -> None:
        found, bar = self._found, []
        if found is not None and (total := found.looked_at + len(found.left)):
            bar = [
                progress_bar(found.looked_at / total),
                paragraph(f"{found.looked_at} of {total} reviewed; flagged frames: {len(self._flagged)}", "dim"),
            ]
        self._head.show(
            heading("Suspicious frames", first=not self._video_problem),
            *bar,
            row(
                action(self._gestures, "previous_suspect", "Previous"),
                action(self._gestures, "next_suspect", "Next", kind="main"),
            ),
            row(
                action(self._gestures, "fine", 'Undo "looks fine"' if fine else "Looks fine"),
                action(self._gestures, "flag", "Remove flag" if flagged else "Flag"),
            ),
            paragraph(where, "dim"),
            row(action(self._gestures, "approve", self._approval()), *self._clips("next_clip")),
            *([row(*others)] if (others := self._clips("previous_clip", "list")) else []),
            *unseen(self._tab),
        )

    def _approval(self) -> str:
        by = self._gestures.reviewing.approved
        return f"Approved by {by}" if by else "Approve the clip"

    def _clips(self, *names: str) -> list[Html]:
        """Buttons that lead to other clips, if the clip was opened from a list."""
        return [action(self._gestures, name, _CLIPS[name]) for name in names if self._tab.in_list]

    def _applies(self) -> str:
        """Which frames "Looks fine" and "Flag" apply to."""
        tab = self._tab
        if tab.state.playing and tab.state.frames is None:  # otherwise it would change with each frame
            return "Both apply to the frame on show."
        reviewing, flag = self._gestures.reviewing, in_words(tab.chosen_frames, tab.first_frame)
        if reviewing.on_show is None:
            return f"Both apply to {flag}."
        return f"O marks {reviewing.subject(reviewing.on_show)} as fine, T flags {flag}."

    def _entries(self, here: int | None, *, fitted: bool) -> list[Html]:
        if not fitted:
            return [paragraph("There is no fit yet. Suspicious frames are found once there is one.", "dim")]
        if self._problem:
            return [paragraph(f"Suspicious frames cannot be found: {self._problem}", "warn")]
        if self._found is None:
            return [paragraph("Looking for suspicious frames …", "dim")]
        if not self._found.left:
            done = f"All {self._found.looked_at} reviewed" if self._found.looked_at else "Nothing suspicious"
            return [paragraph(f"{done}. Looking again …" if self._looking else f"{done}.", "dim")]
        first, rows = self._tab.first_frame, []
        for i, suspect in enumerate(self._suspects[:_MOST]):
            go = opener(numbers(suspect.frames, first), "review.go", suspect.key, partial(self._go, suspect.key))
            rows.append(
                line(
                    go,
                    suspect.reason,
                    numbers=(0,),
                    kind="here" if i == here else "",
                    press=go,
                    hint="; ".join([f"Frame {first + suspect.frame}: {suspect.reason}", *suspect.also]),
                )
            )
        parts = [heading("Queue", f"{len(self._suspects)} listed"), *self._filters()]
        if rows:
            parts.append(table(rows, ("frames", "problem in the worst frame"), numbers=(0,)))
        else:
            parts.append(paragraph("No entries match this filter.", "dim"))
        if (more := len(self._suspects) - _MOST) > 0:
            parts.append(paragraph(f"and {more} more", "dim"))
        if self._looking:
            parts.append(paragraph("Looking again …", "dim"))
        return parts

    def _filters(self) -> list[Html]:
        """Which kind of entry is listed, and the button for all of them."""
        tab, found = self._tab, self._found.left if self._found is not None else ()
        kind = tab.state.queue_kind
        if len(found) <= _FEW and not kind:
            return []
        counts = kinds_of(found)
        labels = {"": "All"} | {
            each: f"{KIND_WORDS.get(each, each.capitalize())} {counts[each]}"
            for each in (*counts, *filter(None, (kind,)))
        }
        kinds = choices(
            "review.kind", labels, lambda each: tab.set(queue_kind=each), lambda each: each == kind, kind="mini"
        )
        return [
            row(*kinds, wrap=True),
            row(action(self._gestures, "all_fine", f"All {len(self._suspects)} look fine")),
        ]

    def _draw_damage(self) -> None:
        damage, plugins = self._tab.session.project.damage, tuple(fault.text for fault in faults())
        listed = [paragraph(text, "warn") for text in damage[:_MOST]]
        more = [paragraph(f"and {len(damage) - _MOST} more", "dim")] if len(damage) > _MOST else []
        shown = [heading("Damaged project data", first=True), *listed, *more] if damage else []
        left_out = [paragraph(text, "warn") for text in plugins[:_MOST]]
        if left_out:
            shown += [heading("Plugins", first=not damage), *left_out]
        self._damage.show(*shown)

    def _draw_media(self) -> None:
        problem = self._video_problem
        words = problem.replace(RELINK, "Type its new location.")
        self._media.show(*([heading("Video", first=True), paragraph(words, "warn")] if problem else []))
        self._relink.draw(on=bool(problem))

    @property
    def _video_problem(self) -> str:
        tab = self._tab
        return tab.session.project.media.problem or tab.data.video.problem_of(tab.first_frame + tab.state.frame)
