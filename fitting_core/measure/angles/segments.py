"""The body's segments as biomechanics sees them: an anatomical frame in each, fixed to the bone of the body model.

Which axes these are: see `body.segment_axes`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fitting_core.body import rotations
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import JOINT
from fitting_core.body.segment_axes import BONES, rest_axes
from fitting_core.motion import Motion

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
        world, at_rest = self._posed[0], rest_axes(self.motion.rest_joints.numpy())
        return {name: world[:, JOINT[BONES[name]]] @ axes for name, axes in at_rest.items()}

    @cached_property
    def joints(self) -> Float[np.ndarray, "T 55 3"]:
        """The joints in the world, metres, double precision."""
        return self._posed[1] + self.motion.params.camera_translation.double().numpy()[:, None]

    @cached_property
    def _posed(self) -> tuple[Float[np.ndarray, "T 55 3 3"], Float[np.ndarray, "T 55 3"]]:
        motion = self.motion
        world, joints = pose_joints(Tree.of(motion.body.parents), rotations.exp(motion.pose), motion.rest_joints)
        return world.numpy(), joints.numpy()

    def between(self, parent: str, child: str) -> Float[np.ndarray, "T 3 3"]:
        """The rotation of one segment against another, by its columns: the child's axes in the parent's frame.

        That of a left joint is mirrored into that of a right one, so that both have the same signs.
        """
        turned = self.axes[parent].swapaxes(-1, -2) @ self.axes[child]
        return MIRROR_SIDES @ turned @ MIRROR_SIDES if child.startswith("left") else turned
