"""The body's segments as biomechanics sees them: an anatomical frame in each, fixed to the bone of the body model.

Which axes these are: see `body.segment_axes`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.markers.joint_centres import with_joint_centres
from fitting_core.body.model import JOINT
from fitting_core.body.segment_axes import BONES, rest_axes
from fitting_core.motion import Motion, rest_joints

MIRROR_SIDES = np.diag([1.0, 1.0, -1.0])
"""Turns a rotation between two anatomical frames into that of the other side of the body, M R M."""


@dataclass(frozen=True)
class Segments:
    """Anatomical frames of a motion of T frames."""

    motion: Motion
    """In any world."""

    @cached_property
    def axes(self) -> dict[str, Float[np.ndarray, "T 3 3"]]:
        """By segment: x, y and z as columns, in the world of the motion."""
        motion = self.motion
        world, _ = pose_joints(Tree.of(motion.body.parents), rotations.exp(motion.pose), motion.rest_joints)
        at_rest = rest_axes(rest_joints(with_joint_centres(motion.body), motion.params).numpy())
        return {name: world[:, JOINT[BONES[name]]].numpy() @ axes for name, axes in at_rest.items()}

    def between(self, parent: str, child: str) -> Float[np.ndarray, "T 3 3"]:
        """The rotation of one segment against another, by its columns: the child's axes in the parent's frame.

        That of a left joint is mirrored into that of a right one, so that both have the same signs.
        """
        turned = self.axes[parent].swapaxes(-1, -2) @ self.axes[child]
        return MIRROR_SIDES @ turned @ MIRROR_SIDES if child.startswith("left") else turned
