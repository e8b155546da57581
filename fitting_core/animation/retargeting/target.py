"""A rig to put a motion on: its joints at rest, and which of SMPL-X's joints drive them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.model import JOINT


@dataclass(frozen=True)
class Source:
    """What drives a joint of a rig: one of SMPL-X's joints, or a blend of two."""

    joint: str
    other: str = ""
    share: float = 0.0
    """Of the other one, 0 to 1."""
    twist: float = 1.0
    """Below 1: that share of the turn about its own bone against the joint above, and nothing else. See `retarget`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Target:
    """K joints at rest, parents before children."""

    names: tuple[str, ...]
    parents: Int[np.ndarray, "K"]
    """-1 for roots."""
    places: Float[np.ndarray, "K 3"]
    """In the rig's world and unit."""
    turns: Float[np.ndarray, "K 3 3"]
    """Rotations of the joints' axes into the rig's world."""
    sources: tuple[Source | None, ...]
    """None: it follows its parent."""
    rest: Float[np.ndarray, "55 3 3"]
    """How SMPL-X's joints are turned, from their rest pose into the rig's world, when that body stands as the rig does
    at rest."""
    upright: Float[np.ndarray, "3 3"]
    """Rotation of the y-up world into the rig's."""
    scale: float
    """Of the rig's unit to metres, times its legs' length to the person's."""
    floor: float
    """Height of the rig's ground at rest, along its up axis, in its unit."""
    root: int
    """The joint that has a position in each frame: the pelvis."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def up(self) -> Float[np.ndarray, "3"]:
        """The unit vector against gravity in the rig's world."""
        return self.upright[:, 1]

    @cached_property
    def of_joint(self) -> dict[str, int]:
        """By the name of a joint of SMPL-X, the rig's joint that has its turn: of a chain, the last one that has it."""
        found: dict[str, int] = {}
        for k, source in enumerate(self.sources):
            if source is not None and source.twist == 1.0:
                found[source.other if source.share == 1.0 else source.joint] = k
        return found

    def anchor(self, joint: str, parents: np.ndarray) -> tuple[int, int]:
        """The rig's joint that a joint of SMPL-X is nearest to, and that joint of SMPL-X, or one above it."""
        names, j = list(JOINT), JOINT[joint]
        while names[j] not in self.of_joint and parents[j] >= 0:
            j = int(parents[j])
        return self.of_joint.get(names[j], self.root), j

    def placed(
        self, moved: Float[np.ndarray, "T K 3 3"], root: Float[np.ndarray, "T 3"], base: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "T K 3"]:
        """Where the joints are, when each is turned so from its rest.

        Args:
            moved: Turns from rest in the rig's world.
            root: Where the pelvis is.
            base: How far what is above the pelvis is from its rest.
        """
        places = np.broadcast_to(self.places + base, (len(moved), len(self), 3)).copy()
        for k in self.order_below_root:
            if k == self.root:
                places[:, k] = root
            else:
                p = self.parents[k]
                places[:, k] = places[:, p] + moved[:, p] @ (self.places[k] - self.places[p])
        return places

    @cached_property
    def order_below_root(self) -> tuple[int, ...]:
        """The pelvis and its descendants, parents first."""
        inside = [self.root]
        for k in range(len(self)):
            if self.parents[k] in inside:
                inside.append(k)
        return tuple(inside)
