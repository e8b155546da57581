"""`tcfit doctor`: check this computer, and say what to install."""

import os
import platform
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

import platformdirs

from fitting_core.body.files.registry import find_body, list_bodies, user_folder
from fitting_core.errors import InputError
from fitting_core.render.off_screen import BACKENDS

PYTHON = (3, 11)
_NO_MODULE = re.compile(r"No module named '(\w+)")
_TESTED = "install the versions that tcfit is tested with: pip install . -c constraints.txt, in its checkout"
_SHOWN = ("numpy", "torch", "av", "viser", "onnxruntime")


@dataclass(frozen=True)
class Check:
    """One line of the doctor's report."""

    status: Literal["ok", "warning", "failed"]
    """"failed" if `tcfit fit` cannot run so."""
    found: str
    advice: str = ""
    """What to do; empty if nothing."""


def doctor() -> int:
    """Print the checks, and what to install.

    Returns:
        The process's exit code: 0 if all that `tcfit fit` needs works, 1 otherwise. Others only warn.
    """
    failed = 0
    for title, check in CHECKS.items():
        print(title, flush=True)
        for line in _lines(check):
            print(f"  {line.status:8}{line.found}")
            if line.advice:
                print(f"          -> {line.advice}")
            failed += line.status == "failed"
    print()
    print("tcfit fit cannot run: see the failed checks above." if failed else "Everything that tcfit fit needs works.")
    return int(failed > 0)


def _lines(check: Callable[[], Iterator[Check]]) -> Iterator[Check]:
    """A check's lines. An exception is a failed line: a package is missing, or its interface has changed."""
    try:
        yield from check()
    except Exception as error:  # any: a changed interface raises TypeError or AttributeError, for instance
        found = f"cannot be checked: {error}" if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
        yield Check("failed", found, _TESTED)


def check_python() -> Iterator[Check]:
    """Python's version, and the versions of the packages that tcfit uses most."""
    wanted = ".".join(map(str, PYTHON))
    version = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    if sys.version_info >= PYTHON:
        yield Check("ok", version)
    else:
        yield Check("failed", version, f"install Python {wanted} or later")
    yield Check("ok", ", ".join(f"{name} {metadata.version(name)}" for name in _SHOWN))


def check_bodies() -> Iterator[Check]:
    """Whether there is a body model to fit, and which there are."""
    try:
        bodies = list_bodies()
        used = find_body()
    except InputError as error:
        yield Check("failed", str(error).replace("\n", "\n          "))
        return
    for body in bodies:
        if not body.problem:
            origin = "comes with tcfit" if body.origin == "free" else "yours"
            yield Check("ok", f"{body.kind} {body.gender}, {origin}: {body.path}")
        elif body.path == used:
            yield Check("failed", body.problem, "delete it, or replace it with tcfit models add")
        else:
            yield Check("warning", body.problem)


def check_torch() -> Iterator[Check]:
    """The devices that torch computes on."""
    try:
        import torch
    except (ImportError, OSError) as error:
        yield Check("failed", f"torch cannot be imported ({error})", "pip install --force-reinstall torch")
        return
    yield Check("ok", f"CPU, {os.cpu_count()} cores")
    from fitting_core.fit.fused import ready

    why = ready.problem()
    if why == ready.NOT_YET:
        found = f"the solver's kernels are not compiled yet: the first fit does that in about {ready.SECONDS} s"
        yield Check("ok", found)
    elif why:
        advice = "run python -m fitting_core.fit.fused: fits take many times as long without kernels"
        yield Check("warning", f"the solver's kernels are not used: {why}", advice)
    else:
        yield Check("ok", "the solver's kernels are compiled")
    if torch.cuda.is_available():
        yield Check("ok", f"CUDA {torch.version.cuda}: {torch.cuda.get_device_name()}")
    else:
        yield Check("ok", "no CUDA device; tcfit runs on the CPU")


def check_rendering() -> Iterator[Check]:
    """Off-screen OpenGL, which only the overlay video needs: EGL, else OSMesa."""
    from fitting_core.render.renderer import probe

    for name, packages in BACKENDS.items():
        reason = probe(name)
        if reason is None:
            yield Check("ok", f"renders off-screen with {name.upper()}")
            return
        missing = _NO_MODULE.search(reason)
        advice = f"pip install {missing[1]}" if missing else f"apt install {packages}"
        yield Check("warning", f"{name.upper()}: {reason}", advice)


def check_video() -> Iterator[Check]:
    """Whether the demo clip can be decoded, and the encoder of overlay videos."""
    from fitting_core.clips.demo import demo_clip
    from fitting_core.video.encoding import can_encode
    from fitting_core.video.frames import FrameSource

    with FrameSource(demo_clip().video) as frames:
        frames.frame(frames.count - 1)
        yield Check("ok", f"PyAV decodes the demo clip, {frames.count} frames")
    if can_encode():
        yield Check("ok", "PyAV writes H.264 videos")
    else:
        yield Check("warning", "PyAV was built without H.264", "pip install --force-reinstall av")


def check_networks() -> Iterator[Check]:
    """Whether the networks that come with tcfit can be read."""
    from fitting_core.lifting.network import read_lifter
    from fitting_core.priors.files.registry import read_prior
    from fitting_core.shipped import LIFTER, POSE_PRIOR

    for read, path in ((read_lifter, LIFTER), (read_prior, POSE_PRIOR)):
        read(path)
        yield Check("ok", path.name)


def check_detector() -> Iterator[Check]:
    """Whether the networks that find keypoints are on this computer, and can be opened."""
    from fitting_core.detect.mediapipe import networks

    get = "tcfit models add mediapipe"
    here = [name for name in networks.NETWORKS if networks.is_installed(name)]
    gone = networks.missing()
    broken = False
    for name in here:
        if why := _refusal(lambda name=name: networks.Network(name)):
            broken = True
            yield Check("warning", why, get)
    if gone:
        which = "the networks are" if len(gone) == len(networks.NEEDED) else f"{', '.join(gone)} of its networks are"
        found = f"{which} not on this computer: tcfit cannot find keypoints in a video"
        yield Check("warning", found, f"{get} (90 MB, once); not needed with --keypoints")
    elif not broken:
        lacks = "" if len(here) == len(networks.NETWORKS) else "; the larger one for bodies (optional) is missing"
        found = f"MediaPipe's networks are in {networks.folder()}{lacks}"
        yield Check("ok", found, get if lacks else "")
    yield from _downloaded_models()


def _downloaded_models() -> Iterator[Check]:
    from fitting_core.detect.known_models import KNOWN_MODELS, is_here, model_path
    from fitting_core.detect.topdown.families import load_box_model, load_pose_model

    for name in filter(is_here, KNOWN_MODELS):
        load = load_pose_model if KNOWN_MODELS[name].finds == "points" else load_box_model
        if why := _refusal(lambda load=load, name=name: load(model_path(name))):
            yield Check("warning", why, f"tcfit models add {name}")
        else:
            yield Check("ok", f"{name}: {model_path(name)}")


def _refusal(load: Callable[[], object]) -> str:
    """Why a network cannot be opened; empty if it can."""
    try:
        load()
    except Exception as error:  # any: onnxruntime's exceptions have no other common base
        return str(error)
    return ""


def check_folders() -> Iterator[Check]:
    """Whether tcfit's folders are writable."""
    folders = {
        "body models": user_folder(),
        "cache": platformdirs.user_cache_path("tcfit", appauthor=False),
        "temporary files": Path(tempfile.gettempdir()),
    }
    for purpose, folder in folders.items():
        problem = _write_problem(folder)
        if problem:
            advice = "correct its permissions or free space"
            yield Check("warning", f"{purpose}: {folder} cannot be written ({problem})", advice)
        else:
            yield Check("ok", f"{purpose}: {folder}")


def check_plugins() -> Iterator[Check]:
    """Additions of other packages, and their faults."""
    from fitting_core import plugins
    from fitting_core.io.added_readers import keypoint_readers, motion_readers
    from tcfit_app.exports.table import exports

    tables = {
        "tcfit.readers": {**keypoint_readers(), **motion_readers()},
        "tcfit.exports": exports(),
    }
    for group, table in tables.items():
        for plugin in plugins.loaded(group):
            if plugin.name in table and not any(fault.of(plugin) for fault in plugins.faults()):
                yield Check("ok", f"{group}: {plugin.name}, of {plugin.package}")
    for fault in plugins.faults():
        yield Check("warning", f"{fault.group}: {fault.name}: {fault.reason}", fault.advice)
    if not any(plugins.loaded(group) for group in tables) and not plugins.faults():
        yield Check("ok", "none")


CHECKS: dict[str, Callable[[], Iterator[Check]]] = {
    "Python and packages": check_python,
    "Body models": check_bodies,
    "Computing": check_torch,
    "Off-screen rendering (overlay video)": check_rendering,
    "Video": check_video,
    "Networks of the fit": check_networks,
    "Detectors": check_detector,
    "Folders": check_folders,
    "Plugins": check_plugins,
}
"""The checks by title."""


def _write_problem(folder: Path) -> str:
    """Why no file can be written in a folder, or in the nearest one above it that exists; empty if one can."""
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=existing):
            return ""
    except OSError as error:
        return error.strerror or str(error)
