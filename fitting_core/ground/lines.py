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
_ALONG_EDGE = np.linspace(-0.92, 0.92, 24)
"""Where grey values beside an edge are read: -1 is its begin, 1 its end."""
_ACROSS, _BESIDE = np.arange(-4.0, 4.1, 0.5), np.array([-2.0, 2.0])
"""Pixels to both sides of an edge, among which its step is looked for; and beside it."""
_PRECISION = 0.05
"""Pixels: deviation of an edge's curvature, as the height of its arc, at least."""


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


def share_seen(
    picture: UInt8[np.ndarray, "h w"], edges: Float[np.ndarray, "n 4"], elsewhere: UInt8[np.ndarray, "h w"]
) -> float:
    """Share of a picture's edges, by length, that another picture has in the same place; 0 without edges.

    Args:
        picture: Grey.
        edges: From `edges_of`.
        elsewhere: The other picture.
    """
    if not len(edges):
        return 0.0
    step, other = (np.diff(_beside(p, edges, _BESIDE).mean(1), axis=1)[:, 0] for p in (picture, elsewhere))
    seen = other * np.sign(step) > 0.5 * np.abs(step)
    return float(edge_lengths(edges[seen]).sum() / edge_lengths(edges).sum())


def bend_of(
    picture: UInt8[np.ndarray, "h w"], edges: Float[np.ndarray, "n 4"], center: tuple[float, float]
) -> tuple[float, float]:
    """How much the lens bends straight edges, and its standard deviation; 0 and infinity without edges.

    In the division model (A. Fitzgibbon, CVPR 2001) a point at radius r, in half diagonals of the picture, belongs at
    r / (1 + b r^2). An edge of length l that passes the centre at distance p then is an arc of height b p l^2 / 4. The
    bend is the weighted median over all edges: some of them are round. The deviation is at least by how much a half of
    the picture disagrees: sagging shutter slats gave a bend of -0.36.

    Args:
        picture: Grey.
        edges: From `edges_of`.
        center: Its principal point, pixels.
    """
    if not len(edges):
        return 0.0, np.inf
    grey = _beside(picture, edges, _ACROSS)
    step = grey[..., 4:] - grey[..., :-4]
    step = np.maximum(step * np.sign(step.sum((1, 2), keepdims=True)), 0) ** 2 + 1e-6
    off = (step * _ACROSS[2:-2]).sum(-1) / step.sum(-1)
    arc = np.stack([np.ones_like(_ALONG_EDGE), _ALONG_EDGE, 1 - _ALONG_EDGE**2], 1)
    heights = np.linalg.pinv(arc)
    fitted = off @ heights.T
    noise = (off - fitted @ arc.T).std(1) * np.linalg.norm(heights[2]) + _PRECISION
    length, passing = edge_lengths(edges), ((edges[:, :2] + edges[:, 2:]) / 2 - center) * _across(edges)
    lever = -passing.sum(1) * (length / np.hypot(*picture.shape)) ** 2
    lever[np.abs(lever) < 1e-6] = 1e-6
    middle = (edges[:, :2] + edges[:, 2:]) / 2 < center
    halves = [half for near in middle.T for half in (near, ~near) if half.any()]
    bend, deviation = _median_bend(fitted[:, 2], lever, noise)
    parts = [_median_bend(fitted[half, 2], lever[half], noise[half]) for half in halves]
    return bend, max(deviation, *(abs(other - bend) - unsure for other, unsure in parts))


def _median_bend(
    height: Float[np.ndarray, "n"], lever: Float[np.ndarray, "n"], noise: Float[np.ndarray, "n"]
) -> tuple[float, float]:
    """The weighted median of heights over levers, and its standard deviation."""
    bends, weight = height / lever, np.abs(lever) / noise
    order = np.argsort(bends)
    bend = float(bends[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)])
    scatter = np.median(np.abs(height - bend * lever) / noise) / 0.6745
    return bend, float(np.sqrt(np.pi / 2) * scatter / np.linalg.norm(weight))


def _across(edges: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 2"]:
    """Unit normals of edges in the picture."""
    x, y = (edges[:, 2:] - edges[:, :2]).T
    return np.stack([-y, x], 1) / np.hypot(x, y)[:, None]


def _beside(
    picture: UInt8[np.ndarray, "h w"], edges: Float[np.ndarray, "n 4"], off: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "n 24 k"]:
    """Grey values along edges, at some distances in pixels to their sides."""
    begin, along = edges[:, None, :2], edges[:, None, 2:] - edges[:, None, :2]
    points = begin + (1 + _ALONG_EDGE[:, None]) / 2 * along
    points = (points[:, :, None] + off[:, None] * _across(edges)[:, None, None] - 0.5).astype(np.float32)
    x, y = np.moveaxis(points.reshape(len(edges), -1, 2), -1, 0)
    grey = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return grey.reshape(points.shape[:3]).astype(float)


def unbent(
    edges: Float[np.ndarray, "n 4"], bend: float, center: tuple[float, float], size: tuple[int, int]
) -> Float[np.ndarray, "n 4"]:
    """Edges as a lens without distortion shows them.

    Args:
        edges: Of a picture.
        bend: From `bend_of`.
        center: The picture's principal point, pixels.
        size: Its width and height, pixels.
    """
    ends = edges.reshape(-1, 2) - center
    radius = np.linalg.norm(ends, axis=1, keepdims=True) / (0.5 * np.hypot(*size))
    return (ends / (1 + bend * radius**2) + center).reshape(-1, 4)


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
