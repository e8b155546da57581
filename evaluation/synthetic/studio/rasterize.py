"""A small software renderer: triangles into a depth buffer, in numpy, with no OpenGL and the same result everywhere."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fitting_core.camera import Camera


@dataclass(frozen=True, kw_only=True, eq=False)
class Fragments:
    """The pixels that a mesh covers, each with the triangle nearest to the camera there."""

    pixel: Int[np.ndarray, "P"]
    """Index into the flattened image (row by row); twice where two triangles are equally near, as on an edge."""
    depth: Float[np.ndarray, "P"]
    """Distance along z, metres."""
    face: Int[np.ndarray, "P"]
    weights: Float[np.ndarray, "P 3"]
    """Of the face's corners, correct in perspective; they sum to 1."""

    def interpolate(self, faces: Int[np.ndarray, "F 3"], values: Float[np.ndarray, "V D"]) -> Float[np.ndarray, "P D"]:
        """Values of vertices at the pixels."""
        corners = faces[self.face].T
        a, b, c = (values[corner] * weight[:, None] for corner, weight in zip(corners, self.weights.T, strict=True))
        return a + b + c


def rasterize(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], camera: Camera, depth: Float[np.ndarray, "H W"]
) -> Fragments:
    """Draw a mesh into a depth buffer (in place) and return the pixels where it came out in front.

    Args:
        vertices: Camera space: x right, y down, z away, metres; all in front of the camera.
        faces: Corners counter-clockwise as seen from outside; faces seen from behind are left out.
        camera: Its size is the buffer's.
        depth: Infinite where nothing is yet. A pixel's middle is at half coordinates.
    """
    width, height = camera.size
    xy = (vertices[:, :2] / vertices[:, 2:] * camera.focal + camera.center)[faces]
    low = np.maximum(np.ceil(xy.min(1) - 0.5).astype(int), 0)
    high = np.minimum(np.floor(xy.max(1) - 0.5).astype(int), [width - 1, height - 1])
    # Boxes of even size: a quarter of the sizes, for a few pixels tried in vain.
    span = np.where(high >= low, high - low + 2 & ~1, 0)
    low = np.minimum(low, np.array([width, height]) - span)
    area = _cross(xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0])
    # In an image whose y points down, a face that looks at the camera runs clockwise: negative here is from outside.
    shown = np.flatnonzero((area < -1e-9) & (span > 0).all(1))
    # Triangles whose boxes have one size are tried together, so that no index is built for the pixels to try.
    shown = shown[np.lexsort(span[shown].T)]
    cuts = np.flatnonzero(np.diff(span[shown], axis=0).any(1)) + 1
    parts = [_cover(xy, low, span[group[0]], group, width) for group in np.split(shown, cuts) if len(group)]
    if not parts:
        return _NOTHING
    pixel, face, shares = (np.concatenate(part) for part in zip(*parts, strict=True))
    # 1 / z is linear in the image; so are the weights divided by z.
    over_z = shares / area[face, None] / vertices[:, 2][faces[face]]
    inverse = over_z[:, 0] + over_z[:, 1] + over_z[:, 2]
    z = 1 / inverse
    flat = depth.reshape(-1)
    np.minimum.at(flat, pixel, z)
    front = np.flatnonzero(flat[pixel] == z)
    weights = over_z[front] / inverse[front, None]
    return Fragments(pixel=pixel[front], depth=z[front], face=face[front], weights=weights)


_NOTHING = Fragments(pixel=np.zeros(0, int), depth=np.zeros(0), face=np.zeros(0, int), weights=np.zeros((0, 3)))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _cover(
    xy: Float[np.ndarray, "F 3 2"],
    low: Int[np.ndarray, "F 2"],
    span: Int[np.ndarray, "2"],
    group: np.ndarray,
    width: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels whose middle lies in the triangles of a group with boxes of one size: index, triangle, corners' areas."""
    corners = (xy[group] - (low[group, None] + 0.5)).astype(np.float32)
    following, last = corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]
    # Twice the area of (point, following, last) is linear in the point: constant + dx x + dy y.
    constant = _cross(following, last)
    dx, dy = following[..., 1] - last[..., 1], last[..., 0] - following[..., 0]
    along = constant[..., None] + dx[..., None] * np.arange(span[0], dtype=np.float32)
    shares = along[:, :, None] + dy[..., None, None] * np.arange(span[1], dtype=np.float32)[:, None]
    triangle, y, x = np.nonzero(shares.max(1) <= 0)
    face = group[triangle]
    return (low[face, 1] + y) * width + low[face, 0] + x, face, shares[triangle, :, y, x]
