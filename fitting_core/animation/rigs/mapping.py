"""Which joints of a rig are which parts of a body: guessed, and checked before a motion is put on the rig."""

from collections.abc import Mapping
from itertools import pairwise

from fitting_core.animation.rigs.guessing import guessed
from fitting_core.animation.rigs.parts import CHAINS, NEEDED, PARTS, below, meant
from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError, some_of

Joints = Mapping[str, tuple[str, ...]]
"""By part, one of PARTS: the rig's joints for it, several for the chains. Parts that the rig lacks are missing."""
_NAMED = 30
"""Joints of a rig that a message names."""


def guess_joints(skeleton: Skeleton) -> dict[str, tuple[str, ...]]:
    """The mapping as the file states it, or as far as it can be guessed by names; see `guessing`."""
    if not skeleton.stated:
        return guessed(skeleton.offered)
    parts = guessed(skeleton.stated)
    return {part: tuple(skeleton.stated[bone] for bone in bones) for part, bones in parts.items()}


def check_joints(joints: Joints, skeleton: Skeleton) -> None:
    """Check that a mapping is usable. Raises InputError if a part or a joint is not known, a joint stands for two
    parts, a part that is needed is missing, or joints do not hang on each other as a body's do."""
    source = skeleton.source
    used: dict[str, str] = {}
    for part, names in joints.items():
        if part not in PARTS:
            raise InputError(f"{source}: {part!r} is no part of a body; expected some of {', '.join(PARTS)}.")
        if not names or (len(names) > 1 and part not in CHAINS):
            raise InputError(
                f"{source}: {part} has {len(names)} joints, expected one; only spine and neck have several."
            )
        for name in names:
            if name not in skeleton.names:
                raise InputError(
                    f"{source}: has no joint {name!r} for {part}; it has {some_of(skeleton.offered, most=_NAMED)}."
                )
            if skeleton.names.count(name) > 1:
                raise InputError(
                    f"{source}: has several joints {name!r}, one of which is wished for {part}. Rename them."
                )
            if name in used:
                raise InputError(f"{source}: the joint {name!r} stands for {used[name]} and for {part}; expected one.")
            used[name] = part
    if missing := [f"{part} ({meant(part)})" for part in NEEDED if part not in joints]:
        raise InputError(
            f"{source}: no joint stands for {', '.join(missing)}; choose from {some_of(skeleton.offered, most=_NAMED)}."
        )
    _check_tree(joints, skeleton)


def _check_tree(joints: Joints, skeleton: Skeleton) -> None:
    for part, names in joints.items():
        above = below(part) or ("pelvis" if part != "pelvis" else None)
        chain = [*(joints.get(above, ()) if above else ())[-1:], *names]
        for upper, lower in pairwise(chain):
            if not skeleton.is_below(skeleton.index(lower), skeleton.index(upper)):
                of = f" ({meant(above)})" if above and upper in joints[above] else ""
                raise InputError(
                    f"{skeleton.source}: {lower!r} ({meant(part)}) does not hang on {upper!r}{of} in the rig; choose "
                    "joints that do, or let it hang there in the program that made the rig."
                )
