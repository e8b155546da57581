"""How far away the camera of another view stands from a fit's camera.

Relations hold for a person of average height; a fit's person has a height of its own, and its distance from the camera
follows from that and the focal length. So the translation is scaled such that the fit lies on the other view's rays.
"""

import numpy as np
from jaxtyping import Float

from fitting_core.clip import OtherView
from fitting_core.fit.views.track import Track

_FEWEST = 20
"""Keypoints that determine the scale, at least."""


def scale_of(view: OtherView, points: Float[np.ndarray, "T 25 3"], times: Float[np.ndarray, "T"]) -> float:
    """The factor on the relation's translation; 1 if too little tells.

    A point X lies on the ray d of the other view if d x (R X + s t) = 0, which each keypoint solves for s by least
    squares; the median of them, each as sure as s moves it across the ray.

    Args:
        view: Related to the fit's clip.
        points: The fit's BODY_25 keypoints in camera space, metres, NaN for missing ones.
        times: Of these frames, seconds.
    """
    relation = view.relation
    assert relation is not None
    rays, confidence, _ = Track(view.clip, view.times).at(times + relation.offset)
    rays, there = rays[:, :25], (confidence[:, :25] > 0) & np.isfinite(points).all(-1)
    if there.sum() < _FEWEST:
        return 1.0
    turned = np.cross(rays[there], points[there] @ relation.turn.T)
    moved = np.cross(rays[there], relation.shift)
    weight = (moved * moved).sum(-1)
    found = -(turned * moved).sum(-1) / np.maximum(weight, 1e-9)
    ranked = np.argsort(found)
    order = np.cumsum(weight[ranked])
    scale = float(found[ranked][np.searchsorted(order, order[-1] / 2)])
    return scale if scale > 0 else 1.0
