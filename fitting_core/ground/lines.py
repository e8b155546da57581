"""Focal length and up direction of a still camera from the straight edges in its pictures.

Most edges of rooms and streets run along three directions at right angles, one of them vertical (a "Manhattan world",
Coughlan and Yuille, Neural Computation 15, 2003). An edge and the camera's centre span a plane, whose normal n is at a
right angle to the edge's direction d: n . d = 0. Normals depend on the focal length, and with a wrong one no three
directions suit many edges. Camera axes are x right, y down, z away.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from fitting_core.ground.gravity import Gravity

_SHORTEST = 0.025
"""Of an edge, as a share of the picture's longer side: shorter ones say little."""
_MOST_EDGES = 250
_LEAST_VERTICAL = 8
"""Edges near the vertical below which they do not tell it."""
POSSIBLE_FOCALS = np.geomspace(0.55, 2.2, 25)
"""Focal lengths that are distinguished, in units of the picture's longer side: 35 mm equivalents of 20 to 80 mm."""
_OFF_VERTICAL, _OFF = 0.3, 0.8
"""Degrees: standard deviations of an edge's angle to the vertical, and to any of the three directions."""
_UNIT_VERTICAL, _UNIT = 0.02, 0.03
"""Share of the edges' length worth one unit of log likelihood: edges of one wall are not independent."""
_OF_VERTICAL = 0.006
"""Weight of the vertical's log posterior beside the share of edges along three directions."""
_STEP, _FARTHEST = 0.5, 20.0
"""Degrees: step and radius of the search for the vertical."""
_CANDIDATES, _APART = 14, 0.9
"""Verticals that are tried with each focal length, and degrees between two of them."""
_HEADINGS = np.radians(np.arange(0.0, 90.0, 1.0))
_ALONG = 2.0
"""Standard deviations within which an edge runs along a direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LineEvidence:
    """What the edges say of each of F focal lengths."""

    focals: Float[np.ndarray, "F"]
    """Pixels."""
    log_likelihood: Float[np.ndarray, "F"]
    """Up to a constant."""
    ups: Float[np.ndarray, "F 3"]
    """Against gravity, if that is the focal length: unit vectors in camera axes."""
    deviations: Float[np.ndarray, "F"]
    """Standard deviations of these directions, degrees."""


def edges_of(picture: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "n 4"]:
    """The longest straight edges of a grey picture, longest first: from x, y to x, y in pixels."""
    found = cv2.createLineSegmentDetector().detect(picture)[0]
    edges = np.zeros((0, 4)) if found is None else found.reshape(-1, 4).astype(float)
    length = edge_lengths(edges)
    longest = np.argsort(-length)[:_MOST_EDGES]
    return edges[longest[length[longest] > _SHORTEST * max(picture.shape)]]


def edge_lengths(edges: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n"]:
    """Pixels."""
    return np.hypot(*(edges[:, 2:] - edges[:, :2]).T)


def line_evidence(
    edges: Float[np.ndarray, "n 4"], focals: Float[np.ndarray, "F"], center: tuple[float, float], gravity: Gravity
) -> LineEvidence | None:
    """What straight edges say of the focal length and of the vertical.

    Args:
        edges: From `edges_of`, of a picture without distortion.
        focals: Focal lengths that are distinguished, pixels.
        center: Its principal point, pixels.
        gravity: The vertical as known otherwise; it is searched for around this one.

    Returns:
        None where too few edges are near the vertical.
    """
    lengths = edge_lengths(edges)
    found = [_with_focal(_normals(edges, focal, center), lengths, gravity) for focal in focals]
    known = [(focal, *one) for focal, one in zip(focals, found, strict=True) if one is not None]
    if not known:
        return None
    focals, score, ups, deviations = (np.array(column) for column in zip(*known, strict=True))
    return LineEvidence(focals=focals, log_likelihood=score / _UNIT, ups=ups, deviations=deviations)


def along_three(
    edges: Float[np.ndarray, "n 4"], focal: float, center: tuple[float, float], up: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "n"]:
    """Which edges run along the vertical or one of two level directions at right angles, at the best heading.

    Args:
        edges: From `edges_of`, of a picture without distortion.
        focal: Of its camera, pixels.
        center: Its principal point, pixels.
        up: Against gravity: unit vector in camera axes.
    """
    off = _off_three(_normals(edges, focal, center), up)
    return off[_agreement(off, edge_lengths(edges)).argmax()] < _ALONG


def _normals(edges: Float[np.ndarray, "n 4"], focal: float, center: tuple[float, float]) -> Float[np.ndarray, "n 3"]:
    """Unit normals of the planes through the camera's centre and the edges."""
    begin, end = (
        np.concatenate([(edges[:, at : at + 2] - center) / focal, np.ones((len(edges), 1))], 1) for at in (0, 2)
    )
    normals = np.cross(begin, end)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _with_focal(
    normals: Float[np.ndarray, "n 3"], lengths: Float[np.ndarray, "n"], gravity: Gravity
) -> tuple[float, Float[np.ndarray, "3"], float] | None:
    """Share of the edges along three directions, the vertical among them, and its standard deviation in degrees."""
    possible = _verticals(normals, lengths, gravity)
    if possible is None:
        return None
    ups, log_posterior = possible
    tried = _apart(ups, log_posterior)
    scores = np.array([_share(normals, lengths, ups[i]) + _OF_VERTICAL * log_posterior[i] for i in tried])
    best = int(np.argmax(scores))
    weight = np.exp((scores - scores[best]) / _UNIT)
    off = np.degrees(np.arccos(np.clip(ups[tried] @ ups[tried[best]], -1, 1)))
    deviation = float(np.hypot(_APART / 2, np.sqrt((weight * off**2).sum() / weight.sum())))
    return float(scores[best]), ups[tried[best]], deviation


def _verticals(
    normals: Float[np.ndarray, "n 3"], lengths: Float[np.ndarray, "n"], gravity: Gravity
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m"]] | None:
    """Directions near the stated one, and their log posterior: the share of the near-vertical edges that point there,
    and the stated direction's normal distribution. None if there are too few such edges."""
    up, deviation = gravity.up, gravity.deviation
    near = np.abs(normals @ up) < np.sin(np.radians(min(3.5 * deviation, _FARTHEST)))
    if near.sum() < _LEAST_VERTICAL:
        return None
    one = np.cross(up, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one)
    radius = min(3 * deviation, _FARTHEST)
    steps = np.arange(-radius, radius + 0.1, _STEP)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    ups = up + np.tan(np.radians(a))[:, None] * one + np.tan(np.radians(b))[:, None] * np.cross(up, one)
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    off = np.degrees(np.abs(ups @ normals[near].T)) / _OFF_VERTICAL
    share = np.exp(-0.5 * off**2) @ lengths[near] / lengths[near].sum()
    return ups, share / _UNIT_VERTICAL - 0.5 * (a**2 + b**2) / deviation**2


def _apart(ups: Float[np.ndarray, "m 3"], log_posterior: Float[np.ndarray, "m"]) -> list[int]:
    """The likeliest directions that are apart."""
    chosen: list[int] = []
    for i in np.argsort(-log_posterior)[:600]:
        if (ups[chosen] @ ups[i] < np.cos(np.radians(_APART))).all():
            chosen.append(int(i))
        if len(chosen) == _CANDIDATES:
            break
    return chosen


def _share(normals: Float[np.ndarray, "n 3"], lengths: Float[np.ndarray, "n"], up: Float[np.ndarray, "3"]) -> float:
    """Share of the edges' length along up or two level directions at right angles, at the best heading."""
    return float(_agreement(_off_three(normals, up), lengths).max() / lengths.sum())


def _agreement(off: Float[np.ndarray, "H n"], lengths: Float[np.ndarray, "n"]) -> Float[np.ndarray, "H"]:
    """The length of the edges that run along a direction, by heading."""
    return np.exp(-0.5 * off**2) @ lengths


def _off_three(normals: Float[np.ndarray, "n 3"], up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "H n"]:
    """Angles to the nearest of up and two level directions, by heading, in standard deviations."""
    one = np.cross(up, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one)
    other = np.cross(up, one)
    c, s = np.cos(_HEADINGS)[:, None], np.sin(_HEADINGS)[:, None]
    sines = np.minimum(np.abs((c * one + s * other) @ normals.T), np.abs((c * other - s * one) @ normals.T))
    sines = np.minimum(sines, np.abs(normals @ up))
    return np.degrees(np.arcsin(np.clip(sines, 0, 1))) / _OFF
