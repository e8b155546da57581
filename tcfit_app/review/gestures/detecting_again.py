"""Detecting again in one tab: a person, a hand or the face, in the selected frames or the one on show."""

from functools import partial

from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.keypoints import PartOfPerson
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.second_looks import Region, SecondLook
from tcfit_app.project.edits.kinds import DetectAgain
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_events import Framed
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.tab.tab import OneTask, Tab

_LEAST = 2.0
"""Minimum width and height of a rectangle, pixels."""


class DetectingAgain:
    """Second looks in one tab, one at a time. Methods raise InputError for what cannot be done."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self.task = OneTask(tab)
        self.framing: PartOfPerson | None = None
        """What the next rectangle drawn in the picture is for."""

    def look(self, part: PartOfPerson, region: Region | None = None) -> None:
        """Start looking for a part.

        Args:
            part: Which part.
            region: The rectangle of the picture to look in; None: wherever the person is.
        """
        self.refuse()
        tab, self.framing = self._tab, None
        look, clip = SecondLook(frames=tab.frames_to_change, part=part, region=region), tab.session.project.clip
        tab.pause()
        title, keep = f"Detecting the {part_name(part)} again", partial(self._keep, look, clip)
        self.task.begin(title, lambda report: look.run(clip, report), keep)

    def frame(self, part: PartOfPerson) -> None:
        """Make the next drag in the picture draw the rectangle to look in."""
        self._tab.pause()
        self.framing = part

    def take(self, event: Framed) -> None:
        """A rectangle was drawn."""
        tab, part = self._tab, self.framing
        if part is None or event.frame >= tab.length:
            return
        self.framing = None
        region = self._in_picture(event, part)
        tab.seek(event.frame)
        self.look(part, region)

    def _in_picture(self, event: Framed, part: PartOfPerson) -> Region:
        width, height = self._tab.session.project.footage.camera.size
        left, right = (min(max(x, 0.0), width) for x in sorted((event.left, event.right)))
        top, bottom = (min(max(y, 0.0), height) for y in sorted((event.top, event.bottom)))
        if right - left < _LEAST or bottom - top < _LEAST:
            raise InputError(f"The rectangle is too small. Draw it in the picture, around the {part_name(part)}.")
        return left, top, right, bottom

    def give_up_framing(self) -> bool:
        """Cancel drawing a rectangle; returns whether one was to be drawn."""
        framing, self.framing = self.framing, None
        return framing is not None

    def refuse(self) -> None:
        """Raises InputError if there are no keypoints that can be changed, no video, or a second look is running."""
        session = self._tab.session
        self._tab.refuse_read_only()
        session.refuse_without_keypoints()
        if session.project.media.path is None:
            raise InputError("The project's video is missing, so nothing can be detected.")
        self.task.refuse()

    def _keep(self, look: SecondLook, clip: Clip, edit: DetectAgain | None) -> None:
        tab, name = self._tab, part_name(look.part)
        if edit is None:
            where = in_words(look.frames, tab.first_frame)
            return tab.notify(Notice(title=f"No {name} was found in {where}.", text=_advice(look)))
        if tab.session.project.footage.camera.lens != clip.camera.lens:
            raise InputError("The camera's lens has changed meanwhile. Detect again.")
        left = sorted({*look.frames} - {*edit.frames})
        self._correcting.keep(edit, f"; not found in {in_words(left, tab.first_frame)}" if left else "")


def _advice(look: SecondLook) -> str:
    if look.region is None:
        return f"If it is visible there, detect the {part_name(look.part)} in a rectangle."
    return "Try a slightly larger rectangle, or place the keypoints by hand."
