"""Exports onto rigs. What writes them is imported when it is used: pygltflib takes 0.4 s of every start of the app."""

from collections.abc import Callable
from pathlib import Path

from fitting_core.motion import Progress
from tcfit_app.exports.source import ExportSource

Write = Callable[[ExportSource, Path, Progress], None]
_CENTIMETRES = 100.0
"""Of a metre: what BVHs of Mixamo and Unreal are in."""


def on_glb(rig: str) -> Write:
    """What writes the person on a rig, by its name in `known_rigs`."""

    def write(source: ExportSource, path: Path, progress: Progress) -> None:
        from fitting_core.animation import known_rigs
        from fitting_core.io.motion import rig_glb

        rig_glb.write_standard_glb(path, source.motion("y-up"), getattr(known_rigs, rig), progress)

    return write


def on_bvh(rig: str) -> Write:
    """What writes the skeleton of a rig, by its name in `known_rigs`."""

    def write(source: ExportSource, path: Path, progress: Progress) -> None:
        from fitting_core.animation import animated, known_rigs
        from fitting_core.io.motion import rig_bvh

        motion = source.motion("y-up")
        moving = animated.on_standard(motion, getattr(known_rigs, rig))
        rig_bvh.write_rig_bvh(path, moving, motion.frame_rate, unit=_CENTIMETRES, progress=progress)

    return write


def write_avatar(source: ExportSource, path: Path, progress: Progress) -> None:
    """The person as VRM."""
    from fitting_core.io.motion.vrm import write_vrm

    write_vrm(path, source.motion("y-up"), progress)


def write_avatar_motion(source: ExportSource, path: Path, progress: Progress) -> None:
    """The motion as VRM animation."""
    from fitting_core.io.motion.vrm import write_vrm_animation

    write_vrm_animation(path, source.motion("y-up"), progress)
