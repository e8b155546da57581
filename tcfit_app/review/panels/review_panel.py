"""The Review panel: leads through suspicious places, and relinks a video that was moved."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

import viser

from fitting_core.plugins import faults
from tcfit_app.analysis.suspicion import ReviewQueue, Suspect
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.media import RELINK
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.edit_words import capitalized
from tcfit_app.review.gestures.reviewing import kinds_of
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    Item,
    action,
    action_item,
    button,
    card,
    heading,
    menu_button,
    paragraph,
    row,
)
from tcfit_app.review.panels.elements.selected_frames import unseen
from tcfit_app.review.panels.fit.fit_texts import progress_in_words
from tcfit_app.review.panels.notes import Notes
from tcfit_app.review.panels.who_is_who import WhoIsWho

_MOST = 40
"""Entries listed; a checked one makes room for the next."""
_CARDS, _FEWER = 5, 3
"""Entries listed at first; fewer if there is something else above them."""
_KINDS = {
    "failed": "Failed",
    "swap": "Swapped",
    "reprojection": "Away from the keypoint",
    "steady": "Away for many frames",
    "jump": "Jumps",
    "detection": "Detection jumps",
    "depth": "Depth",
    "frozen": "Frozen",
    "confidence": "Not detected",
}
"""Kinds of findings, as users read them."""


class ReviewPanel:
    """The review queue."""

    title: ClassVar[str] = "Review"
    icon: ClassVar[viser.IconName] = viser.Icon.CHECKLIST

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._action = gestures, partial(action, gestures)
        self._tab = tab = gestures.tab
        self._all = False
        """All entries are listed, not only the first."""
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
        self._who_is_who = WhoIsWho(gestures)
        self._queue = Board(tab)
        self._notes = Notes(gestures)

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
        self._draw_damage()
        self._draw_media()
        self._who_is_who.draw()
        self._queue.show(*self._entries(), *self._approval())
        self._notes.draw()

    def _here(self, listed: Sequence[Suspect]) -> Suspect | None:
        """The entry on show."""
        frame = self._tab.state.frame
        around = [suspect for suspect in listed if frame in suspect.frames]
        return next((suspect for suspect in around if suspect.frame == frame), next(iter(around), None))

    def _entries(self) -> list[Html]:
        """The heading, the buttons, and a card for each of the first entries, or a sentence in their place."""
        tab, shown, found = self._tab, self._tab.shown.b, self._gestures.reviewing.queue
        if shown is None:
            text = "Suspicious places are found once there is a fit."
            return [paragraph(text), row(self._action("panel_fit", "Go to Fit"))]
        if found is None:
            return self._missing(shown)
        listed = self._gestures.reviewing.suspects or ()
        here = self._here(listed)
        fewer = _FEWER if tab.someone.others or self._video_problem else _CARDS
        most = _MOST if self._all else fewer
        start = 0 if here is None else max(0, listed.index(here) + 1 - most)
        cards = (self._card(one, here=one is here) for one in listed[start : start + most])
        parts = [_heading(found, again=self._gestures.reviewing.looking), *self._buttons(), *cards]
        if kind := tab.state.queue_kind:
            parts.append(paragraph(f"{_KINDS.get(kind, kind)} only: {len(listed)} of {len(found.left)}", "dim"))
        more = len(listed) - most
        if more > 0 and self._all:
            parts.append(paragraph(f"and {more} more", "dim"))
        if len(listed) > fewer:
            label = "Show fewer" if self._all else f"{more} more"
            parts.append(row(button(label, "review.more", do=self._more_or_fewer)))
        return parts

    def _missing(self, shown: Shown) -> list[Html]:
        """Why a fit has no entries yet, and what leads on."""
        tab = self._tab
        job = next((job for job in tab.session.jobs.values() if job.run == shown.run.id), None)
        if job is not None:
            text = f"{shown.run.name}: {progress_in_words(job)}. Suspicious places are found when it is done."
            return [paragraph(text, "dim")]
        if not (problem := tab.data.problem("suspects", shown)):
            return [paragraph("Looking for suspicious places …", "dim")]
        parts = [paragraph(f"Suspicious places cannot be found: {problem}", "warn")]
        if shown.run.partial and not tab.session.project.read_only:
            resume = partial(self._gestures.fitting.resume, shown.run)
            parts.append(row(button("Continue", "review.continue", do=resume)))
        return parts

    def _more_or_fewer(self) -> None:
        self._all = not self._all

    def _card(self, suspect: Suspect, *, here: bool) -> Html:
        where = in_words(suspect.frames, self._tab.first_frame)
        return card(
            capitalized(suspect.reason),
            where,
            "review.go",
            suspect.key,
            do=partial(self._gestures.reviewing.show, suspect),
            here=here,
            hint="; ".join(suspect.also),
        )

    def _buttons(self) -> list[Html]:
        tab, act, reviewing = self._tab, self._action, self._gestures.reviewing
        following = act("next_suspect", "Next place", kind="main")
        more = menu_button("More ▾", "review.menu", self._more())
        if tab.session.project.read_only:
            return [row(following, more)]
        if tab.hidden_frames_chosen:
            return [row(following, more), *unseen(tab)]
        fine = 'Undo "looks fine"' if reviewing.fine else "Looks fine"
        if (entry := reviewing.on_show) is not None:
            return [row(act("fine", fine, hint=reviewing.subject(entry)), following, more)]
        if tab.state.frames is None:
            return [row(act("fine", fine), following, more)]
        where = in_words(tab.state.frames, tab.first_frame)
        return [row(act("fine", f"{fine}, {where}")), row(following, more)]

    def _more(self) -> list[Item | None]:
        """The menu of what is needed less often."""
        gestures, reviewing, tab = self._gestures, self._gestures.reviewing, self._tab
        flagged = not tab.state.playing and reviewing.are("flag", tab.chosen_frames)
        flag = f"{'Remove flag:' if flagged else 'Flag'} {in_words(tab.chosen_frames, tab.first_frame)}"
        items: list[Item | None] = [
            action_item(gestures, "previous_suspect", "Previous place"),
            action_item(gestures, "flag", "Flag on or off" if tab.state.playing else flag),
            action_item(gestures, "all_fine", f"All listed look fine ({len(reviewing.suspects or ())})"),
            action_item(gestures, "copy_link"),
        ]
        counts = kinds_of(() if reviewing.queue is None else reviewing.queue.left)
        now = tab.state.queue_kind
        if len(counts) > 1 or now:
            labels = {"": "All kinds"} | {
                kind: f"{_KINDS.get(kind, kind)}: {counts[kind]}" for kind in dict.fromkeys((*counts, now)) if kind
            }
            items.append(None)
            items += [
                Item(label=label, do=partial(tab.set, queue_kind=kind), chosen=kind == now)
                for kind, label in labels.items()
            ]
        return items

    def _approval(self) -> list[Html]:
        tab, reviewing = self._tab, self._gestures.reviewing
        if tab.session.project.read_only:
            return []
        by = reviewing.approved
        buttons = [self._action("approve", "Withdraw approval" if by else "Approve clip")]
        if tab.in_list:
            buttons.append(self._action("approve_next"))
        return [heading(f"Approved by {by}" if by else "Done with this clip?"), row(*buttons)]

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


def _heading(found: ReviewQueue, *, again: bool) -> Html:
    """How many entries are left, and how many were reviewed; with `again` newer ones are being looked for."""
    left, reviewed = len(found.left), found.looked_at
    title = f"{left} suspicious place{'s' if left > 1 else ''}"
    if not left:
        title = f"All {reviewed} reviewed" if reviewed else "Nothing suspicious"
    note = f"{reviewed} of {left + reviewed} reviewed" if left and reviewed else ""
    return heading(title, "Looking again …" if again else note, first=True)
