"""What one tab says over its picture: what is being fitted, what was saved, what is wrong."""

from typing import TYPE_CHECKING

from tcfit_app.fitting.running_job import RunningJob
from tcfit_app.review.browser.page_states import Chip, Chips, Notice

if TYPE_CHECKING:
    from tcfit_app.review.page import Page

PHASES = {1: "every frame", 2: "shape", 3: "over time"}
"""Phases in few words."""


class Status:
    """Draws one page's status line and notices; asked again and again, it sends what changed."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        self.problem = ""
        """What cannot be shown, and why; set by who draws."""

    def draw(self, now: float) -> None:
        """Send what changed."""
        page = self._page
        chips = tuple(self._chips(now))
        if page.changes.of("chips", chips):
            page.channel.send("chips", Chips(chips=chips))
        notice = self._notice()
        if page.changes.of("notice", notice):
            page.channel.send("notice", notice)
        self.problem = ""

    def _chips(self, now: float) -> list[Chip]:
        page, session = self._page, self._page.session
        chips = []
        if session.project.read_only:
            chips.append(Chip(text="Read-only: nothing can be changed", kind="warning"))
        running = [job for job in session.jobs.values() if job.started]
        chips += [progress_chip(job) for job in running]
        if session.following.busy and not page.correcting.dragging:
            chips.append(Chip(text="The fit follows", kind="busy"))
        if waiting := len(session.jobs) - len(running):
            chips.append(Chip(text=f"{waiting} waiting", kind="busy"))
        if not session.project.has_detections:
            chips.append(self._keypoint_chip())
        elif not session.jobs and not session.fits.showable():
            chips.append(Chip(text="No fit yet: press Shift+R, or Fit everything in the panel Fit"))
        media = session.project.media.problem or page.desk.video.problem_of(page.state.frame)
        for text in (media, self.problem):
            if text:
                chips.append(Chip(text=text, kind="warning"))
        text, until = page.message
        if text and now < until:
            chips.append(Chip(text=text, kind="good"))
        return chips

    def _notice(self) -> Notice | None:
        """A card where there is nothing else to see."""
        project = self._page.session.project
        if project.has_detections or project.media.path is not None:
            return None
        text = "This project has no keypoints yet, and its video is not there. Import keypoints in the panel Start."
        return Notice(title="There is nothing to see yet", text=text)

    def _keypoint_chip(self) -> Chip:
        """How far it is that the project gets its keypoints, or where they are to be had."""
        going = self._page.session.source.going
        if going is None or going.state != "running":
            return Chip(text="No keypoints yet: import or detect them in the panel Start", kind="warning")
        progress = None if going.share is None else round(going.share, 2)
        return Chip(text=f"{going.title}: {going.text}", kind="busy", progress=progress)


def progress_chip(job: RunningJob) -> Chip:
    """How far a running job is, in one line."""
    progress = job.progress
    if progress is None:
        return Chip(text=f"{job.title}: begins", kind="busy")
    left = "" if progress.remaining is None else f", {duration(progress.remaining)} left"
    text = f"{job.title}: {PHASES[progress.phase]}, {progress.label}{left}"
    return Chip(text=text, kind="busy", progress=round(progress.share, 2))


def duration(seconds: float) -> str:
    """A time in words: "8 s", "2 min 5 s"."""
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s"
