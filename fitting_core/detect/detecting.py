"""Detection over a clip: a generator of how far it is, which can be ended at any time and gone on with later."""

import hashlib
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.detect import BoxModel, simcc
from fitting_core.detect.boxes import Boxes
from fitting_core.detect.stored import DetectionSettings, StoredDetection
from fitting_core.detect.tracking import box_around, follow, whole
from fitting_core.errors import InputError
from fitting_core.io.keypoints.coco_wholebody_layout import WHOLEBODY_COUNT, from_wholebody
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.video.frames import FrameSource

PART = 32
"""Frames that are stored together: what has to be done again after an end in between."""
LEAST = 0.05
"""Points of lower confidence are not reported, as with OpenPose."""


@dataclass(frozen=True, kw_only=True)
class DetectionProgress:
    """How far a detection is."""

    step: Literal["people", "keypoints"]
    done: int
    """Frames."""
    total: int

    @property
    def share(self) -> float:
        """Of this step, 0 to 1."""
        return self.done / max(1, self.total)


@dataclass(frozen=True, kw_only=True)
class Detected:
    """The end, or what there is before it."""

    keypoints: Keypoints
    """Of the first frames of the clip: of all at the end."""
    note: str
    """For the user: who was followed, and where nobody was."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection:
    """What is to be detected, and with what."""

    source: FrameSource
    frames: range
    """Numbers of consecutive frames of the source."""
    pose: simcc.SimCC
    boxes: BoxModel | None = None
    """None: the person is looked for in the whole first frame, and in later ones where the points of the frame before
    lie."""
    person: int = 0
    """With a box model, 0 for the most prominent person, 1 for the next."""
    batch: int = 8
    """Frames that go through a model at once, where it takes several. What is found does not depend on it."""

    def __post_init__(self) -> None:
        if self.batch < 1 or self.person < 0:
            raise InputError(f"batch={self.batch}, person={self.person}: expected 1 or more, and 0 or more.")
        if self.person and self.boxes is None:
            raise InputError(f"person={self.person} needs a box model: without one, nobody is told apart.")

    def settings(self) -> DetectionSettings:
        """All that the result depends on."""
        first = hashlib.sha256(self.source.frame(self.frames[0]).tobytes()).hexdigest()[:32]
        return DetectionSettings(
            video=f"{first} {self.source.size[0]}x{self.source.size[1]} {len(self.source)}",
            first_frame=self.frames[0],
            last_frame=self.frames[-1],
            pose_model=self.pose.model.sha256,
            box_model=self.boxes.model.sha256 if self.boxes else "",
            person=self.person,
        )

    def events(self, store: StoredDetection) -> Iterator[DetectionProgress | Detected]:
        """Detect, storing every PART frames; what was stored before is not done again. The last event is the result.

        Raises:
            InputError: The store holds another detection, a frame cannot be decoded, a model not be run.
        """
        store.begin(self.settings())
        where, note = None, ""
        if self.boxes is not None:
            found = yield from self._find_people(self.boxes, store)
            where, note = follow(found, person=self.person, first_frame=self.frames[0])
        yield from self._find_points(where, store)
        points = self._stored_points(store)
        assert len(points) == len(self.frames)
        yield Detected(
            keypoints=to_keypoints(points, self.source.size), note=note or _lost_note(points, self.frames[0])
        )

    def so_far(self, store: StoredDetection) -> Detected:
        """What is stored of it, from the first frame on without a gap."""
        points = self._stored_points(store)
        return Detected(keypoints=to_keypoints(points, self.source.size), note="")

    def _parts(self) -> list[range]:
        return [self.frames[start : start + PART] for start in range(0, len(self.frames), PART)]

    def _images(self, frames: Sequence[int]) -> list[UInt8[np.ndarray, "H W 3"]]:
        return [self.source.frame(frame) for frame in frames]

    def _find_people(self, model: BoxModel, store: StoredDetection) -> Generator[DetectionProgress, None, list[Boxes]]:
        everybody: list[Boxes] = []
        for number, part in enumerate(self._parts()):
            found = store.read_boxes(number)
            if found is None or len(found) != len(part):
                found = []
                for start in range(0, len(part), self.batch):
                    found += model.find(self._images(part[start : start + self.batch]))
                    yield self._progress("people", len(everybody) + len(found))
                store.write_boxes(number, found)
            everybody += found
            yield self._progress("people", len(everybody))
        return everybody

    def _find_points(
        self, where: Float[np.ndarray, "T 4"] | None, store: StoredDetection
    ) -> Iterator[DetectionProgress]:
        before = np.zeros((0, WHOLEBODY_COUNT, 3))
        for number, part in enumerate(self._parts()):
            points = store.read_points(number)
            if points is None or len(points) != len(part):
                done = len(before)
                steps = self._tracked(part, before) if where is None else self._boxed(part, where[done:][: len(part)])
                found = []
                for some in steps:
                    found.append(some)
                    yield self._progress("keypoints", done + sum(map(len, found)))
                points = np.concatenate(found)
                store.write_points(number, points)
            before = np.concatenate([before, points])
            yield self._progress("keypoints", len(before))

    def _boxed(self, part: range, where: Float[np.ndarray, "n 4"]) -> Iterator[Float[np.ndarray, "n 133 3"]]:
        """Points of a part in boxes that are known, some frames at a time."""
        for start in range(0, len(part), self.batch):
            frames, boxes = part[start : start + self.batch], where[start : start + self.batch]
            points = np.zeros((len(frames), WHOLEBODY_COUNT, 3))
            there = np.flatnonzero(np.isfinite(boxes[:, 0]))
            if len(there):
                points[there] = self.pose.points(self._images([frames[i] for i in there]), boxes[there])
            yield points

    def _tracked(self, part: range, before: Float[np.ndarray, "n 133 3"]) -> Iterator[Float[np.ndarray, "1 133 3"]]:
        """Points of a part, each frame's in a box around those of the frame before, the first of which is given."""
        size, highest = self.source.size, float(before[..., 2].max(initial=0.0))
        box = box_around(before[-1], highest, size) if len(before) else None
        for frame in part:
            image = self.source.frame(frame)
            points = self._looked_for(image, highest) if box is None else self._points(image, box)
            box = box_around(points, highest, size)
            if box is None:
                points = np.zeros_like(points)
            highest = max(highest, points[:, 2].max())
            yield points[None]

    def _looked_for(self, image: UInt8[np.ndarray, "H W 3"], highest: float) -> Float[np.ndarray, "133 3"]:
        """Points of a person who can be anywhere: in the whole image, then again in the box that this gives."""
        points = self._points(image, whole(self.source.size))
        nearer = box_around(points, highest, self.source.size)
        return points if nearer is None else self._points(image, nearer)

    def _points(self, image: UInt8[np.ndarray, "H W 3"], box: Float[np.ndarray, "4"]) -> Float[np.ndarray, "133 3"]:
        return self.pose.points([image], box[None])[0]

    def _stored_points(self, store: StoredDetection) -> Float[np.ndarray, "n 133 3"]:
        parts = []
        for number, part in enumerate(self._parts()):
            points = store.read_points(number)
            if points is None or len(points) != len(part):
                break
            parts.append(points)
        return np.concatenate(parts) if parts else np.zeros((0, WHOLEBODY_COUNT, 3))

    def _progress(self, step: Literal["people", "keypoints"], done: int) -> DetectionProgress:
        return DetectionProgress(step=step, done=done, total=len(self.frames))


def to_keypoints(points: Float[np.ndarray, "n 133 3"], size: tuple[int, int]) -> Keypoints:
    """Keypoints of a clip from points with the heights of their peaks.

    Points of a confidence below LEAST, and those outside the image, where nothing was seen, are not detected.
    """
    confidence = simcc.confidence(points[..., 2])
    inside = ((points[..., :2] >= 0) & (points[..., :2] <= np.array(size) - 1)).all(-1)
    confidence = np.where(inside & (confidence >= LEAST), confidence, 0.0)
    found = from_wholebody(np.concatenate([points[..., :2], confidence[..., None]], -1))
    assert found.shape[1] == COUNT
    return Keypoints(xy=found[..., :2], confidence=found[..., 2])


def _lost_note(points: Float[np.ndarray, "n 133 3"], first_frame: int) -> str:
    lost = np.flatnonzero(~points.any((1, 2)))
    if not len(lost):
        return ""
    return f"Nobody was found in {len(lost)} of {len(points)} frames, the first of them {first_frame + lost[0]}."
