"""The status line of one tab: what is being fitted, what was saved, what is wrong."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting_core.body.geometry import SIDES
from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, NAMES
from tcfit_app.analysis.body_regions import spoken
from tcfit_app.fitting.fit_progress import in_words
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.review.browser.page_states import Chip, Chips, Notice
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.edit_words import also_here, part_name
from tcfit_app.review.session.tasks import Task
from tcfit_app.review.shared.drawing_data import DrawingData, FrameBody
from tcfit_app.review.tab.tab import Tab


class Status:
    """Draws one tab's status line and notices; called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._correcting, self._again = gestures.tab, gestures.correcting, gestures.again

    def draw(self, now: float, problem: str) -> None:
        """Send what changed; `problem` says what cannot be shown, and why."""
        tab = self._tab
        tab.channel.send("chips", Chips(chips=tuple(self.chips(now, problem))))
        tab.channel.send("notice", self._notice())

    def chips(self, now: float, problem: str) -> list[Chip]:
        """The current messages; `problem` as in `draw`."""
        tab, session = self._tab, self._tab.session
        running = [job for job in session.jobs.values() if job.started]
        chips = [progress_chip(job) for job in running]
        if session.edit_follower.busy and not self._correcting.dragging:
            chips.append(Chip(text="Fit is following the edit", kind="busy"))
        chips += self._again_chips()
        if waiting := len(session.jobs) - len(running):
            chips.append(Chip(text=f"{waiting} waiting", kind="busy"))
        if going := self._finding():
            chips.append(going)
        of_frame = tab.data.video.problem_of(tab.first_frame + tab.state.frame)
        frame_problem = "" if session.project.media.problem else of_frame
        chips += [Chip(text=text, kind="warning") for text in (frame_problem, problem, self._gap()) if text]
        text, until = tab.message
        if text and now < until:
            chips.append(Chip(text=text, kind="good"))
        return [*chips, *lasting(tab)]

    def _gap(self) -> str:
        """Which selected correction the body does not reach, and what to move as well; empty if it reaches them all."""
        tab, session, body = self._tab, self._tab.session, self._tab.shown.body("b")
        moving = tab.state.playing or session.edit_follower.busy or session.jobs or tab.shown.live is not None
        if body is None or moving or tab.data.warming:
            return ""
        key = tab.state.selection, body.version, session.project.keypoints_version
        try:
            return tab.once("gap", key, lambda: gap_words(session.project.corrected, tab.data, body, key[0]))
        except InputError:  # the body is missing, which `problem` says
            return ""

    def _again_chips(self) -> list[Chip]:
        """What is being detected again, or what the rectangle to be drawn is for."""
        chips, going, framing = [], self._again.going, self._again.framing
        if framing is not None:
            chips.append(Chip(text=f"Draw a rectangle around the {part_name(framing)}; Esc cancels"))
        if going is not None and going.state == "running":
            chips.append(task_chip(going))
        return chips

    def _notice(self) -> Notice | None:
        """A card if there is nothing else to see."""
        project = self._tab.session.project
        if project.has_detections or project.media.path is not None:
            return None
        text = "This project has no keypoints yet, and its video is missing. Import keypoints in the panel Start."
        return Notice(title="Nothing to show yet", text=text)

    def _finding(self) -> Chip | None:
        """The progress of the keypoint job, if one runs."""
        going = self._tab.session.source.going
        if self._tab.session.project.has_detections or going is None or going.state != "running":
            return None
        return task_chip(going)


GAP = 0.01
"""Distance beyond which a correction counts as not reached, in image diagonals; overlay.js draws the same ones."""
_WITH = {
    **{"elbow": "wrist", "wrist": "elbow", "shoulder": "elbow", "knee": "ankle", "ankle": "knee", "hip": "knee"},
    **{"heel": "ankle", "big_toe": "ankle", "small_toe": "ankle"},
}
"""The keypoint that holds back another one of its side."""


def gap_words(corrected: Corrected, data: DrawingData, body: FrameBody, joints: Sequence[int]) -> str:
    """The largest gap between these keypoints, as far as they were corrected in a body's frame, and the body, in words;
    empty without any."""
    worst, here, least = ("", 0.0), corrected[body.frame], GAP * float(np.hypot(*body.shown.camera.size))
    for joint, gap in zip(joints, data.gaps(body, joints).tolist(), strict=True):
        if here.edited[joint] and not here.bad[joint] and gap > max(worst[1], least):
            worst = (_gap_words(joint, gap), gap)
    return worst[0]


def _gap_words(joint: int, gap: float) -> str:
    side, _, part = NAMES[joint].partition("_")
    held = "wrist" if joint >= BODY.stop and side in SIDES else _WITH.get(part, "")
    also = f"the {side} {held}" if held else "the keypoints around it"
    return f"The body is still {gap:.0f} px from the {spoken(joint)}. Move {also} too, or reset the keypoint"


def lasting(tab: Tab) -> list[Chip]:
    """The messages that stay until something is done about them; pictures leave room for these."""
    session, chips = tab.session, []
    project = session.project
    if others := also_here(tab.authors(), tab.author):
        chips.append(Chip(text=others))
    if project.read_only:
        chips.append(Chip(text="Read-only: nothing can be changed", kind="warning"))
    if not project.has_detections:
        if not session.source.busy:
            chips.append(Chip(text="No keypoints yet: find them in the panel Start", kind="warning"))
    elif not session.jobs and not session.fits.showable():
        how = "" if project.read_only else ": press Shift+R, or Fit everything in the panel Fit"
        chips.append(Chip(text=f"No fit yet{how}"))
    damaged = damage_in_short(project.damage)
    return [*chips, *(Chip(text=text, kind="warning") for text in (damaged, project.media.problem) if text)]


def damage_in_short(damage: Sequence[str]) -> str:
    """What is damaged in a project, in one line; empty if nothing is."""
    if len(damage) < 2:
        return "".join(f"Damaged: {text}" for text in damage)
    return f"Damaged: {damage[0]}, and {len(damage) - 1} more (see the panel Review)"


def progress_chip(job: RunningJob) -> Chip:
    """The progress of a running job, in one line."""
    progress = job.progress
    if progress is None:
        return Chip(text=f"{job.title}: starting", kind="busy")
    text = f"{job.title}: {in_words(progress.phrase, progress.remaining)}"
    return Chip(text=text, kind="busy", progress=round(progress.fraction, 2))


def task_chip(task: Task[Any]) -> Chip:
    """The progress of a task, in one line."""
    progress = None if task.share is None else round(task.share, 2)
    return Chip(text=f"{task.title}: {task.words}", kind="busy", progress=progress)
