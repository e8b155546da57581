"""The motion of a fit, and writing it to files for other programs, chosen by suffix."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath
from fitting_core.ground.level import level_of
from fitting_core.io.result_files import StoredFit
from fitting_core.motion import Motion
from fitting_core.results.fit_result import FitResult


@dataclass(frozen=True, kw_only=True)
class MotionFile:
    """A format that holds a motion in one file."""

    axes: str
    """A name of AXES: the world that programs which read the format expect."""
    writer: str
    """Module and name of a function from path and motion, imported when it is used."""

    def write(self, path: Path, motion: Motion) -> None:
        """Write it, in the motion's own axes."""
        module, name = self.writer.split(":")
        write: Callable[[Path, Motion], object] = getattr(import_module(f"fitting_core.io.motion.{module}"), name)
        write(path, motion)


MOTION_FILES = {
    ".glb": MotionFile(axes="y-up", writer="glb:write_glb"),
    ".bvh": MotionFile(axes="y-up", writer="bvh:write_bvh"),
    ".npz": MotionFile(axes="z-up", writer="animation_npz:write_animation_npz"),
}
"""By suffix: a skinned character, a skeleton, and SMPL-X's keys as AMASS has them."""


def motion_of(fit: FitResult, clip: Clip, body: BodyModel, *, phase: int | None = None) -> Motion:
    """The fitted motion in camera space, for measuring or export.

    Args:
        fit: The result.
        clip: What was fitted.
        body: With which body.
        phase: 1 to 3; None: the last.

    Raises:
        InputError: The fit has no such phase.
    """
    chosen = fit.chosen(phase)
    return Motion(
        body=body,
        params=chosen.params,
        error_bars=chosen.error_bars,
        camera=fit.camera,
        frame_rate=clip.frame_rate,
        name=clip.name,
        first_frame=clip.first_frame,
        contacts=None if fit.grounding is None else fit.grounding.contacts,
        level=level_of(fit.grounding, fit.camera.world),
    )


def stored_motion(fit: StoredFit, body: BodyModel, *, name: str, phase: int | None = None) -> Motion:
    """The same, for a result read from its file.

    Args:
        fit: What `read_fit` has read.
        body: The one it was fitted with: `fit.body_kind` and `fit.gender` say which.
        name: Of the clip.
        phase: 1, or the last; None: the last.

    Raises:
        InputError: The file does not hold that phase, or the body is another one.
    """
    if fit.body_hash not in ("", body.hash):
        raise InputError(
            f"The result is of the {fit.gender} {fit.body_kind} body whose file's SHA-256 begins "
            f"{fit.body_hash[:12]}; this body's begins {body.hash[:12]}. Give the one that it was fitted with."
        )
    if phase not in (None, 1, fit.last_phase):
        raise InputError(f"The result has phases 1 and {fit.last_phase}, but not {phase}.")
    return Motion(
        body=body,
        params=fit.phase1 if phase == 1 else fit.params,
        error_bars=None if phase == 1 else fit.error_bars,
        camera=fit.camera,
        frame_rate=fit.frame_rate,
        name=name,
        first_frame=fit.first_frame,
        contacts=None if fit.grounding is None else fit.grounding.contacts,
        level=level_of(fit.grounding, fit.camera.world),
    )


def write_motion(path: StrPath, motion: Motion, *, axes: str | None = None) -> None:
    """Write a motion to one file, atomically; an existing file is replaced.

    Args:
        path: Its ending is one of MOTION_FILES.
        motion: In any axes.
        axes: A name of AXES, or OWN_WORLD; None: what programs that read the format expect.

    Raises:
        InputError: The ending or the axes are unknown, or the file cannot be written.
    """
    path = Path(path)
    form = MOTION_FILES.get(path.suffix.lower())
    if form is None:
        raise InputError(f"{path}: {path.suffix or 'no ending'} is not known; expected {', '.join(MOTION_FILES)}.")
    turned = motion.in_axes(axes or form.axes)
    try:
        form.write(path, turned)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{path}: cannot be written ({reason}). Choose a folder that exists and has space.") from error
