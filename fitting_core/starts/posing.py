"""A motion on a body: its file's pose, or one fitted to the keypoints in the file."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.pairs import keypoint_points
from fitting_core.fit.through_points import KEYPOINTS, pose_through
from fitting_core.io.motion.imported_motion import ImportedMotion


def posed_on(motion: ImportedMotion, body: BodyModel) -> ImportedMotion:
    """The motion with a pose of this body: its own, or if it has only keypoints, one fitted to these."""
    if motion.points is None:
        return motion.for_body(body)
    params, note = _through_keypoints(body, motion.points)
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
