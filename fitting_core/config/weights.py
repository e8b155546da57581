"""The weights of all terms, which their files in `fit/terms/` name; imports no torch."""

from dataclasses import dataclass, replace

Five = tuple[float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights by stage 1 to 5. A term's coefficient is the square of its weight; 0 switches it off.

    The defaults are the paper's table.
    """

    body_keypoints: Five = (1.0, 1.0, 1.0, 1.0, 1.0)
    """BODY_25 keypoints in the data term."""
    hand_keypoints: Five = (0.0, 0.0, 0.0, 0.1, 2.0)
    """Hand keypoints in the data term."""
    face_keypoints: Five = (0.0, 0.0, 0.0, 0.0, 2.0)
    """Face keypoints in the data term."""
    relative_position: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Depth of body keypoints, and the whole position of undetected ones, relative to the pelvis against the lifter's,
    per standard deviation (beyond the paper)."""
    held_position: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Standing feet, in phase 3, against the place where they stand, per standard deviation (beyond the paper)."""
    body_pose: Five = (404.0, 404.0, 57.4, 4.78, 4.78)
    """Body pose prior."""
    hand_pose: Five = (404.0, 404.0, 57.4, 4.78, 4.78)
    """L2 of the hand components."""
    jaw_open: Five = (63.6, 63.6, 24.0, 6.9, 6.9)
    """Jaw about its x axis."""
    jaw_sideways: Five = (201.0, 201.0, 75.7, 21.9, 21.9)
    """Jaw about its y and z axes."""
    expression: Five = (100.0, 50.0, 10.0, 5.0, 5.0)
    """L2 of the expression."""
    shape: Five = (100.0, 50.0, 10.0, 5.0, 5.0)
    """L2 of betas; in phase 2 also of the shared betas."""
    bending: Five = (35.8, 35.8, 13.5, 3.9, 3.9)
    """Exponential penalty on elbows and knees that bend the wrong way."""
    lean: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Lean of the root against the image's vertical, if no leg is seen (beyond the paper)."""
    turn: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Turn of the root away from the camera, if no leg is seen (beyond the paper)."""
    limits: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Joints of body and fingers beyond their anatomical range, per radian (beyond the paper)."""
    rest: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Distance of joints without evidence in the image from the prior's neutral pose (beyond the paper)."""
    collision: Five = (0.0, 0.0, 0.0, 0.1, 1.0)
    """Self-intersection of the mesh."""


PAPER = Weights()
SMPLIFYX = replace(
    PAPER,
    jaw_open=(4040.0, 4040.0, 574.0, 47.8, 47.8),
    jaw_sideways=(40400.0, 40400.0, 5740.0, 478.0, 478.0),
)
TCFIT = replace(
    PAPER,
    # 68 landmarks at weight 2 outvoted the body: betas fitted the face's proportions and made a signer's body thin
    # (beta 3 at -1.0 instead of -0.3); reprojection is the same.
    face_keypoints=(0.0, 0.0, 0.0, 0.0, 0.5),
    # Lifter and standing feet reduce PA-MPJPE by a fifth and MPJPE by a quarter (evaluation/RESULTS/motion_suite.md).
    # More weight biases people who move unlike the lifter's training data.
    relative_position=(6.0, 6.0, 6.0, 6.0, 6.0),
    held_position=(10.0, 10.0, 10.0, 10.0, 10.0),
    # Limits cover it: PA-MPJPE with and without 65.7 and 65.8, 56.0 and 55.8 mm on two views.
    bending=(0.0, 0.0, 0.0, 0.0, 0.0),
    lean=(30.0, 30.0, 30.0, 30.0, 30.0),
    turn=(15.0, 15.0, 15.0, 15.0, 15.0),
    limits=(100.0, 100.0, 100.0, 100.0, 100.0),
    rest=(0.0, 0.0, 0.0, 15.0, 15.0),
    collision=(0.0, 0.0, 0.0, 0.0, 0.0),
)
