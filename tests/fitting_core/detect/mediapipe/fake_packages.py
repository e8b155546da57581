"""Packages with tiny networks in place of MediaPipe's, and programs in place of pip and npm.

As a program it fetches from them: python -m tests.fitting_core.detect.mediapipe.fake_packages SOURCE PLACE BEHAVIOUR.
"""

import hashlib
import io
import signal
import sys
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting_core.detect.mediapipe import packages
from fitting_core.detect.mediapipe.fetching import Fetched, fetch
from fitting_core.detect.mediapipe.networks import NEEDED, NETWORKS, OPTIONAL, KnownNetwork
from fitting_core.detect.mediapipe.packages import Programs
from tests.fitting_core.detect.mediapipe.tflite_files import IMAGES, TfliteWriter

SIZE = (4, 4, 3)
_PIP = """
import pathlib, shutil, subprocess, sys, time
source, behaviour, *given = sys.argv[1:]
source = pathlib.Path(source)
with (source / "asked.txt").open("a") as file:
    file.write(given[0] + chr(10))
option = "--dest" if "--dest" in given else "--pack-destination"
target = pathlib.Path(given[given.index(option) + 1])
name = "*.whl" if option == "--dest" else "*.tgz"
if behaviour == "offline":
    print("WARNING: Retrying (Retry(total=1)) after connection broken")
    print("ERROR: No matching distribution found for mediapipe==0.10.21")
    sys.exit(1)
if behaviour == "refused":
    print("Collecting")
    print("ERROR: 403 Client Error")
    sys.exit(1)
if behaviour == "full":
    print("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device")
    sys.exit(1)
if behaviour == "hangs":
    beat = f"import os, time\\nopen({str(source / 'pid')!r}, 'w').write(str(os.getpid()))\\n"
    beat += f"while True: open({str(source / 'beat')!r}, 'a').write('x'); time.sleep(0.02)"
    (target / "half.whl.part").write_bytes(bytes(1000))
    subprocess.run([sys.executable, "-c", beat])
if behaviour == "slow":
    time.sleep(1)
if behaviour != "nothing":
    shutil.copy(next(source.glob(name)), target)
"""


def tiny_network(seed: int) -> bytes:
    """A .tflite network of one layer."""
    net = TfliteWriter(SIZE)
    kernels = np.random.default_rng(seed).normal(size=(2, 1, 1, 3)).astype(np.float32)
    tensors = [net.constant(kernels), net.constant(np.zeros(2, np.float32))]
    output = net.step(3, [IMAGES, *tensors], (1, 4, 4, 2), f0=0, i1=1, i2=1, i4=1, i5=1)
    return net.content([output])


def make_packages(folder: Path) -> Path:
    """The wheel and the npm package in a folder, which is made."""
    folder.mkdir(parents=True)
    contents = {name: tiny_network(seed) for seed, name in enumerate(NETWORKS)}
    write_wheel(folder, {NETWORKS[name].path: contents[name] for name in NEEDED})
    with tarfile.open(folder / "mediapipe-holistic.tgz", "w:gz") as archive:
        for name in OPTIONAL:
            info = tarfile.TarInfo(NETWORKS[name].path)
            info.size = len(contents[name])
            archive.addfile(info, io.BytesIO(contents[name]))
    return folder


def write_wheel(folder: Path, entries: dict[str, bytes]) -> Path:
    """A wheel, in place of one that is there."""
    wheel = folder / "mediapipe-0.10.21-cp311-cp311-manylinux_2_28_x86_64.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in {"mediapipe/__init__.py": b"raise SystemExit('never run')", **entries}.items():
            archive.writestr(name, content)
    return wheel


def know(folder: Path, set_item: Callable[[Any, str, KnownNetwork], None], set_wheel: Callable[[str], None]) -> None:
    """Take the networks of these packages for MediaPipe's.

    Args:
        folder: Of the packages.
        set_item: Replaces one in the table.
        set_wheel: Replaces the wheel's checksum.
    """
    contents = {name: tiny_network(seed) for seed, name in enumerate(NETWORKS)}
    for name, content in contents.items():
        set_item(NETWORKS, name, replace(NETWORKS[name], sha256=hashlib.sha256(content).hexdigest()))
    set_wheel(hashlib.sha256(next(folder.glob("*.whl")).read_bytes()).hexdigest())


def fake_programs(source: Path, *, pip: str = "works", npm: str = "works") -> Programs:
    """Programs that take packages from a folder, in a way that is named."""
    command = [sys.executable, "-c", _PIP, str(source)]
    return Programs(pip=[*command, pip], npm=[*command, npm])


def asked(source: Path) -> list[str]:
    """What the programs were asked to do."""
    return (source / "asked.txt").read_text().split() if (source / "asked.txt").exists() else []


def main(source: str, place: str, behaviour: str) -> None:
    """Fetch, and say what was added."""
    folder = Path(source)
    know(folder, lambda table, name, known: table.update({name: known}), lambda s: setattr(packages, "WHEEL_SHA256", s))
    for event in fetch(Path(place), using=fake_programs(folder, pip=behaviour)):
        print(",".join(event.added) if isinstance(event, Fetched) else event.step, flush=True)


if __name__ == "__main__":
    # A shell that runs the tests in the background has it ignored, and all that it starts ignores it too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main(*sys.argv[1:])
