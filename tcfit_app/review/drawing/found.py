"""People found by a detection: the chosen one, and the others, who can be clicked on instead."""

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import BODY, BONES, COUNT
from tcfit_app.imports.found_people import FoundInFrame
from tcfit_app.review.browser.page_states import Keypoints, OtherPeople, OtherPerson, pixel_pairs, shares
from tcfit_app.review.tab.tab import Tab

_APART = 0.25
"""Minimum distance of another person's centre, relative to the chosen person's size, to be offered."""
_BODY_BONES = [pair for pair in BONES if max(pair) < BODY.stop]


class FoundPart:
    """Draws the chosen person's keypoints until the project has them, and the others while one of them can be chosen;
    called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    def draw(self) -> None:
        """Send what changed."""
        tab = self._tab
        people, frame = tab.session.source.people, tab.state.frame
        there = not tab.session.project.has_detections
        looking = people if there or tab.session.can_choose_person else None
        key = frame, looking, looking and looking.version
        shown, others = tab.once("found", key, lambda: found_in(frame, looking and looking.at(frame)))
        if there:
            tab.channel.send("keypoints", shown)
        if not tab.someone.others:
            tab.channel.send("other_people", others)


def found_in(frame: int, found: FoundInFrame | None) -> tuple[Keypoints, OtherPeople]:
    """The chosen person's keypoints in a frame, and the others who can be chosen instead."""
    nobody = np.zeros((COUNT, 3))
    points = nobody if found is None or found.chosen is None else found.points[found.chosen]
    others = () if found is None else found.others
    people = tuple(
        _other(place, found.points[place])
        for place in others
        if found is not None and not in_the_same_place(found.points[place], points)
    )
    shown = Keypoints(frame=frame, xy=pixel_pairs(points[:, :2]), confidence=shares(points[:, 2]))
    return shown, OtherPeople(people=people)


def in_the_same_place(points: Float[np.ndarray, "137 3"], meant: Float[np.ndarray, "137 3"]) -> bool:
    """Whether a person is in the same place as the chosen one: a press would be ambiguous, and such a detection is
    often a part of the chosen person."""
    one, other = (of[BODY][of[BODY, 2] > 0, :2] for of in (points, meant))
    if not len(one) or not len(other):
        return False
    size = float(np.linalg.norm(np.ptp(other, axis=0)))
    return float(np.linalg.norm(one.mean(0) - other.mean(0))) < _APART * size


def _other(place: int, points: Float[np.ndarray, "137 3"]) -> OtherPerson:
    """A person who was not chosen."""
    sure = points[BODY][points[BODY, 2] > 0, :2]
    bones = [
        (*points[a, :2].round(1).tolist(), *points[b, :2].round(1).tolist())
        for a, b in _BODY_BONES
        if points[a, 2] > 0 and points[b, 2] > 0
    ]
    return OtherPerson(
        number=place,
        name="This one?",
        hint="Choose this person instead",
        at=pixel_pairs(sure[[sure[:, 1].argmin()]])[0] if len(sure) else None,
        bones=tuple(bones),
    )
