"""A skeleton as a file has it: names, parents and the rest pose of its joints."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fitting_core.errors import InputError

_UNEVEN = 1e-3
"""Share by which the scale of a joint's axes may differ: more would shear what hangs on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """J joints in an order in which every parent stands before its children."""

    names: tuple[str, ...]
    parents: Int[np.ndarray, "J"]
    """-1 for roots."""
    local: Float[np.ndarray, "J 4 4"]
    """The rest pose: each joint in its parent's axes, a root in the world, in the file's own unit."""
    offered: tuple[str, ...]
    """Names of those that may be chosen: all joints of a BVH, the joints of a glTF's skins."""
    source: str = ""
    """The file, for messages."""

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def world(self) -> Float[np.ndarray, "J 4 4"]:
        """The rest pose in the world."""
        world = self.local.copy()
        for j in range(len(self)):
            if self.parents[j] >= 0:
                world[j] = world[self.parents[j]] @ self.local[j]
        return world

    @property
    def places(self) -> Float[np.ndarray, "J 3"]:
        """Where the joints are at rest."""
        return self.world[:, :3, 3]

    @cached_property
    def scales(self) -> Float[np.ndarray, "J"]:
        """How much each joint's axes are longer than the world's.

        Raises:
            InputError: They are not as long as each other, or mirrored.
        """
        axes = self.world[:, :3, :3]
        lengths = np.linalg.norm(axes, axis=1)
        for name, sizes, turned in zip(self.names, lengths, np.linalg.det(axes), strict=True):
            if turned <= 0 or np.ptp(sizes) > _UNEVEN * sizes.max():
                scale = ", ".join(f"{size:.3g}" for size in sizes) + " and mirrored" * bool(turned < 0)
                raise InputError(
                    f"{self.source}: the axes of {name!r} are scaled by {scale}; "
                    "expected one scale for all three. Apply the scale in the program that made the rig, and export it "
                    "again."
                )
        return lengths.mean(1)

    @property
    def turns(self) -> Float[np.ndarray, "J 3 3"]:
        """How the joints are turned at rest: rotations into the world. Raises InputError as `scales`."""
        return self.world[:, :3, :3] / self.scales[:, None, None]

    def index(self, name: str) -> int:
        """Which joint has a name; the first of several."""
        return self.names.index(name)

    def is_below(self, joint: int, other: int) -> bool:
        """Whether a joint hangs on another one, directly or not."""
        while joint >= 0:
            joint = int(self.parents[joint])
            if joint == other:
                return True
        return False
