"""Anatomical axes of the body's segments: where x, y and z of each lie in the rest pose.

Axes as the International Society of Biomechanics has them: x forward, y up, z to the right, for a person who stands
upright with hanging arms and palms forward, on the left side as on the right. Sources: Wu et al., J. Biomech. 35 (2002)
543 (ankle, hip, spine); Wu et al., J. Biomech. 38 (2005) 981 (shoulder, elbow, wrist); Grood & Suntay, J. Biomech. Eng.
105 (1983) 136 (knee). The long axes of the limbs run through the joint centres of the shaped rest pose, as there. Where
the recommendations take landmarks that a body model does not have, its rest pose says what they would:

- pelvis, thorax, head: upright in the rest pose. ISB's planes through the spines of the pelvis and through breastbone
  and vertebrae are tilted by some degrees in a person who stands so, and by other degrees in each person.
- knee, ankle: the epicondyles and malleoli lie beside each other in the rest pose, whose knees bend straight back.
- elbow, forearm: the T-pose's elbows bend forward, and its palms look down, halfway between supination and pronation.
- hand: the heads of the metacarpals lie in its plane.
"""

import numpy as np
from jaxtyping import Float

from fitting_core.body.geometry import frame
from fitting_core.body.model import JOINT

_LIMBS = ("thigh", "shank", "foot", "toes", "humerus", "forearm", "hand")
BONES = {"pelvis": "pelvis", "thorax": "spine3", "head": "head"} | {
    f"{side}_{segment}": f"{side}_{joint}"
    for side in ("left", "right")
    for segment, joint in zip(_LIMBS, ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist"), strict=True)
}
"""By segment: the joint that moves it."""
_UP, _FORWARD, _RIGHT = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])
"""In the rest pose's frame."""
_UPRIGHT = np.stack([_FORWARD, _UP, _RIGHT], -1)


def rest_axes(places: Float[np.ndarray, "T 55 3"]) -> dict[str, Float[np.ndarray, "T 3 3"]]:
    """By segment: the anatomical axes as columns in the rest pose's frame (x to the left, y up, z forward).

    Args:
        places: Joints of shaped bodies at rest, metres, or of their limbs the anatomical centres.
    """
    found = {name: np.broadcast_to(_UPRIGHT, (len(places), 3, 3)) for name in BONES}  # those that no joint tells
    for side, sign in (("left", -1.0), ("right", 1.0)):
        hip, knee, ankle, shoulder, elbow, wrist, middle, index, pinky = (
            places[:, JOINT[f"{side}_{name}"]]
            for name in "hip knee ankle shoulder elbow wrist middle1 index1 pinky1".split()
        )
        found[f"{side}_thigh"] = _along(hip - knee, _RIGHT)
        found[f"{side}_shank"] = _along(knee - ankle, _RIGHT)
        # The upper arm's z is the axis of the elbow, upright in the T-pose. Those of the right forearm and hand run to
        # the thumb, and of the left ones away from it: both to the right where arms hang and palms look forward.
        found[f"{side}_humerus"] = _along(shoulder - elbow, sign * _UP)
        found[f"{side}_forearm"] = forearm = _along(elbow - wrist, sign * _FORWARD)
        has_fingers = np.linalg.norm(index - pinky, axis=-1) > 1e-6  # SMPL's lie in the wrist
        found[f"{side}_hand"] = hand = forearm.copy()
        hand[has_fingers] = _along((wrist - middle)[has_fingers], sign * (index - pinky)[has_fingers])
    return found


def _along(up: Float[np.ndarray, "T 3"], right: Float[np.ndarray, "*T 3"]) -> Float[np.ndarray, "T 3 3"]:
    """Axes whose y runs along `up`, and whose z is `right` made orthogonal to it."""
    y, z, x = np.moveaxis(frame(up, np.broadcast_to(right, up.shape)), -1, 0)
    return np.stack([x, y, z], -1)
