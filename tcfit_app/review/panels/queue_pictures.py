"""Thumbnails for entries of the review queue, cropped from the video."""

from base64 import b64encode
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from tcfit_app.analysis.suspicion import Suspect
from tcfit_app.project.picture import crop_around
from tcfit_app.review.panels.elements.html import Board, Html, tag
from tcfit_app.review.shared.shared_video import SharedVideo
from tcfit_app.review.shared.video_frames import Crop
from tcfit_app.review.tab.tab import Tab

_SHAPE = 4 / 3
"""Width and height of a thumbnail."""
_LEAST = 0.35
"""The smallest crop, as a fraction of the person's height: a limb is recognised by what it is attached to."""
_MARGIN = 1.4
_TOGETHER = 10
"""How many more are sent at once."""


class QueuePictures:
    """One tab's thumbnails: CSS rules for the classes that `of` names. Called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._board = tab, Board(tab)
        self._crops: dict[tuple[int, tuple[int, ...]], Crop] = {}
        self._found: dict[tuple[int, Crop], bytes] = {}
        self._video: SharedVideo | None = None
        """The entries they show."""

    def of(self, suspect: Suspect) -> Html:
        """The placeholder of an entry's thumbnail."""
        return tag("span", "", class_=f"tcfit-picture {_class(suspect)}")

    def draw(self, suspects: Sequence[Suspect]) -> None:
        """Have missing thumbnails made, and send some at a time."""
        tab, wanted = self._tab, {_class(suspect): (suspect.frame, self._crop(suspect)) for suspect in suspects}
        video, kept = tab.data.video, self._found if tab.data.video is self._video else {}
        self._video, self._found = video, {one: made for one, made in kept.items() if one in wanted.values()}
        missing = {one for one in wanted.values() if one not in self._found and not video.problem_of(one[0])}
        if missing:
            ordered = [one for one in wanted.values() if one in missing]
            self._found |= video.thumbnails(ordered, reader=self)
        waiting = len(missing - self._found.keys())
        key = video, tuple(wanted), -(-waiting // _TOGETHER)
        rules = tab.once("pictures of the queue", key, lambda: self._rules(wanted))
        self._board.show(*([tag("style", rules)] if rules else []))

    def _rules(self, wanted: Mapping[str, tuple[int, Crop]]) -> Html:
        known = {name: self._found[one] for name, one in wanted.items() if one in self._found}
        return Html("\n".join(f".{name}{{{_image(made)}}}" for name, made in known.items()))

    def _crop(self, suspect: Suspect) -> Crop:
        key = suspect.frame, suspect.joints
        if key not in self._crops:
            corrected, size = self._tab.session.project.corrected, self._tab.session.project.footage.camera.size
            seen = corrected.confidence[suspect.frame] > 0
            self._crops[key] = crop_of(corrected.xy[suspect.frame], seen, suspect.joints, size)
        return self._crops[key]


def crop_of(
    xy: Float[np.ndarray, "137 2"], seen: Bool[np.ndarray, "137"], joints: Sequence[int], size: tuple[int, int]
) -> Crop:
    """The part of an image that shows some of a person's keypoints, within the image.

    Args:
        xy: All of the person's keypoints, pixels.
        seen: Which of them were detected.
        joints: The keypoints to show. If none of them was detected: the whole person, or without one the whole image.
        size: Of the image, width and height in pixels.
    """
    person = xy[seen & (np.arange(kp.COUNT) < kp.BODY.stop)]
    if not len(person):
        return 0, 0, *size
    own = [joint for joint in joints if seen[joint]]
    shown = xy[own] if own else person
    least = max(_LEAST * float(np.ptp(person[:, 1])), 16.0)
    return crop_around(shown, size, shape=_SHAPE, margin=_MARGIN, least=least)


def _class(suspect: Suspect) -> str:
    return f"tcfit-at-{suspect.key}".replace(" ", "-").replace("+", "-")


def _image(jpeg: bytes) -> str:
    return f"background-image:url(data:image/jpeg;base64,{b64encode(jpeg).decode()})"
