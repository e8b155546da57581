"""RTMPose, DWPose and RTMW over a clip: in the boxes of a box model, or around the points of the frame before."""

from collections.abc import Generator, Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.detect.part import Part
from fitting_core.detect.topdown import simcc
from fitting_core.detect.topdown.boxes import Boxes, BoxModel
from fitting_core.errors import InputError
from fitting_core.video.frames import FrameSource
from fitting_core.wholebody import WHOLEBODY_COUNT, from_wholebody

PART = 32
"""Frames that are stored together: what has to be done again after an end in between."""
LEAST = 0.05
"""Points of lower confidence are not reported, as with OpenPose."""
_MOST_PEOPLE = 6
"""In a frame: the largest and surest."""
_SURE = 0.3
"""Points of lower confidence say nothing about where the person is."""
_FEWEST_SURE = 6
"""With fewer sure points a person is lost, and looked for in the whole frame again."""
_VERSION = 1
"""Raised whenever the same models would find something different."""
_DIGITS = 12
"""Of a model's SHA-256 in the version."""


class TopDown:
    """See `Detector`.

    Args:
        name: In `DETECTORS`, or the file of the model.
        pose: Finds points in a box.
        boxes: Finds people; None: one person is looked for in the whole first frame, and in later ones where the points
            of the frame before lie.
        batch: Frames that go through a model at once, where it takes several. What is found does not depend on it.
    """

    points = "coco-wholebody"

    def __init__(self, name: str, pose: simcc.SimCC, boxes: BoxModel | None = None, *, batch: int = 8) -> None:
        if batch < 1:
            raise InputError(f"batch={batch}; expected 1 or more.")
        self.name, self._pose, self._boxes, self._batch = name, pose, boxes, batch
        models = [pose.model, *([boxes.model] if boxes else [])]
        self.version = " ".join([str(_VERSION), *(model.sha256[:_DIGITS] for model in models)])

    def part_length(self, size: tuple[int, int]) -> int:
        """See `Detector`."""
        return PART

    def detect(
        self, source: FrameSource, parts: Sequence[range], memory: Mapping[str, np.ndarray]
    ) -> Generator[int | Part, None, None]:
        """See `Detector`."""
        before, highest = memory.get("points", np.zeros((0, 3))), float(memory.get("highest", 0.0))
        done = 0
        for frames in parts:
            found: list[Float[np.ndarray, "P 133 3"]] = []
            for some in self._boxed(source, frames) if self._boxes else self._tracked(source, frames, before, highest):
                found += some
                yield done + len(found)
            done += len(frames)
            highest = max([highest, *(float(points[..., 2].max(initial=0.0)) for points in found)])
            before = found[-1][0] if len(found[-1]) else before[:0]
            people = tuple(to_points(points, highest, source.size) for points in found)
            yield Part(
                people=people,
                numbers=tuple(np.zeros(len(those), int) for those in people),
                silhouettes=tuple(np.zeros((len(those), 0), np.uint8) for those in people),
                memory={"points": before, "highest": np.array(highest)},
            )

    def _boxed(self, source: FrameSource, frames: range) -> Iterator[list[Float[np.ndarray, "P 133 3"]]]:
        assert self._boxes is not None
        for start in range(0, len(frames), self._batch):
            images = [source.frame_or_grey(frame) for frame in frames[start : start + self._batch]]
            chosen = [_most_prominent(boxes) for boxes in self._boxes.find(images)]
            owners = [image for image, corners in zip(images, chosen, strict=True) for _ in corners]
            points = self._pose.points(owners, np.concatenate(chosen))
            yield np.split(points, np.cumsum([len(corners) for corners in chosen])[:-1])

    def _tracked(
        self, source: FrameSource, frames: range, before: Float[np.ndarray, "n 3"], highest: float
    ) -> Iterator[list[Float[np.ndarray, "P 133 3"]]]:
        box = _box_around(before, highest, source.size) if len(before) else None
        for frame in frames:
            image = source.frame_or_grey(frame)
            points = self._looked_for(image, highest, source.size) if box is None else self._in(image, box)
            box = _box_around(points, highest, source.size)
            highest = max(highest, points[:, 2].max())
            yield [points[None] if box is not None else np.zeros((0, WHOLEBODY_COUNT, 3))]

    def _looked_for(
        self, image: UInt8[np.ndarray, "H W 3"], highest: float, size: tuple[int, int]
    ) -> Float[np.ndarray, "133 3"]:
        """Points of a person who can be anywhere: in the whole image, then again in the box that this gives."""
        points = self._in(image, np.array([0.0, 0.0, *size]))
        nearer = _box_around(points, highest, size)
        return points if nearer is None else self._in(image, nearer)

    def _in(self, image: UInt8[np.ndarray, "H W 3"], box: Float[np.ndarray, "4"]) -> Float[np.ndarray, "133 3"]:
        return self._pose.points([image], box[None])[0]


def _most_prominent(boxes: Boxes) -> Float[np.ndarray, "n 4"]:
    sizes = np.linalg.norm(boxes.corners[:, 2:] - boxes.corners[:, :2], axis=1) * boxes.scores
    return boxes.corners[np.argsort(-sizes, kind="stable")[:_MOST_PEOPLE]]


def _box_around(
    points: Float[np.ndarray, "133 3"], highest: float, size: tuple[int, int]
) -> Float[np.ndarray, "4"] | None:
    """The box in which to look for a person in the next frame; None if the person is lost.

    Args:
        points: Of this frame, as `SimCC.points` gives them.
        highest: Height of the highest peak of a point in all frames so far.
        size: Of the image.
    """
    confidence = simcc.peak_confidence(points[:, 2], highest=max(highest, points[:, 2].max()))
    inside = ((points[:, :2] >= 0) & (points[:, :2] < size)).all(1)
    sure = points[(confidence >= _SURE) & inside, :2]
    if len(sure) < _FEWEST_SURE:
        return None
    box = np.concatenate([sure.min(0), sure.max(0)])
    return box if (box[2:] - box[:2] > 1).all() else None


def to_points(
    points: Float[np.ndarray, "P 133 3"], highest: float, size: tuple[int, int]
) -> Float[np.ndarray, "P 137 3"]:
    """Keypoints with confidences, from points with the heights of their peaks.

    Points of a confidence below LEAST, and those outside the image, where nothing was seen, are not detected.

    Args:
        points: As `SimCC.points` gives them.
        highest: The largest height so far.
        size: Of the image.
    """
    confidence = simcc.peak_confidence(points[..., 2], highest=highest)
    inside = ((points[..., :2] >= 0) & (points[..., :2] <= np.array(size) - 1)).all(-1)
    confidence = np.where(inside & (confidence >= LEAST), confidence, 0.0)
    return from_wholebody(np.concatenate([points[..., :2], confidence[..., None]], -1))
