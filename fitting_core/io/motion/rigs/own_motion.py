"""A motion on the user's own rig: turned from rest to rest, then onto the floor, then hands to where they touch."""

from fitting_core.io.motion.fitted_motion import Motion
from fitting_core.io.motion.rigs.mapping import RigMapping, read_skeleton
from fitting_core.io.motion.rigs.own_rig import own_target
from fitting_core.io.motion.rigs.retargeting.feet import grounded
from fitting_core.io.motion.rigs.retargeting.retarget import Posed, RigMotion, turned
from fitting_core.io.motion.rigs.retargeting.touch import touches, touching
from fitting_core.io.motion.rigs.skeleton import Skeleton


def on_own(motion: Motion, mapping: RigMapping, skeleton: Skeleton | None = None) -> RigMotion:
    """A motion on a rig with its own lengths, in its own world and unit.

    Raises:
        InputError: The rig cannot be read, or its rest pose is none that a body can have.
    """
    upright = motion.in_axes("y-up").one_shape
    posed, body = Posed.of(upright), upright.shaped_body
    rig = read_skeleton(mapping.skeleton) if skeleton is None else skeleton
    moving = grounded(turned(posed, own_target(rig, mapping.joints, body)), posed, upright)
    return touching(moving, posed, touches(upright), body.parents, upright.frame_rate)
