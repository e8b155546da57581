"""Try things that may crash or hang (OpenGL, video codecs) in a process of their own."""

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

TIMEOUT_SECONDS = 60.0
"""Encoding ten small frames takes a fraction of a second."""

_ENCODE = """
import sys
import cv2
import numpy as np

codec, path = sys.argv[1:]
writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*codec), 25.0, (64, 48))
assert writer.isOpened(), "the encoder is not there"
for shade in range(0, 200, 20):
    writer.write(np.full((48, 64, 3), shade, dtype=np.uint8))
writer.release()
reader = cv2.VideoCapture(path)
shades = []
while True:
    there, frame = reader.read()
    if not there:
        break
    shades.append(float(frame.mean()))
assert len(shades) == 10, f"{len(shades)} of 10 frames came back"
assert np.abs(np.array(shades) - np.arange(0, 200, 20)).max() < 12, "the frames came back with other colours"
print("ok")
"""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a probe ended."""

    works: bool
    reason: str = ""
    """Why it does not work: the last line that the process wrote, or how it ended."""


def probe_rendering(backend: str) -> Outcome:
    """Render a triangle off-screen, on a backend of fitting_core.render.off_screen, as the overlay video would."""
    try:
        from fitting_core.render.renderer import probe
    except ImportError as error:
        return Outcome(works=False, reason=str(error))
    reason = probe(backend)
    return Outcome(works=reason is None, reason=reason or "")


def probe_codec(codec: str, *, timeout: float = TIMEOUT_SECONDS) -> Outcome:
    """Write an mp4 with OpenCV in a codec ("mp4v", "avc1") and read it back."""
    with tempfile.TemporaryDirectory() as folder:
        return _run([_ENCODE, codec, str(Path(folder) / "probe.mp4")], timeout)


def _run(arguments: list[str], timeout: float) -> Outcome:
    command = [sys.executable, "-c", *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=timeout)
    except subprocess.TimeoutExpired:
        return Outcome(works=False, reason=f"no answer after {timeout:.0f} s")
    if done.returncode == 0 and done.stdout.strip().endswith("ok"):
        return Outcome(works=True)
    if done.returncode < 0:
        return Outcome(works=False, reason=f"crashed with signal {-done.returncode}")
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return Outcome(works=False, reason=lines[-1] if lines else f"ended with code {done.returncode}")
