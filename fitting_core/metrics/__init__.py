"""How good and how smooth a fit is, as the field measures it: arithmetic on arrays of points.

What needs whole meshes is beside it: `evaluation.volume`, `evaluation.surface_error`.
"""

from fitting_core.metrics.alignment import Similarity, procrustes, rooted, similarity
from fitting_core.metrics.joints import depth_error, mpjpe, pa_mpjpe, point_error
from fitting_core.metrics.posture import lean, torso_lean, wrists_in_front
from fitting_core.metrics.reprojection import frame_means, heights_in_image, reprojection_errors
from fitting_core.metrics.smoothness import acceleration, acceleration_error, depth_jitter, jerk, jitter
from fitting_core.metrics.variation import bone_length_variation, shape_variation

__all__ = [
    "Similarity",
    "acceleration",
    "acceleration_error",
    "bone_length_variation",
    "depth_error",
    "depth_jitter",
    "frame_means",
    "heights_in_image",
    "jerk",
    "jitter",
    "lean",
    "mpjpe",
    "pa_mpjpe",
    "point_error",
    "procrustes",
    "reprojection_errors",
    "rooted",
    "shape_variation",
    "similarity",
    "torso_lean",
    "wrists_in_front",
]
