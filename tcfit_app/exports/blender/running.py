"""FBX by Blender, run as a separate process that ends when the export is cancelled."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.atomic import scratch_folder
from fitting_core.io.motion_files import MOTION_FILES
from fitting_core.motion import Progress
from tcfit_app.exports.source import ExportSource

_SCRIPT = Path(__file__).with_name("glb_to_fbx.py")
_LONGEST, _PER_FRAME = 120.0, 0.5
"""Seconds after which Blender is ended, and more of them for each frame. 145 frames take 4 s."""
_LOOK = 0.1
"""Seconds between checks whether it has ended or was cancelled."""
_OF_GLB = 0.6
"""Share of the whole time until the GLB is there that Blender reads."""
_MISSING = (
    "FBX is written by Blender, which is not on this computer. Install Blender (blender.org) so that the command "
    "blender works in a terminal, or its module into tcfit's environment: pip install bpy==4.2.0. Then restart tcfit."
)


def missing() -> str:
    """What must be installed for FBX; empty if nothing."""
    return "" if _command() else _MISSING


def _command() -> list[str]:
    """The command that runs a script in Blender; empty without Blender."""
    if program := shutil.which("blender"):
        return [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python"]
    return [sys.executable] if importlib.util.find_spec("bpy") else []


def write_fbx(source: ExportSource, path: Path, progress: Progress) -> None:
    """Write the character of a GLB as FBX. Raises InputError if there is no Blender, or it
    fails, or takes too long."""
    command = _command()
    if not command:
        raise InputError(_MISSING)
    from fitting_core.io.motion.glb import write_glb  # here: pygltflib would take 0.4 s of every start of the app

    motion = source.motion(MOTION_FILES[".glb"].axes)
    with scratch_folder() as folder:
        glb, fbx = folder / "character.glb", folder / "character.fbx"
        write_glb(glb, motion, lambda share: progress(_OF_GLB * share))
        seconds = _LONGEST + _PER_FRAME * len(motion)
        given = ["--", str(glb), str(fbx), f"{motion.frame_rate:.9g}"]
        _run([*command, str(_SCRIPT), *given], folder, seconds, progress)
        if not fbx.is_file():
            raise InputError(f"Blender wrote no FBX. {_last_of(folder)}")
        shutil.copyfile(fbx, path)


def _run(command: list[str], folder: Path, seconds: float, progress: Progress) -> None:
    """Wait for its end. An exception of `progress` ends it too."""
    with (folder / "said.txt").open("wb") as said:
        try:
            process = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                close_fds=True,
                start_new_session=True,
            )
        except OSError as error:
            raise InputError(
                f"{command[0]}: cannot be started ({error.strerror or error}). Try it in a terminal; install it again."
            ) from error
        begun = time.monotonic()
        try:
            while process.poll() is None:
                spent = time.monotonic() - begun
                if spent > seconds:
                    raise InputError(
                        f"Blender has not ended after {seconds:.0f} s, and was stopped. {_last_of(folder)}"
                    )
                progress(_OF_GLB + (1 - _OF_GLB) * spent / seconds)
                time.sleep(_LOOK)
        finally:
            if process.poll() is None:
                _kill(process)
            process.wait()
    if process.returncode:
        raise InputError(f"Blender failed with exit code {process.returncode}. {_last_of(folder)}")


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Together with its children: the command blender may be a script."""
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)


def _last_of(folder: Path) -> str:
    """The last lines of Blender's output."""
    found = (folder / "said.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return "Its output:\n" + "\n".join(found[-8:]) if found else "It had no output."
