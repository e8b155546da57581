"""A skeleton as in a file: names, parents and the rest pose of its joints."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fitting_core.errors import InputError

_UNEVEN = 1e-3
"""Share by which the scale of a joint's axes may differ: more would shear what hangs on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeleton:
    """J joints, parents first."""

    names: tuple[str, ...]
    parents: Int[np.ndarray, "J"]
    """-1 for roots."""
    local: Float[np.ndarray, "J 4 4"]
    """The rest pose: each joint in its parent's axes, a root in the world, in the file's own unit."""
    offered: tuple[str, ...]
    """Names of those that may be chosen: all joints of a BVH, the joints of a glTF's skins."""
    stated: Mapping[str, str] = field(default_factory=dict)
    """Of a VRM, which says what its joints are: by VRM's name of a bone, the joint's; parents first."""
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

    def turns(self, moved: Iterable[int]) -> Float[np.ndarray, "J 3 3"]:
        """How joints are turned at rest: rotations into the world. Raises InputError if the axes of one are not as long
        as each other, or mirrored.

        Args:
            moved: Those that will move. They count, and what they hang on; all others are taken as not turned, since a
                prop in the scene may be scaled as it likes.
        """
        turns = np.tile(np.eye(3), (len(self), 1, 1))
        for k in sorted({above for joint in moved for above in self._and_above(joint)}):
            axes = self.world[k, :3, :3]
            sizes, turned = np.linalg.norm(axes, axis=0), np.linalg.det(axes)
            if turned <= 0 or np.ptp(sizes) > _UNEVEN * sizes.max():
                scale = ", ".join(f"{size:.3g}" for size in sizes) + " and mirrored" * bool(turned < 0)
                raise InputError(
                    f"{self.source}: the axes of {self.names[k]!r} are scaled by {scale}; "
                    "expected one scale for all three. Apply the scale in the program that made the rig, and export it "
                    "again."
                )
            turns[k] = axes / sizes.mean()
        return turns

    def index(self, name: str) -> int:
        """The joint with a name; the first of several."""
        return self.names.index(name)

    def is_below(self, joint: int, other: int) -> bool:
        """Whether a joint is a descendant of another."""
        return joint != other and other in self._and_above(joint)

    def _and_above(self, joint: int) -> Iterator[int]:
        """A joint and its ancestors."""
        while joint >= 0:
            yield joint
            joint = int(self.parents[joint])
