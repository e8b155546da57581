"""Points of a body in space where a file has no pose of it: a body here is posed through them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.pairs import keypoint_points, vertex
from fitting_core.errors import InputError
from fitting_core.fit.through_points import KEYPOINTS, VERTICES, pose_through, spread_vertices


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenPoints:
    """Points of T frames in camera space, metres: keypoints of any body, or the vertices of a mesh."""

    keypoints: Float[np.ndarray, "T 137 3"] | None = None
    """NaN where there are none; the same in all frames."""
    vertices: Float[np.ndarray, "T V 3"] | None = None
    """Of SMPL-X's mesh."""

    def posed(self, body: BodyModel) -> tuple[BodyParams, str]:
        """A body through them, hands as 45 numbers over the mean hand; and what the user should know of it.

        Raises:
            InputError: They are vertices of another mesh than the body's.
        """
        if self.vertices is not None:
            return _through_vertices(body, self.vertices)
        assert self.keypoints is not None
        points = keypoint_points(body)[: kp.HANDS.stop]
        chosen = [i for i, point in enumerate(points) if point is not None]
        places = self.keypoints[:, chosen]
        found = pose_through(body, [point for point in points if point is not None], places, pull=KEYPOINTS)
        off = 1000 * float(np.median(found.off))
        return (
            found.params,
            f"It is of another body: the pose is one whose keypoints lie {off:.0f} mm off its (median).",
        )


def _through_vertices(body: BodyModel, vertices: Float[np.ndarray, "T V 3"]) -> tuple[BodyParams, str]:
    if len(body.template) != vertices.shape[1]:
        raise InputError(
            f"has meshes of {vertices.shape[1]} vertices and no poses, and the {body.kind} body here has "
            f"{len(body.template)}; expected the SMPL-X model that it was made with. Add it with `tcfit models add`"
        )
    chosen = spread_vertices(body)
    points = [vertex(i) for i in chosen]
    found = pose_through(body, points, vertices[:, chosen], pull=VERTICES, expression=True, one_shape=False)
    off = 1000 * float(found.off.max())
    return found.params, f"It has meshes and no poses: the poses were found by these, to {off:.2g} mm at worst."
