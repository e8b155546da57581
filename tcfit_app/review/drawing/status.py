"""What a tab's header says of its clip: what is being fitted, what was saved, what is wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from fitting_core.errors import InputError
from fitting_core.keypoints import BODY, NAMES, SIDES
from tcfit_app.analysis.body_regions import spoken
from tcfit_app.fitting.fit_progress import time_left
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.review.browser.page_states import Notice
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.session.tasks import Task
from tcfit_app.review.shared.drawing_data import DrawingData, FrameBody
from tcfit_app.review.tab.tab import Tab


@dataclass(frozen=True, kw_only=True)
class Message:
    """What is being done or is wrong, in a line."""

    text: str
    kind: Literal["info", "busy", "good", "warning"] = "info"
    progress: float | None = None
    hint: str = ""
    """More about it."""
    panel: str = ""
    """The panel in which something can be done about it."""
    cancel: Callable[[], object] | None = None
    """Cancels what is being done."""


class Status:
    """What one tab's header says of its clip."""

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._correcting, self._again = gestures.tab, gestures.correcting, gestures.again
        self._exporting, self._views = gestures.exporting, gestures.views

    def messages(self, now: float, problem: str) -> list[Message]:
        """The current messages, the most urgent first; `problem` says what cannot be shown, and why."""
        tab, session = self._tab, self._tab.session
        running = [job for job in session.jobs.values() if job.started]
        found = self._tasks()
        found += [progress_message(job, partial(session.cancel, job.run)) for job in running]
        if session.edit_follower.busy and not self._correcting.dragging:
            found.append(Message(text="Fit is following the edit", kind="busy"))
        if waiting := len(session.jobs) - len(running):
            found.append(Message(text=f"{waiting} waiting", kind="busy"))
        text, until = tab.message
        if text and now < until:
            found.append(Message(text=text, kind="good"))
        of_frame = tab.data.video.problem_of(tab.first_frame + tab.state.frame)
        frame_problem = "" if session.project.media.problem else of_frame
        found += [Message(text=text, kind="warning") for text in (frame_problem, problem, self._gap()) if text]
        return [*found, *lasting(tab)]

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

    def _tasks(self) -> list[Message]:
        """What is being detected or exported, or what the rectangle to be drawn is for."""
        found, again, source = [], self._again, self._tab.session.source
        if again.framing is not None:
            words = f"Draw a rectangle around the {part_name(again.framing)}"
            found.append(Message(text=words, cancel=again.give_up_framing))
        for task in (again.task.last, source.going, self._exporting.task.last, self._views.task.last):
            if task is not None and task.state == "running":
                found.append(task_message(task))
        return found


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
    here, least = corrected[body.frame], GAP * float(np.hypot(*body.shown.camera.size))
    made = [joint for joint in joints if here.edited[joint] and not here.bad[joint]]
    if not made:  # the body need not be posed for it
        return ""
    gaps = np.nan_to_num(data.gaps(body, made))
    worst = int(gaps.argmax())
    return _gap_words(made[worst], float(gaps[worst])) if gaps[worst] > least else ""


def _gap_words(joint: int, gap: float) -> str:
    side, _, part = NAMES[joint].partition("_")
    held = "wrist" if joint >= BODY.stop and side in SIDES else _WITH.get(part, "")
    also = f"the {side} {held}" if held else "the keypoints around it"
    return f"The body is still {gap:.0f} px from the {spoken(joint)}. Move {also} too, or reset the keypoint"


def lasting(tab: Tab) -> list[Message]:
    """The messages that stay until something is done about them."""
    session, found = tab.session, []
    project = session.project
    if project.read_only:
        found.append(Message(text="Read-only", hint="Nothing can be changed", kind="warning"))
    if not project.has_detections:
        if not session.source.busy:
            found.append(Message(text="No keypoints yet", panel="Start", kind="warning"))
    elif not session.jobs and not session.fits.showable():
        found.append(Message(text="No fit yet", panel="Fit"))
    damaged = damage_in_short(project.damage)
    problems = (text for text in (damaged, project.media.problem) if text)
    return [*found, *(Message(text=text, panel="Review", kind="warning") for text in problems)]


def notice(tab: Tab) -> Notice | None:
    """A card over the picture if there is nothing else to see."""
    project = tab.session.project
    if project.has_detections or project.media.path is not None:
        return None
    text = "This project has no keypoints yet, and its video is missing. Import keypoints in the panel Start."
    return Notice(title="Nothing to show yet", text=text)


def damage_in_short(damage: Sequence[str]) -> str:
    """What is damaged in a project, in one line; empty if nothing is."""
    if len(damage) < 2:
        return "".join(f"Damaged: {text}" for text in damage)
    return f"Damaged: {damage[0]}, and {len(damage) - 1} more (see the panel Review)"


def progress_message(job: RunningJob, cancel: Callable[[], object]) -> Message:
    """The progress of a running job."""
    progress = job.progress
    if progress is None:
        return Message(text="Fitting", hint=f"{job.title}: starting", kind="busy", cancel=cancel)
    share, left = round(progress.fraction, 2), time_left(progress.remaining)
    text = f"Fitting {share:.0%}".replace("%", " %") + (left and f" · {left}")
    return Message(text=text, hint=f"{job.title}: {progress.phrase}", kind="busy", progress=share, cancel=cancel)


def task_message(task: Task[Any]) -> Message:
    """The progress of a task."""
    progress = None if task.share is None else round(task.share, 2)
    return Message(text=f"{task.title}: {task.words}", kind="busy", progress=progress, cancel=task.cancel)
