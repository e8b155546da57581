"""A captured clip: a skeleton in its own joints, as world rotations and positions over time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fitting_core.errors import InputError


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """A tree of joints in its rest pose."""

    joints: tuple[str, ...]
    parents: Int[np.ndarray, "J"]
    """Parent of each joint, -1 for the root; parents come first."""
    offsets: Float[np.ndarray, "J 3"]
    """From the parent to the joint in the rest pose, metres; zero for the root."""

    def index(self, joint: str) -> int:
        """Number of a joint.

        Raises:
            InputError: There is no joint of that name.
        """
        if joint not in self.joints:
            raise InputError(f"A captured skeleton has no joint {joint}, only {', '.join(self.joints)}. Copy it again.")
        return self.joints.index(joint)


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceMotion:
    """One captured clip."""

    name: str
    subject: str
    source: str
    """Which of READERS it came from."""
    fps: float
    description: str
    skeleton: Skeleton
    rotations: Float[np.ndarray, "T J 3 3"]
    """World rotation of each joint against the rest pose."""
    positions: Float[np.ndarray, "T J 3"]
    """World, metres."""

    def __len__(self) -> int:
        return len(self.rotations)

    def world(self, joint: str) -> Float[np.ndarray, "T 3 3"]:
        """World rotations of one joint."""
        return self.rotations[:, self.skeleton.index(joint)]
