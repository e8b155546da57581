"""BlazePose: 33 points of the body in a square, where to look in the next frame, and the silhouette.

Bazarevsky et al. 2020 (arXiv:2006.10204). Where the network is sure, its points are refined in its heat map. Pictures
shown plain and mirrored agree with each other less where the network guesses: `spread` is how far they lie apart.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32

from fitting_core.detect.mediapipe.networks import Network
from fitting_core.detect.mediapipe.squares import Image, Square, picture, turn_from

COUNT = 33
(
    NOSE, LEFT_EYE, RIGHT_EYE, LEFT_EAR, RIGHT_EAR, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ELBOW, RIGHT_ELBOW,
    LEFT_WRIST, RIGHT_WRIST, LEFT_PINKY, RIGHT_PINKY, LEFT_INDEX, RIGHT_INDEX, LEFT_HIP, RIGHT_HIP, LEFT_KNEE,
    RIGHT_KNEE, LEFT_ANKLE, RIGHT_ANKLE, LEFT_HEEL, RIGHT_HEEL, LEFT_TOE, RIGHT_TOE,
) = (0, 2, 5, 7, 8, *range(11, 21), *range(23, 33))  # fmt: skip
"""Places of BlazePose's points, as its model card lists them; the eyes' middles are meant."""

SCALE = 1.1
"""Of the square around the body (MediaPipe: 1.25): a nearer one is more exact, until limbs leave it."""
SURE = 0.5
"""Score from which there is a body."""

_SIZE, _ALL = 256, 39
_OUTPUTS = ("Identity", "Identity_1", "Identity_2", "Identity_3", "Identity_4")
"""Landmarks, score, silhouette, heat maps and points in metres."""
_MIRRORED = np.array([0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9, *(i + (1 if i % 2 else -1) for i in range(11, COUNT))])
_RADIUS, _LEAST_HEAT = 3, 0.5
"""Cells around a point in which it is refined, and the height of the heat map from which it is."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """The body in a square of an image."""

    xy: Float[np.ndarray, "33 2"]
    """Pixels of the image."""
    visible: Float[np.ndarray, "33"]
    """0 to 1, from the network; unreliable for parts that the picture cuts off."""
    heat: Float[np.ndarray, "33"]
    """Height of the heat map, 0 to 1."""
    spread: Float[np.ndarray, "33"]
    """Pixels between the points of the plain and the mirrored picture; 0 where only one was shown."""
    world: Float[np.ndarray, "33 3"]
    """Metres about the hips, in the image's axes: x right, y down, z away. Good for directions on the body, not as a
    pose (91 mm)."""
    score: float
    """That there is a body, 0 to 1."""
    circle: Float[np.ndarray, "2 2"]
    """Middle of the hips, and a point on the circle around the body; pixels of the image."""
    square: Square
    """The square of the image."""
    silhouette: Float32[np.ndarray, "256 256"]
    """Of that square, 0 to 1."""

    @property
    def next_square(self) -> Square:
        """Where to look for the same person."""
        return square_of(self.circle)


def square_of(circle: Float[np.ndarray, "2 2"]) -> Square:
    """Around a body, from the middle of its hips and a point on the circle around it."""
    side = 2 * float(np.linalg.norm(circle[1] - circle[0]))
    turn = turn_from(circle[0], circle[1], should_be=90)
    return Square(float(circle[0, 0]), float(circle[0, 1]), side, turn).scaled(SCALE)


class BodyNetwork:
    """Finds the points of one body in a square.

    Args:
        size: "full" or "heavy".
        mirrored: Show each picture mirrored as well, and take the mean.
        threads: Of onnxruntime.
    """

    def __init__(self, size: str, *, mirrored: bool, threads: int = 1) -> None:
        self._network = Network(f"pose_landmark_{size}", outputs=_OUTPUTS, threads=threads)
        # At the same time as the plain picture: two cores are more than half idle otherwise.
        self._mirrored = ThreadPoolExecutor(1, "tcfit: mirrored bodies") if mirrored else None

    def __call__(self, image: Image, square: Square) -> Body:
        """The body in a square of an RGB image; `score` says whether there is one."""
        shown = picture(image, square, _SIZE)
        if self._mirrored is None:
            return self._seen(shown, square, False)
        mirrored = self._mirrored.submit(self._seen, np.ascontiguousarray(shown[:, ::-1]), square, True)
        return _mean(self._seen(shown, square, False), mirrored.result())

    def _seen(self, shown: Float32[np.ndarray, "256 256 3"], square: Square, flip: bool) -> Body:
        return _body([output[0] for output in self._network(shown[None])], square, flip)


def _body(outputs: list[np.ndarray], square: Square, flip: bool) -> Body:
    landmarks, score, silhouette, heat_maps, metres = outputs
    numbers = landmarks.reshape(_ALL, 5).astype(float)
    xy, heat = refined(numbers[:, :2], heat_maps)
    visible, world, order = _sigmoid(numbers[:, 3]), metres.reshape(_ALL, 3)[:COUNT].astype(float), np.arange(COUNT)
    silhouette = _sigmoid(silhouette[..., 0])
    if flip:
        xy, world, order = np.stack([_SIZE - xy[:, 0], xy[:, 1]], -1), world * [-1, 1, 1], _MIRRORED
        silhouette = silhouette[:, ::-1]
    c, s = np.cos(square.angle), np.sin(square.angle)
    points = square.to_image(xy, _SIZE)
    return Body(
        xy=points[:COUNT][order],
        visible=visible[:COUNT][order],
        heat=heat[:COUNT][order],
        spread=np.zeros(COUNT),
        world=(world @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))[order],
        score=float(np.ravel(score)[0]),
        circle=points[COUNT : COUNT + 2],
        square=square,
        silhouette=silhouette,
    )


def _mean(plain: Body, mirrored: Body) -> Body:
    def mean(name: str) -> np.ndarray:
        return (getattr(plain, name) + getattr(mirrored, name)) / 2

    names = ("xy", "visible", "heat", "world", "circle", "silhouette")
    spread = np.linalg.norm(plain.xy - mirrored.xy, axis=1)
    return replace(plain, **{name: mean(name) for name in names}, spread=spread, score=float(mean("score")))


def refined(
    xy: Float[np.ndarray, "n 2"], heat: Float32[np.ndarray, "h h n"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """Points moved to the centre of mass of the heat map around them where it is high enough, and its height there.

    Args:
        xy: Pixels of the network's picture.
        heat: Logits of its cells.
    """
    side, (columns, rows) = heat.shape[0], (xy.T / _SIZE * heat.shape[0]).astype(int)
    inside = (columns >= 0) & (columns < side) & (rows >= 0) & (rows < side)
    steps = np.arange(-_RADIUS, _RADIUS + 1)
    # Beyond its border the map is as low as can be.
    padded = np.pad(heat, ((_RADIUS, _RADIUS), (_RADIUS, _RADIUS), (0, 0)), constant_values=-60)
    own = np.flatnonzero(inside)
    down, across = rows[own, None] + _RADIUS + steps, columns[own, None] + _RADIUS + steps
    parts = _sigmoid(padded[down[:, :, None], across[:, None, :], own[:, None, None]].astype(float))
    found, heights = xy.copy(), np.zeros(len(xy))
    heights[own] = parts.max((1, 2))
    sure = heights[own] >= _LEAST_HEAT
    mass = parts.sum((1, 2))[:, None]
    moved = np.stack([(parts.sum(1) * steps).sum(1), (parts.sum(2) * steps).sum(1)], -1) / mass
    cells = np.stack([columns, rows], -1)[own] + moved
    found[own[sure]] = cells[sure] * _SIZE / side
    return found, heights


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-np.clip(x, -60, 60)))
