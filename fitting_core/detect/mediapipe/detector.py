"""The embedded detector: MediaPipe's networks over a clip.

What real time does not allow makes it better than MediaPipe's own: each body is shown plain and mirrored, people are
followed forwards and backwards, and a hand is looked for in several squares and in the neighbouring frames.

Bodies are found by one thread; hands, faces and silhouettes of the part before by another. A third decodes the part
after.
"""

import os
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event

import cv2
import numpy as np
from jaxtyping import Bool

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe import face as mesh
from fitting_core.detect.mediapipe import hands as hand_points
from fitting_core.detect.mediapipe import networks
from fitting_core.detect.mediapipe.body import Body, BodyNetwork, square_of
from fitting_core.detect.mediapipe.face import Face
from fitting_core.detect.mediapipe.following import Followed, Followers, Stretch
from fitting_core.detect.mediapipe.hands import Hand
from fitting_core.detect.mediapipe.hands_and_face import PartsFinder, SeenParts
from fitting_core.detect.mediapipe.openpose_points import points_of
from fitting_core.detect.mediapipe.single_shot import SingleShot
from fitting_core.detect.mediapipe.squares import Image, Square
from fitting_core.detect.part import Part
from fitting_core.keypoints import COUNT, SIDES
from fitting_core.silhouettes import silhouette_size
from fitting_core.video.frames import FrameSource

_BYTES = 80 << 20
"""Of the images of a part: those of five parts may be in memory at once."""
_FEWEST, _MOST = 8, 30
"""Frames of a part."""
_WORTH_LOOKING = 0.35
"""People smaller than this share of the largest one get no hands and no face: these have only a few pixels."""
_LONG = 1.5
"""Ratio of the sides of an image from which its ends are looked at by themselves."""
_NOBODY = np.zeros((COUNT, 3))
_VERSION = 3
"""Raised whenever the same networks would find something different."""


class MediaPipe:
    """See `Detector`. Raises InputError if the networks are not on this computer, or are damaged.

    Args:
        name: In `DETECTORS`.
        thorough: Show bodies and hands mirrored as well, and bodies to the heavy network where it is installed.
        threads: For each network; 0: as many as the computer's cores are good for.
    """

    points = "mediapipe"

    def __init__(self, name: str, *, thorough: bool, threads: int = 0) -> None:
        # Three networks run at once: body, mirrored body, and those of hands and face.
        threads = threads or int(np.clip((os.cpu_count() or 1) // 3, 1, 4))
        size = "heavy" if thorough and networks.is_installed("pose_landmark_heavy") else "full"
        self.name = name
        self.version = f"{_VERSION} {networks.version()} {size}{' mirrored' if thorough else ''}"
        self.body_in = BodyNetwork(size, mirrored=thorough, threads=threads)
        """The body in a square of an image."""
        self._person = SingleShot("person", threads=threads)
        self.parts_finder = PartsFinder(mirrored=thorough, threads=threads)

    def part_length(self, size: tuple[int, int]) -> int:
        """See `Detector`."""
        return int(np.clip(_BYTES // (3 * size[0] * size[1]), _FEWEST, _MOST))

    def detect(
        self, source: FrameSource, parts: Sequence[range], memory: Mapping[str, np.ndarray]
    ) -> Generator[int | Part, None, None]:
        """See `Detector`."""
        followers, clip = Followers(self.body_in, self.everybody_in), _Clip(self.parts_finder, source.size)
        if memory:
            people, clip.seen, found = recalled(memory)
            followers.start_from(people, found)
        pool = ThreadPoolExecutor(1, "tcfit: hands and faces")
        decoder = ThreadPoolExecutor(1, "tcfit: decoding")
        waiting: _Waiting | None = None
        """For the next stretch: its people may have entered in this one."""
        coming: Future[Part] | None = None
        try:
            coming_images = decoder.submit(clip.images, source, parts[0])
            for number, frames in enumerate(parts):
                stretch = Stretch(frames, coming_images.result())
                if number + 1 < len(parts):
                    coming_images = decoder.submit(clip.images, source, parts[number + 1])
                for done in followers.forwards(stretch):
                    yield (frames[0] - parts[0][0] + done + clip.done) // 2
                    if coming is not None and coming.done():
                        yield coming.result()
                        coming = None
                followers.backwards([stretch] if waiting is None else [waiting.stretch, stretch])
                if waiting is not None:
                    if coming is not None:
                        yield coming.result()
                    coming = pool.submit(clip.part, waiting, waiting.stretch.bodies())
                followers.forget(before=frames[0])
                waiting = _Waiting(stretch, followers.going_on(), followers.found)
            if coming is not None:
                yield coming.result()
            if waiting is not None:
                yield pool.submit(clip.part, waiting, waiting.stretch.bodies()).result()
        finally:
            clip.stopped.set()
            decoder.shutdown()
            pool.shutdown()

    def everybody_in(self, image: Image, harder: bool) -> list[Square]:
        """Squares around the people in an RGB image, the surest first.

        Args:
            image: RGB.
            harder: If no person is found, search small parts too, for people less than a seventh of the image high.
                Takes as long as 20 images.
        """
        width, height = image.shape[1::-1]
        found = self._found(image, [None, *_ends(width, height)])
        return found or (self._found(image, _tiles(width, height)) if harder else [])

    def people_in(self, image: Image, square: Square | None, *, threshold: float) -> list[Square]:
        """Squares around the people in a square of an RGB image, or anywhere, of at least a score."""
        return self._found(image, [square], threshold)

    def _found(self, image: Image, places: Sequence[Square | None], threshold: float | None = None) -> list[Square]:
        found = [one for place in places for one in self._person.find(image, place, threshold=threshold)]
        return [square_of(one.points[:2]) for one in sorted(found, key=lambda one: -one.score)]


def _ends(width: int, height: int) -> list[Square]:
    """The largest squares at both ends of an image that is long."""
    side, length = min(width, height), max(width, height)
    if length < _LONG * side:
        return []
    middles = (side / 2, length - side / 2)
    return [Square(at, side / 2, side) if width > height else Square(side / 2, at, side) for at in middles]


def _tiles(width: int, height: int) -> list[Square]:
    """Squares of half the short side, each of which shares half with the next."""
    side = min(width, height) / 2
    across, down = (
        np.linspace(side / 2, length - side / 2, round(2 * length / side) - 1) for length in (width, height)
    )
    return [Square(float(x), float(y), side) for y in down for x in across]


@dataclass(frozen=True, eq=False)
class _Waiting:
    """A stretch whose bodies are known, but for those that the next one tells of."""

    stretch: Stretch
    going_on: list[Followed]
    found: int
    """How many people there had been at its end."""


class _Stopped(Exception):
    """The part is not needed any more."""


class _Clip:
    """Decodes frames, and adds hands, faces and silhouettes to bodies, part by part; each in a thread of its own."""

    def __init__(self, finder: PartsFinder, size: tuple[int, int]) -> None:
        self._finder, self._size = finder, size
        self.seen: dict[int, SeenParts] = {}
        """Of the last frame, by the people's numbers."""
        self.done = 0
        """Frames."""
        self.stopped = Event()
        width, height = silhouette_size(size)
        self._no_mask = np.zeros(-(-width * height // 8), np.uint8)

    def images(self, source: FrameSource, frames: range) -> list[Image]:
        """Decoded frames."""
        images = []
        for frame in frames:
            if self.stopped.is_set():
                raise _Stopped
            images.append(source.frame_or_grey(frame))
        return images

    def part(self, waiting: _Waiting, bodies: Mapping[int, Mapping[int, Body]]) -> Part:
        """Of a stretch whose bodies are known, by person and frame."""
        frames, images = waiting.stretch.frames, waiting.stretch.images
        close = _close_enough(bodies)
        seen: dict[int, dict[int, SeenParts]] = {number: {} for number in bodies}
        for t, image in zip(frames, images, strict=True):
            if self.stopped.is_set():
                raise _Stopped
            for number in close:
                if (body := bodies[number].get(t)) is not None:
                    before = seen[number].get(t - 1) if t > frames[0] else self.seen.get(number)
                    seen[number][t] = self._finder.find(image, body, before, t)
            self.done += 1
        for t, image in zip(reversed(frames[:-1]), reversed(images[:-1]), strict=True):
            for shown, number in ((seen[number], number) for number in close):
                if t in shown and t + 1 in shown:
                    self._finder.improve(image, bodies[number][t], shown[t], shown[t + 1])
        self.seen = {number: shown[frames[-1]] for number, shown in seen.items() if frames[-1] in shown}
        there = [[number for number in sorted(bodies) if t in bodies[number]] for t in frames]
        return Part(
            people=tuple(
                _stacked([self._points(bodies[n][t], seen[n].get(t, SeenParts())) for n in numbers], _NOBODY)
                for t, numbers in zip(frames, there, strict=True)
            ),
            numbers=tuple(np.array(numbers, int) for numbers in there),
            silhouettes=tuple(
                _stacked([np.packbits(silhouette(bodies[n][t], self._size)) for n in numbers], self._no_mask)
                for t, numbers in zip(frames, there, strict=True)
            ),
            memory=remembered(waiting.going_on, self.seen, waiting.found),
        )

    def _points(self, body: Body, seen: SeenParts) -> np.ndarray:
        return points_of(body, seen.hands, seen.face, self._size)


def _stacked(arrays: list[np.ndarray], like: np.ndarray) -> np.ndarray:
    """Arrays as one, which may be of none."""
    return np.stack(arrays) if arrays else like[None][:0]


def _close_enough(bodies: Mapping[int, Mapping[int, Body]]) -> list[int]:
    """Who is large enough for hands and a face."""
    sides = {n: np.median([body.square.side for body in own.values()]) for n, own in bodies.items()}
    return [number for number, side in sides.items() if side >= _WORTH_LOOKING * max(sides.values())]


def silhouette(body: Body, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """What a body covers of an image of a size, scaled to `silhouette_size`."""
    small = silhouette_size(size)
    side = body.silhouette.shape[0]
    corners = np.array([[0, 0], [side, 0], [0, side]], float)
    scaled = body.square.to_image(corners, side) * (np.array(small) / size)
    matrix = cv2.getAffineTransform((corners - 0.5).astype(np.float32), (scaled - 0.5).astype(np.float32))
    return cv2.warpAffine(body.silhouette.astype(np.float32), matrix, small, flags=cv2.INTER_LINEAR) > 0.5


# --- going on from the last frame ---

Memory = Mapping[str, np.ndarray]
"""What following a person, the hands and the face needs of the last frame, as arrays: a detection can go on from it."""


def remembered(people: Sequence[Followed], seen: Mapping[int, SeenParts], found: int) -> dict[str, np.ndarray]:
    """As arrays.

    Args:
        people: Who may be seen in the next frame.
        seen: Hands and faces of the last frame, by the people's numbers.
        found: How many people there have been.
    """
    hands = [np.concatenate([_hand_row(one.hands[side]) for side in SIDES]) for one in seen.values()]
    return {
        "found": np.array(found),
        "number": np.array([person.number for person in people], int),
        "last": np.array([person.last for person in people], int),
        "body": _rows([_body_row(person.bodies[person.last]) for person in people]),
        "shown": np.array(list(seen), int),
        "hands": _rows(hands),
        "face": _rows([_face_row(one.face) for one in seen.values()]),
    }


def recalled(memory: Memory) -> tuple[list[Followed], dict[int, SeenParts], int]:
    """What `remembered` was given; of bodies only what says where to look."""
    rows = zip(*(memory[name].tolist() for name in ("number", "last")), memory["body"], strict=True)
    people = [Followed(number=number, bodies={last: _body(row)}) for number, last, row in rows]
    seen = {
        int(number): SeenParts(hands=dict(zip(SIDES, map(_hand, np.split(pair, 2)), strict=True)), face=_face(face))
        for number, pair, face in zip(*(memory[name] for name in ("shown", "hands", "face")), strict=True)
    }
    return people, seen, int(memory["found"])


def _rows(rows: list[np.ndarray]) -> np.ndarray:
    return np.stack(rows) if rows else np.zeros((0, 0))


def _square_row(square: Square) -> np.ndarray:
    return np.array([square.x, square.y, square.side, square.angle])


def _body_row(body: Body) -> np.ndarray:
    return np.concatenate([body.xy.ravel(), body.circle.ravel(), _square_row(body.square)])


def _body(row: np.ndarray) -> Body:
    count = 2 * blaze.COUNT
    nothing = np.zeros(blaze.COUNT)
    return Body(
        xy=row[:count].reshape(-1, 2),
        circle=row[count : count + 4].reshape(2, 2),
        square=Square(*row[count + 4 :].tolist()),
        visible=nothing,
        heat=nothing,
        spread=nothing,
        world=np.zeros((blaze.COUNT, 3)),
        score=1.0,
        silhouette=np.zeros((0, 0), np.float32),
    )


def _hand_row(hand: Hand | None) -> np.ndarray:
    if hand is None:
        return np.full(2 * hand_points.COUNT + 6, np.nan)
    return np.concatenate([hand.xy.ravel(), [hand.score, hand.right], _square_row(hand.square)])


def _hand(row: np.ndarray) -> Hand | None:
    count = 2 * hand_points.COUNT
    if np.isnan(row[0]):
        return None
    score, right, *square = row[count:].tolist()
    return Hand(xy=row[:count].reshape(-1, 2), score=score, right=right, square=Square(*square))


def _face_row(face: Face | None) -> np.ndarray:
    return np.full(2 * mesh.COUNT + 1, np.nan) if face is None else np.append(face.xy.ravel(), face.score)


def _face(row: np.ndarray) -> Face | None:
    return None if np.isnan(row[0]) else Face(xy=row[:-1].reshape(-1, 2), score=float(row[-1]))
