"""How a body stands before the camera: for footage of people who are known to be upright, and have no reference."""

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.body.model import JOINT


def lean(up: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T"]:
    """Angle between a body's up axis and the image's vertical (y down), in degrees."""
    cosine = -up[:, 1] / np.linalg.norm(up, axis=-1)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))


def torso_lean(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, "T"]:
    """Angle in degrees between the line from the middle of the hip joints to the neck joint and the image's vertical.

    Not the root's axis: a root may lean where the spine bends it back, and a straight root under a bent spine is no
    upright person.

    Args:
        joints: SMPL-X's joints in camera space (y down).
    """
    hips = joints[:, [JOINT["left_hip"], JOINT["right_hip"]]].mean(1)
    return lean(joints[:, JOINT["neck"]] - hips)


def wrists_in_front(joints: Float[np.ndarray, "T 55 3"]) -> Bool[np.ndarray, "T 2"]:
    """Whether the left and the right wrist are nearer to the camera than the chest (joint spine3).

    For people who face the camera and sign: hands inside or behind the trunk show a depth that the image did not hold.

    Args:
        joints: SMPL-X's joints in camera space (z away from the camera).
    """
    wrists = joints[:, [JOINT["left_wrist"], JOINT["right_wrist"]], 2]
    return wrists < joints[:, JOINT["spine3"], 2, None]
