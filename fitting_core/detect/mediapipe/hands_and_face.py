"""Hands and face of a person whose body is known: from the neighbouring frame, the body, and detectors of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.face import Face, FaceNetwork, square_at_head, square_of_found
from fitting_core.detect.mediapipe.hands import WRISTS, Hand, HandNetwork, different, square_at_wrist, square_of_palm
from fitting_core.detect.mediapipe.single_shot import SingleShot
from fitting_core.detect.mediapipe.squares import Image, Square
from fitting_core.keypoints import SIDES, Side

KEPT = 0.1
"""Hands of a lower score are dropped; those up to a sure one are reported with little confidence."""
_FOUND, _WELL_FOUND = 0.5, 0.8
"""Score of a hand from which it is followed, and from which nothing else is tried."""
_REACH = 0.06
"""How far a hand's wrist may be from the body's, in sides of the body's square, at no loss; at twice this it is not
its hand."""
_MARGIN = 0.05
"""Sides of the body's square by which a wrist may be outside the image while its hand is looked for."""
_SEARCH_EVERY = 3
"""Frames between two searches for a hand that was not there in the frame before, or is not seen well: they take most
of the time where hands are out of sight, and what they find is followed forwards and backwards."""
_ROOM = 0.35
"""Least side, in sides of the body's square, in which a palm is searched for."""


@dataclass(kw_only=True)
class SeenParts:
    """Hands and face of a person in a frame."""

    hands: dict[Side, Hand | None] = field(default_factory=lambda: dict.fromkeys(SIDES))
    face: Face | None = None


class PartsFinder:
    """Finds hands and faces.

    Args:
        mirrored: Look at each hand mirrored as well.
        threads: Of onnxruntime.
    """

    def __init__(self, *, mirrored: bool, threads: int = 1) -> None:
        self._hands, self._face = HandNetwork(mirrored=mirrored, threads=threads), FaceNetwork(threads=threads)
        self._palms, self._faces = SingleShot("palm", threads=threads), SingleShot("face", threads=threads)

    def find(self, image: Image, body: Body, before: SeenParts | None, t: int) -> SeenParts:
        """Hands and face in a frame.

        Args:
            image: RGB.
            body: Of the person.
            before: What the frame before shows; None: nothing is known of it.
            t: The frame's number.
        """
        return SeenParts(
            hands=self._find_hands(image, body, before or SeenParts(), search=before is None or t % _SEARCH_EVERY == 0),
            face=self._find_face(image, body, before.face if before else None),
        )

    def improve(self, image: Image, body: Body, seen: SeenParts, after: SeenParts) -> None:
        """Take hands and a face that the next frame knows better into what a frame shows."""
        near = [
            hand.next_square
            for side in _weak(seen.hands)
            if (hand := after.hands[side]) is not None and hand.score > max(_FOUND, _score(seen.hands[side]))
        ]
        if near:
            own = [hand for hand in seen.hands.values() if hand is not None]
            seen.hands = assigned([*own, *self._hands.follow(image, near, least=KEPT)], body)
        if seen.face is None and after.face is not None:
            seen.face = self._follow_face(image, body, after.face)

    def _find_hands(self, image: Image, body: Body, before: SeenParts, *, search: bool) -> dict[Side, Hand | None]:
        tracked = [hand.next_square for hand in before.hands.values() if hand is not None and hand.score > _FOUND]
        pool = self._hands.follow(image, tracked, least=KEPT)
        result = assigned(pool, body)
        squares: list[Square] = []
        for side in _weak(result):
            lost = side not in _weak(before.hands) or _score(before.hands[side]) > _FOUND >= _score(result[side])
            wrist, margin = body.xy[WRISTS[side]], _MARGIN * body.square.side
            inside = (wrist > -margin).all() and (wrist < np.array(image.shape[1::-1]) + margin).all()
            if inside and (lost or search):
                squares += self.candidates(image, body, side)
        return assigned([*pool, *self._hands.find(image, squares, least=KEPT)], body) if squares else result

    def candidates(self, image: Image, body: Body, side: Side) -> list[Square]:
        """Squares in which a hand may be, by the body's wrist and by palms around it."""
        wide = square_at_wrist(body, side)
        room = Square(wide.x, wide.y, max(2 * wide.side, _ROOM * body.square.side))
        palms = [square_of_palm(found) for found in self._palms.find(image, room)[:2]]
        return [self._hands.nearer(image, wide), replace(wide, side=0.75 * wide.side), *palms]

    def hands_at(self, image: Image, squares: Sequence[Square], *, least: float) -> list[Hand]:
        """The different hands that some squares show."""
        return self._hands.find(image, squares, least=least)

    def hands_in(self, image: Image, room: Square, *, least: float = KEPT) -> list[Hand]:
        """All hands in a square of an image."""
        palms = [square_of_palm(found) for found in self._palms.find(image, room, threshold=0.2)]
        return self._hands.find(image, [room, self._hands.nearer(image, room), *palms], least=least)

    def _find_face(self, image: Image, body: Body, before: Face | None) -> Face | None:
        return (before and self._follow_face(image, body, before)) or self.face_in(image, square_at_head(body))

    def _follow_face(self, image: Image, body: Body, known: Face) -> Face | None:
        """The face of a neighbouring frame; None if it is not found, or not at the body's head.

        If the head has moved by a quarter of its height, the network reports a face in the former place with certainty.
        """
        face = self._face.find(image, [known.next_square])
        return face if face is not None and face.is_at_head(body) else None

    def face_in(self, image: Image, room: Square) -> Face | None:
        """A face in a square of an image."""
        squares = [square_of_found(found) for found in self._faces.find(image, room)[:1]]
        face = self._face.find(image, [*squares, replace(room, side=0.6 * room.side)])
        return None if face is None else self._face.find(image, [face.next_square]) or face


def _score(hand: Hand | None) -> float:
    return 0.0 if hand is None else hand.score


def _weak(hands: dict[Side, Hand | None]) -> list[Side]:
    """The sides whose hand was not found well."""
    return [side for side in SIDES if (hand := hands[side]) is None or hand.looks(side) < _WELL_FOUND]


def assigned(hands: Sequence[Hand], body: Body) -> dict[Side, Hand | None]:
    """A hand for each side, so that their worth is largest together; no hand for both."""
    choices = [None, *different(hands)]

    def worth(hand: Hand | None, side: Side) -> float:
        return 0.0 if hand is None else worth_of(hand, side, body)

    pairs = [(left, right) for left in choices for right in choices if left is None or left is not right]
    best = max(pairs, key=lambda pair: sum(worth(hand, side) for hand, side in zip(pair, SIDES, strict=True)))
    return {side: hand if worth(hand, side) >= KEPT / 2 else None for side, hand in zip(SIDES, best, strict=True)}


def worth_of(hand: Hand, side: Side, body: Body) -> float:
    """Its score, less where it is far from the body's wrist or looks like one of the other side."""
    gap = float(np.linalg.norm(hand.xy[0] - body.xy[WRISTS[side]])) / body.square.side
    return hand.looks(side) * float(np.clip(2 - gap / _REACH, 0, 1))
