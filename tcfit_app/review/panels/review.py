"""The panel that leads through suspicious frames, and finds a video that was moved."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import viser

from fitting_core.errors import InputError
from fitting_core.video.frame_names import runs
from tcfit_app.analysis.suspicion import Suspect
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.notices import Notice
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.review.panels.elements.html import Board, Html, action, button, heading, line, paragraph, row, table

if TYPE_CHECKING:
    from tcfit_app.review.page import Page

_MOST = 40
"""Entries that are listed; one that is checked makes room for the next."""
_PATIENCE = 0.2
"""Seconds between two questions whether the queue is there."""
_FLAGS = 24
"""Runs of flagged frames that are listed."""


class ReviewPanel:
    """The review queue."""

    title: ClassVar[str] = "Review"
    icon: ClassVar[viser.IconName] = viser.Icon.CHECKLIST

    def __init__(self, page: "Page") -> None:
        self._page = page
        self._suspects: tuple[Suspect, ...] | None = None
        """The last that were found; None until then."""
        self._looking = False
        """Newer ones are being looked for."""
        self._next = 0.0
        """When to ask for them again."""
        self._problem = ""
        self._flagged: list[int] = []
        self._checked: set[int] = set()
        self._media = Board(page)
        self._path = page.client.gui.add_text("New place", "", visible=False, hint="Video file, or folder of images")
        self._relink = Board(page)
        self._head = Board(page)
        self._queue = Board(page)
        page.on_press("review.go", self._go, _entry)
        page.on_press("review.frame", self._visit, int)
        page.on_press("review.relink", lambda _: self._find_video())

    def _go(self, entry: tuple[int, str]) -> None:
        found = [s for s in self._suspects or () if (s.frame, s.kind) == entry]
        if not found:
            raise InputError("This entry is gone from the queue: its frames were checked or fitted again.")
        self._page.reviewing.show(found[0])

    def _visit(self, frame: int) -> None:
        self._page.pause()
        self._page.seek(frame)

    def _find_video(self) -> None:
        page = self._page
        page.refuse_read_only()
        if not self._path.value.strip():
            raise InputError("Type where the video is now: its file, or the folder of its images.")
        path, project = page.files.path(self._path.value), page.session.project
        page.begin("Looking for the video", lambda _: project.relink(path), lambda _: self._found_video())

    def _found_video(self) -> None:
        page = self._page
        page.desk.reopen_video()
        media = page.session.project.media
        if media.problem:
            page.notify(Notice(title="Linked, but look at it", text=media.problem))
        else:
            page.notify(Notice(title="The video is found", text=str(media.path and media.path.resolve()), kind="done"))

    # --- drawing ---

    def draw(self) -> None:
        """Bring it to the page's state."""
        page, session = self._page, self._page.session
        self._draw_media()
        shown = page.corrected_fit()
        self._look(shown)
        if page.changes.of("marks of the queue", session.marked):
            marks = session.project.marks.all()
            self._flagged = [frame for frame, mark in marks.items() if mark.state == "flag"]
            self._checked = {frame for frame, mark in marks.items() if mark.state == "checked"}
        here, where = self._here(), self._applies()
        fine = self._checked.issuperset(page.reviewing.dismissed)
        flagged = set(page.correcting.frames) <= set(self._flagged)
        if page.changes.of("review head", id(self._suspects), self._path.visible, session.marked, where, fine, flagged):
            self._draw_head(where, fine=fine, flagged=flagged)
        if page.changes.of("queue", id(self._suspects), self._looking, self._problem, shown is None, here):
            self._queue.show(*self._entries(here, fitted=shown is not None))

    def _look(self, shown: Shown | None) -> None:
        """Take up the queue if it is another one; the last one stays meanwhile."""
        page = self._page
        key = None if shown is None else page.desk.key(shown)
        changed = page.changes.of("suspects of", key, page.session.marked)
        if not changed and not (self._looking and time.monotonic() > self._next):
            return
        self._next = time.monotonic() + _PATIENCE
        if shown is None:
            self._suspects, self._looking, self._problem = None, False, ""
            return
        found = page.reviewing.suspects
        self._problem = page.desk.suspects_problem(shown) if found is None else ""
        self._looking = found is None and not self._problem
        if not self._looking:
            self._suspects = found

    def _here(self) -> int | None:
        """The place of the entry on show in the queue."""
        frame = self._page.state.frame
        places = [i for i, suspect in enumerate(self._suspects or ()) if frame in suspect.frames]
        exact = [i for i in places if (self._suspects or ())[i].frame == frame]
        return next(iter(exact + places), None)

    def _draw_head(self, where: str, *, fine: bool, flagged: bool) -> None:
        found = [] if self._suspects is None else [f"{len(self._suspects)} left"]
        counts = ", ".join([*found, f"{len(self._flagged)} flagged", f"{len(self._checked)} checked"])
        off = self._page.session.project.read_only
        self._head.show(
            heading("Suspicious frames", counts, first=not self._path.visible),
            row(
                action("previous_suspect", "Previous", disabled=not self._suspects),
                action("next_suspect", "Next", disabled=not self._suspects, kind="main"),
            ),
            row(
                action("fine", "Not fine after all" if fine else "Looks fine", disabled=off),
                action("flag", "Take flag away" if flagged else "Flag", disabled=off),
            ),
            paragraph(where, "dim"),
            *self._flags(self._flagged),
        )

    def _applies(self) -> str:
        """What "Looks fine" and "Flag" are about."""
        page = self._page
        if page.state.playing and page.state.frames is None:  # else it would change with each frame
            return "Both are for the frame on show."
        fine, flag = self._where(page.reviewing.dismissed), self._where(page.correcting.frames)
        return f"Both are for {fine}." if fine == flag else f"Looks fine is for {fine}, Flag for {flag}."

    def _where(self, frames: Sequence[int]) -> str:
        return in_words(frames, self._page.first_frame)

    def _flags(self, frames: list[int]) -> list[Html]:
        if not frames:
            return []
        first = self._page.first_frame
        found = runs(frames)
        buttons = [
            button(numbers(run, first), "review.frame", str(run.start), kind="mini", hint=f"Go to {first + run.start}")
            for run in found[:_FLAGS]
        ]
        more = [paragraph(f"and {len(found) - _FLAGS} more", "dim")] if len(found) > _FLAGS else []
        return [heading("Flagged"), row(*buttons, wrap=True), *more]

    def _entries(self, here: int | None, *, fitted: bool) -> list[Html]:
        if not fitted:
            return [paragraph("There is no fit yet: suspicious frames are looked for once there is one.", "dim")]
        if self._problem:
            return [paragraph(f"Suspicious frames cannot be looked for: {self._problem}", "warn")]
        if self._suspects is None:
            return [paragraph("Looking for suspicious frames …", "dim")]
        if not self._suspects:
            again = " Looking again …" if self._looking else ""
            return [paragraph(f"Nothing suspicious.{again}", "dim")]
        first = self._page.first_frame
        rows = [
            line(
                i + 1,
                numbers(suspect.frames, first),
                suspect.reason,
                numbers=(0, 1),
                kind="here" if i == here else "",
                command="review.go",
                value=f"{suspect.frame} {suspect.kind}",
                hint="; ".join([f"Frame {first + suspect.frame}: {suspect.reason}", *suspect.also]),
            )
            for i, suspect in enumerate(self._suspects[:_MOST])
        ]
        parts = [
            heading("Queue", "the worst first"),
            table(rows, ("", "frame", "what, where it is worst"), numbers=(0, 1)),
        ]
        if (more := len(self._suspects) - _MOST) > 0:
            parts.append(paragraph(f"and {more} more, less suspicious", "dim"))
        if self._looking:
            parts.append(paragraph("Looking again …", "dim"))
        return parts

    def _draw_media(self) -> None:
        page = self._page
        problem = page.session.project.media.problem or page.desk.video.problem_of(page.state.frame)
        if not page.changes.of("media problem", problem):
            return
        self._path.visible = bool(problem)
        if not problem:
            self._media.show()
            self._relink.show()
            return
        self._media.show(heading("Video", first=True), paragraph(problem, "warn"))
        off = page.session.project.read_only
        self._relink.show(row(button("Use the video at this place", "review.relink", disabled=off, enter=True)))


def _entry(value: str) -> tuple[int, str]:
    """Frame and kind of an entry of the queue."""
    frame, kind = value.split(" ")
    return int(frame), kind
