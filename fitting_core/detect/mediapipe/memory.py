"""What following a person, the hands and the face needs of the last frame, as arrays: a detection can go on from it."""

from collections.abc import Mapping, Sequence

import numpy as np

from fitting_core.detect.mediapipe import body as blaze
from fitting_core.detect.mediapipe import face as mesh
from fitting_core.detect.mediapipe import hands as hand_points
from fitting_core.detect.mediapipe.body import Body
from fitting_core.detect.mediapipe.face import Face
from fitting_core.detect.mediapipe.following import Followed
from fitting_core.detect.mediapipe.hands import SIDES, Hand
from fitting_core.detect.mediapipe.hands_and_face import SeenParts
from fitting_core.detect.mediapipe.squares import Square

Memory = Mapping[str, np.ndarray]


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
    """What `remembered` was given; of bodies only what tells where to look."""
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
