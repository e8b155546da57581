"""All people tracked from frame to frame by optimal assignment, and their possible confusions.

Costs are squared distances relative to a person's reach: 1 is the limit. An unmatched one costs as much, so
that one sure match and one left out beat two doubtful ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.keypoints import BODY

OUT_OF_SIGHT = 1.0
"""Seconds after which an invisible person is no longer tracked; one who appears is new or returns (returning.py)."""
MOST_FOLLOWED = 300
"""Most at a time: the last seen. Without it, false detections all over each frame took 2 s per frame."""
_REACH, _REACH_GROWTH = 1.0, 1.5
"""In sizes of the person: how far keypoints may be from where they are expected, and more per second unseen."""
_MOVES_ON = 0.7
"""Seconds for which an invisible person is assumed to keep moving."""
_VELOCITY_SECONDS = 0.35
"""Period for a velocity: most of a step, so that a swinging limb does not look like one."""
_COMMON_POINTS = 4
"""With fewer keypoints in common, centres are compared, and scale and velocity are unknown."""
_SCALE = 0.35
"""Change of log scale that costs as much as a distance at the limit."""
_DOUBT, _DOUBT_UNSEEN = 0.6, 0.8
"""How much more an exchange must cost to be excluded, if both are seen, and if one is or was not."""
_BACK = 0.1
"""Cost of coming back: of two candidates in one place, the one seen in the last frame is likelier."""
_BRIEF = 0.5
"""Divided by the count of sightings, added to that: one who was seen once and then not was probably a false detection,
which would otherwise take over the person beside it."""
_NO_MATCH = 1.0
_NEVER = 1e6


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """A detection, with its centre and size."""

    entry: int
    """Its index in the frame's list of people."""
    body: Float[np.ndarray, "25 3"]
    centre: Float[np.ndarray, "2"]
    size: float
    """The weighted root mean square distance of the keypoints from their centre: about a quarter of the body height of
    an upright person. Distances are in units of it."""
    confidence: float

    @classmethod
    def of(cls, entry: int, points: Float[np.ndarray, "137 3"]) -> "Sighting":
        """The detection at an index of a frame's list."""
        # The body's points, or all where only hands or face were detected: 112 of 137 would outvote the body.
        used = points[BODY] if (points[BODY, 2] > 0).any() else points
        centre = np.average(used[:, :2], axis=0, weights=used[:, 2])
        squares = ((used[:, :2] - centre) ** 2).sum(1)
        size = float(np.sqrt(np.average(squares, weights=used[:, 2])))
        return cls(entry=entry, body=points[BODY], centre=centre, size=size, confidence=float(used[:, 2].mean()))

    @property
    def prominence(self) -> float:
        """Size times confidence."""
        return self.size * self.confidence


def sightings(frame: Float[np.ndarray, "P 137 3"]) -> list[Sighting]:
    """All people of a frame with any detection."""
    return [Sighting.of(entry, points) for entry, points in enumerate(frame) if (points[:, 2] > 0).any()]


@dataclass(eq=False)
class Track:
    """The track of one person."""

    sightings: dict[int, Sighting] = field(default_factory=dict)
    """By frame, in order."""
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    """Pixels per frame."""
    doubts: dict["Track", set[int]] = field(default_factory=dict)
    """Frames of possible confusion with another person."""

    @property
    def first(self) -> int:
        """Frame in which the person was seen first."""
        return next(iter(self.sightings))

    @property
    def last(self) -> int:
        """Frame in which the person was seen last."""
        return next(reversed(self.sightings))

    def add(self, frame: int, seen: Sighting, frame_rate: float) -> None:
        """Add this person's detection in a frame."""
        span = _VELOCITY_SECONDS * frame_rate
        for earlier in reversed(self.sightings):
            moved = _moved(self.sightings[earlier], seen)
            if moved is not None and frame - earlier <= max(2 * span, 2):
                self.velocity = moved / (frame - earlier)
            if frame - earlier >= span:
                break
        self.sightings[frame] = seen

    def doubt(self, other: "Track", frames: Sequence[int] | range) -> None:
        """Note that in these frames both could be swapped."""
        for one, two in ((self, other), (other, self)):
            one.doubts.setdefault(two, set()).update(frames)


def tracks_of(frames: Sequence[Sequence[Sighting]], frame_rate: float) -> list[Track]:
    """All people of a clip, in the order in which they appear.

    Args:
        frames: Who is seen in each frame.
        frame_rate: Frames per second.
    """
    everybody: list[Track] = []
    alive: list[Track] = []
    for frame, people in enumerate(frames):
        alive = [one for one in alive if frame - one.last <= max(OUT_OF_SIGHT * frame_rate, 2)]
        if len(alive) > MOST_FOLLOWED:
            alive = sorted(alive, key=lambda one: one.last)[-MOST_FOLLOWED:]
        new = _assign(frame, list(people), alive, frame_rate)
        everybody += new
        alive = [*alive, *new]
    return everybody


def _assign(frame: int, people: list[Sighting], alive: list[Track], frame_rate: float) -> list[Track]:
    """Assign a frame's people to those followed; returns the new ones."""
    if not people:
        return []
    prices, turned = _prices(frame, people, alive, frame_rate)
    place = optimal(prices)
    lost_at = [one.last for one in alive]
    new = []
    for k, seen in enumerate(people):
        if (j := place[k]) is None:
            new.append(Track())
            new[-1].add(frame, seen, frame_rate)
        else:
            alive[j].add(frame, seen, frame_rate)
    _note_doubts(
        frame, np.minimum(prices, turned), place, alive, lost_at, [k for k, j in enumerate(place) if j is None], new
    )
    return new


def optimal(prices: Float[np.ndarray, "P T"]) -> list[int | None]:
    """For each row, the matching column such that the total cost is least; None: unmatched, which costs 1.

    Args:
        prices: Infinite if the two cannot match.
    """
    from scipy.optimize import linear_sum_assignment  # the app need not wait for it

    rows, columns = prices.shape
    alone = np.where(np.eye(rows, dtype=bool), _NO_MATCH, _NEVER)
    table = np.concatenate([np.where(prices < _NEVER, prices, _NEVER), alone], axis=1)
    _, chosen = linear_sum_assignment(table)
    return [int(j) if j < columns else None for j in chosen]


def _note_doubts(
    frame: int,
    prices: Float[np.ndarray, "P T"],
    place: list[int | None],
    alive: list[Track],
    lost_at: list[int],
    unmatched: list[int],
    new: list[Track],
) -> None:
    taken = {j: k for k, j in enumerate(place) if j is not None}
    unseen = [frame - last > 1 for last in lost_at]
    for j, k in taken.items():
        own = prices[k, j]
        for i in np.flatnonzero(prices[k] < own + _NO_MATCH):
            if i == j:
                continue
            seen = taken.get(int(i))
            dearer = prices[k, i] - own + (0.0 if seen is None else prices[seen, j] - prices[seen, i])
            if dearer < (_DOUBT_UNSEEN if seen is None or unseen[j] or unseen[i] else _DOUBT):
                # A person who comes back may have been swapped at any time since.
                since = lost_at[j] if seen is None else min(lost_at[j], lost_at[i])
                alive[j].doubt(alive[i], range(since, frame + 1))
        for who, stranger in zip(unmatched, new, strict=True):
            if prices[who, j] - own < _DOUBT:
                alive[j].doubt(stranger, range(frame, frame + 1))


def _prices(
    frame: int, people: Sequence[Sighting], alive: Sequence[Track], frame_rate: float
) -> tuple[Float[np.ndarray, "P T"], Float[np.ndarray, "P T"]]:
    """How unlikely it is that people of a frame are those followed; infinite if impossible.

    First assuming that everybody kept moving, then that those not seen have stopped meanwhile, or turned round.
    """
    if not alive:
        return np.zeros((len(people), 0)), np.zeros((len(people), 0))
    passed = np.array([frame - one.last for one in alive])
    moving = np.minimum(passed, max(_MOVES_ON * frame_rate, 1))
    shifts = np.array([one.velocity for one in alive]) * moving[:, None]
    last = [one.sightings[one.last] for one in alive]
    back = _BACK + _BRIEF / np.array([len(one.sightings) for one in alive])
    reach = _REACH + _REACH_GROWTH * (passed - 1) / frame_rate

    def price(shifts: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, "P T"]:
        far, scale = apart(people, last, shifts)
        likely = (far / reach) ** 2 + (scale / _SCALE) ** 2 + np.where(passed > 1, back, 0.0)
        return np.where(far <= reach, likely, np.inf)

    moved = price(shifts)
    if (passed == 1).all():
        return moved, moved
    return moved, np.where(passed > 1, np.minimum(price(0 * shifts), price(-0.5 * shifts)), np.inf)


def apart(
    people: Sequence[Sighting], others: Sequence[Sighting], shifts: Float[np.ndarray, "T 2"]
) -> tuple[Float[np.ndarray, "P T"], Float[np.ndarray, "P T"]]:
    """Distances between sightings in sizes of the larger, and differences of log scale (0 if unknown).

    The median over common keypoints, which ignores those that a detector placed on a person in front.
    """
    a = np.array([one.body for one in people])[:, None]
    b = np.array([one.body for one in others])[None]
    both = (a[..., 2] > 0) & (b[..., 2] > 0)
    count = both.sum(-1)
    enough = count >= _COMMON_POINTS
    off = np.linalg.norm(a[..., :2] - b[..., :2] - shifts[:, None], axis=-1)
    of_points = _medians(off, both, count)
    centres = np.array([one.centre for one in people])[:, None] - [one.centre for one in others]
    of_centres = np.linalg.norm(centres - shifts, axis=-1)
    sizes = np.maximum.outer([one.size for one in people], [one.size for one in others])
    far = np.where(enough, of_points, of_centres) / np.maximum(sizes, 1e-9)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.log(_spread(a, both, count) / _spread(b, both, count))
    return far, np.where(enough & np.isfinite(scale), scale, 0.0)


def _medians(
    values: Float[np.ndarray, "P T 25"], there: Bool[np.ndarray, "P T 25"], count: Int[np.ndarray, "P T"]
) -> Float[np.ndarray, "P T"]:
    ordered = np.sort(np.where(there, values, np.inf), axis=-1)
    return np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]


def _spread(
    points: Float[np.ndarray, "*n 25 3"], both: Bool[np.ndarray, "P T 25"], count: Int[np.ndarray, "P T"]
) -> Float[np.ndarray, "P T"]:
    """Root mean square distance of the common points from their centre, pixels."""
    used = both[..., None] * points[..., :2]
    centre = used.sum(-2) / np.maximum(count, 1)[..., None]
    return np.sqrt((both * ((points[..., :2] - centre[..., None, :]) ** 2).sum(-1)).sum(-1) / np.maximum(count, 1))


def _moved(before: Sighting, after: Sighting) -> Float[np.ndarray, "2"] | None:
    """Median motion of common body points; None if they are too few."""
    both = (before.body[:, 2] > 0) & (after.body[:, 2] > 0)
    if both.sum() < _COMMON_POINTS:
        return None
    return np.median(after.body[both, :2] - before.body[both, :2], axis=0)
