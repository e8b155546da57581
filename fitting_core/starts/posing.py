"""A motion on a body: its file's pose, or one fitted to the points in the file."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.pairs import keypoint_points, vertex
from fitting_core.errors import InputError
from fitting_core.fit.through_points import KEYPOINTS, VERTICES, pose_through, spread_vertices
from fitting_core.io.motion.imported_motion import ImportedMotion


def posed_on(motion: ImportedMotion, body: BodyModel) -> ImportedMotion:
    """The motion with a pose of this body: its own, or if it has only points, one fitted to these. Raises InputError if
    it has meshes and no pose, and this body has another mesh."""
    points = motion.points
    if points is None:
        return motion.for_body(body)
    if points.vertices is None:
        assert points.keypoints is not None
        params, note = _through_keypoints(body, points.keypoints)
    elif points.vertices.shape[1] == len(body.template):
        params, note = _through_vertices(body, points.vertices)
    else:
        raise InputError(
            f"{motion.source}: has meshes of {points.vertices.shape[1]} vertices and no poses, and the {body.kind} "
            f"body here has {len(body.template)}; expected the SMPL-X model that it was made with. Add it with "
            "`tcfit models add`."
        )
    own = {"kind": body.kind, "gender": body.gender, "body_hash": body.hash}
    return replace(motion, params=params, points=None, whole_hands=False, notes=(*motion.notes, note), **own)


def _through_keypoints(body: BodyModel, keypoints: Float[np.ndarray, "T 137 3"]) -> tuple[BodyParams, str]:
    """Hands as 45 numbers over the mean hand; and what the user should know of it."""
    points = keypoint_points(body)[: kp.HANDS.stop]
    chosen = [i for i, point in enumerate(points) if point is not None]
    found = pose_through(
        body, [point for point in points if point is not None], keypoints[:, chosen], regularisation=KEYPOINTS
    )
    off = 1000 * float(np.median(found.off))
    return found.params, f"It is of another body: the pose is one whose keypoints lie {off:.0f} mm off its (median)."


def _through_vertices(body: BodyModel, vertices: Float[np.ndarray, "T V 3"]) -> tuple[BodyParams, str]:
    chosen = spread_vertices(body)
    points = [vertex(i) for i in chosen]
    found = pose_through(body, points, vertices[:, chosen], regularisation=VERTICES, expression=True, one_shape=False)
    off = 1000 * float(found.off.max())
    return found.params, f"It has meshes and no poses: the poses were found by these, to {off:.2g} mm at worst."
