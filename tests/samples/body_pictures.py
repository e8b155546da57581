"""Bodies and skeletons drawn from the same place, for benchmarks: the worst of a set, and how poses look."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.mesh import Mesh
from fitting_core.body.params import BodyParams
from fitting_core.render.renderer import DEFAULT_COLOR, Renderer
from fitting_core.render.sheets import Cell, Image, View, beside

_MARGIN = 1.1
_SUBPIXEL_BITS = 4
_BONE_WIDTH = 0.035  # metres


def fitted_views(
    points: Float[np.ndarray, "N 3"],
    degrees: Sequence[float],
    *,
    size: tuple[int, int] = (240, 320),
    extent: float | None = None,
) -> list[View]:
    """Views from several sides in one scale, with the points in the middle.

    Args:
        points: What must be seen.
        degrees: One for each view; see View, as for `size`.
        extent: Metres of the shorter side; by default as few as show all points in all views.
    """
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    views = [View(center=tuple(center), extent=1.0, degrees=angle, size=size) for angle in degrees]
    if extent is None:
        aspect = np.array(size) / min(size)
        spread = max(float((abs(view.camera_space(points)[:, :2]) / aspect).max()) for view in views)
        extent = _MARGIN * 2 * spread
    return [replace(view, extent=extent) for view in views]


def body_picture(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    view: View,
    *,
    color: tuple[float, float, float] = DEFAULT_COLOR,
) -> Image:
    """A mesh (the body's world, metres) over white."""
    return Renderer(view.camera).render(view.camera_space(vertices), faces, color=color)


def skeleton_picture(
    positions: Float[np.ndarray, "J 3"],
    parents: Int[np.ndarray, "J"],
    view: View,
    *,
    colors: Sequence[tuple[int, int, int]] | None = None,
) -> Image:
    """Bones as thick lines over white, the near over the far.

    Args:
        positions: Joints in the body's world, metres.
        parents: Parent of each joint; -1 where no bone ends.
        view: Where to look from.
        colors: sRGB of the bone that ends at each joint.
    """
    picture = np.full((view.size[1], view.size[0], 3), 255, np.uint8)
    at = np.round(view.pixels(positions) * 2**_SUBPIXEL_BITS).astype(int)
    depth = view.camera_space(positions)[:, 2]
    bones = [joint for joint, parent in enumerate(parents) if parent >= 0]
    thick = max(1, round(_BONE_WIDTH / view.extent * min(view.size)))
    for joint in sorted(bones, key=lambda j: -(depth[j] + depth[parents[j]])):
        ends = tuple(map(int, at[parents[joint]])), tuple(map(int, at[joint]))
        cv2.line(picture, *ends, (255, 255, 255), thick + 2, cv2.LINE_AA, _SUBPIXEL_BITS)
        color = (90, 90, 90) if colors is None else colors[joint]
        cv2.line(picture, *ends, color, thick, cv2.LINE_AA, _SUBPIXEL_BITS)
    return picture


def pose_cells(
    mesh: Mesh,
    params: BodyParams,
    captions: Sequence[str],
    *,
    degrees: Sequence[float] = (0.0, 90.0),
    size: tuple[int, int] = (240, 320),
    extent: float | None = None,
) -> list[Cell]:
    """One cell for each pose, with the body as seen from each of `degrees` side by side.

    Args:
        mesh: The body.
        params: The poses. Their "camera space" is the body's world here: y up, facing +z without orientation.
        captions: One for each pose.
        degrees: See View.
        size: Pixels of one view.
        extent: Metres of every view's shorter side; by default each body is as large as its views show it whole.
    """
    assert len(captions) == len(params)
    cells = []
    for vertices, caption in zip(mesh(params).double().cpu().numpy(), captions, strict=True):
        views = fitted_views(vertices, degrees, size=size, extent=extent)
        pictures = [body_picture(vertices, mesh.body.faces, view) for view in views]
        cells.append(Cell(picture=beside(pictures), caption=caption))
    return cells
