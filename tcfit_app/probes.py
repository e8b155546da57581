"""Try things that may crash or hang (OpenGL, video codecs) in a process of their own."""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

TIMEOUT_SECONDS = 60.0
"""A first render compiles shaders, and software rendering on a busy computer takes some seconds."""

# The camera gets explicit near and far planes and the mesh's bounds are not asked for: those paths of pyrender 0.1.45
# call np.infty, which numpy 2 has no more.
_RENDER = """
import numpy as np
import pyrender

vertices = np.array([[-1, -1, -2], [1, -1, -2], [0, 1, -2]], dtype=np.float32)
primitive = pyrender.Primitive(positions=vertices, indices=np.array([[0, 1, 2]]))
scene = pyrender.Scene(bg_color=[0, 0, 0, 0], ambient_light=[1.0, 1.0, 1.0])
scene.add(pyrender.Mesh([primitive]))
scene.add(pyrender.PerspectiveCamera(yfov=1.2, aspectRatio=1.0, znear=0.1, zfar=10.0), pose=np.eye(4))
renderer = pyrender.OffscreenRenderer(32, 32)
color, depth = renderer.render(scene)
renderer.delete()
assert abs(depth[16, 16] - 2) < 0.01 and depth[0, 0] == 0, "the triangle is not where it should be"
print("ok")
"""

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


def probe_rendering(platform: str, *, timeout: float = TIMEOUT_SECONDS) -> Outcome:
    """Render a triangle off-screen with pyrender on "egl" or "osmesa"."""
    return _run([_RENDER], {"PYOPENGL_PLATFORM": platform}, timeout)


def probe_codec(codec: str, *, timeout: float = TIMEOUT_SECONDS) -> Outcome:
    """Write an mp4 with OpenCV in a codec ("mp4v", "avc1") and read it back."""
    with tempfile.TemporaryDirectory() as folder:
        return _run([_ENCODE, codec, str(Path(folder) / "probe.mp4")], {}, timeout)


def _run(arguments: list[str], environment: dict[str, str], timeout: float) -> Outcome:
    command = [sys.executable, "-c", *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=timeout, env=os.environ | environment
        )
    except subprocess.TimeoutExpired:
        return Outcome(works=False, reason=f"no answer after {timeout:.0f} s")
    if done.returncode == 0 and done.stdout.strip().endswith("ok"):
        return Outcome(works=True)
    if done.returncode < 0:
        return Outcome(works=False, reason=f"crashed with signal {-done.returncode}")
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return Outcome(works=False, reason=lines[-1] if lines else f"ended with code {done.returncode}")
