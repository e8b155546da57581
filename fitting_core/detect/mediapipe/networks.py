"""MediaPipe's networks on this computer: which there are, where they lie, and running them.

They are Google's (Apache-2.0) and do not come with tcfit; `fetching` brings them. Each is an ONNX file made of the
`.tflite` file that Google publishes. Importing this loads nothing heavy.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float32

from fitting_core.detect.known_models import models_folder
from fitting_core.errors import InputError

if TYPE_CHECKING:
    import onnxruntime

LICENCE = "Apache-2.0, by Google's model cards"
_CONVERSION = 1
"""Raise it when the conversion changes: networks that were converted before are then fetched again."""
IMAGES = "image"
"""The input of every network."""
_LIST = "networks.json"
"""In the folder: the version, and the SHA-256 of each ONNX file by name."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """A published package that has networks in it."""

    name: str
    version: str
    kind: Literal["Python", "npm"]
    megabytes: int
    """Of the download."""

    @property
    def title(self) -> str:
        """In a sentence."""
        return f"the {self.kind} package {self.name} {self.version}"


WHEEL = Package(name="mediapipe", version="0.10.21", kind="Python", megabytes=36)
"""Later ones hold no networks."""
HOLISTIC = Package(name="@mediapipe/holistic", version="0.5.1675471629", kind="npm", megabytes=53)


@dataclass(frozen=True, kw_only=True)
class KnownNetwork:
    """A network, as it is published."""

    title: str
    path: str
    """In its package."""
    sha256: str
    """Of the .tflite file."""
    package: Package = WHEEL

    @property
    def optional(self) -> bool:
        """Whether detection works without it."""
        return self.package is not WHEEL


NETWORKS: Mapping[str, KnownNetwork] = {
    "pose_detection": KnownNetwork(
        title="people",
        path="mediapipe/modules/pose_detection/pose_detection.tflite",
        sha256="9ba9dd3d42efaaba86b4ff0122b06f29c4122e756b329d89dca1e297fd8f866c",
    ),
    "pose_landmark_full": KnownNetwork(
        title="points of the body",
        path="mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
        sha256="e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
    ),
    "pose_landmark_heavy": KnownNetwork(
        title="points of the body, more exact and slower",
        path="package/pose_landmark_heavy.tflite",
        sha256="59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
        package=HOLISTIC,
    ),
    "palm_detection_full": KnownNetwork(
        title="palms",
        path="mediapipe/modules/palm_detection/palm_detection_full.tflite",
        sha256="1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54",
    ),
    "hand_landmark_full": KnownNetwork(
        title="points of a hand",
        path="mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
        sha256="11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3",
    ),
    "hand_recrop": KnownNetwork(
        title="where a hand lies",
        path="mediapipe/modules/holistic_landmark/hand_recrop.tflite",
        sha256="67d996ce96f9d36fe17d2693022c6da93168026ab2f028f9e2365398d8ac7d5d",
    ),
    "face_detection_short_range": KnownNetwork(
        title="faces",
        path="mediapipe/modules/face_detection/face_detection_short_range.tflite",
        sha256="bbff11cebd1eb27a1e004cae0b0e63ec8c551cbf34a4451148b4908b8db3eca8",
    ),
    "face_landmark": KnownNetwork(
        title="points of a face",
        path="mediapipe/modules/face_landmark/face_landmark.tflite",
        sha256="1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
    ),
}
"""By name."""
NEEDED = tuple(name for name, known in NETWORKS.items() if not known.optional)
OPTIONAL = tuple(name for name, known in NETWORKS.items() if known.optional)


def folder() -> Path:
    """Where the networks are kept; it may not exist yet."""
    return models_folder() / "mediapipe"


def version() -> str:
    """Which networks these are, as they are converted: "0.10.21-" and six digits."""
    parts = [str(_CONVERSION), *(f"{name} {known.sha256}" for name, known in NETWORKS.items())]
    return f"{WHEEL.version}-{hashlib.sha256(' '.join(parts).encode()).hexdigest()[:6]}"


def is_installed(name: str, place: Path | None = None) -> bool:
    """Whether a network is on this computer, in this version.

    Args:
        name: One of NETWORKS.
        place: The folder; None: `folder`.
    """
    place = place or folder()
    return name in listed(place) and onnx_path(name, place).is_file()


def is_sound(name: str, place: Path | None = None) -> bool:
    """Whether a network is on this computer, and has the checksum that it had when it came. Reads the whole file."""
    try:
        content(name, place)
    except InputError:
        return False
    return True


def missing(place: Path | None = None) -> tuple[str, ...]:
    """Names of the networks that detection needs and that are not on this computer."""
    return tuple(name for name in NEEDED if not is_installed(name, place))


def onnx_path(name: str, place: Path) -> Path:
    """Where a network lies in its folder."""
    return place / f"{name}.onnx"


def listed(place: Path) -> dict[str, str]:
    """The checksums of the ONNX files in a folder by the networks' names; none if they are of another version."""
    try:
        found = json.loads((place / _LIST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # not there, or damaged: to be fetched
    if not isinstance(found, dict) or found.get("version") != version() or not isinstance(found.get("sha256"), dict):
        return {}
    return {name: str(sha256) for name, sha256 in found["sha256"].items() if name in NETWORKS}


def write_list(place: Path) -> None:
    """List the ONNX files in a folder, which are of this version."""
    paths = {name: onnx_path(name, place) for name in NETWORKS}
    sums = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in paths.items() if path.is_file()}
    (place / _LIST).write_text(json.dumps({"version": version(), "sha256": sums}, indent=1), encoding="utf-8")


def content(name: str, place: Path | None = None) -> bytes:
    """The ONNX file of a network. Raises InputError, which says how to get it, if it is missing or damaged."""
    place = place or folder()
    expected = listed(place).get(name)
    path = onnx_path(name, place)
    try:
        if expected is None:
            raise FileNotFoundError
        found = path.read_bytes()
    except FileNotFoundError:
        raise InputError(_not_there(name, place)) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Correct its permissions.") from error
    if hashlib.sha256(found).hexdigest() != expected:
        raise InputError(f"{path}: is damaged, {len(found)} bytes. `tcfit models add mediapipe` replaces it.")
    return found


class Network:
    """A network, ready to run. Raises InputError if it is not on this computer, or damaged; the message says how to get
    it.

    Args:
        name: One of NETWORKS.
        outputs: Names of those that are wanted, in this order; None: all.
        threads: That it may use.
    """

    def __init__(self, name: str, *, outputs: Sequence[str] | None = None, threads: int = 1) -> None:
        self._session = open_session(content(name), threads=threads)
        given = [output.name for output in self._session.get_outputs()]
        self._outputs = given if outputs is None else list(outputs)
        assert set(self._outputs) <= set(given), f"{name} gives {given}"
        self.size: int = self._session.get_inputs()[0].shape[2]
        """Width and height of its images in pixels."""

    def __call__(self, images: Float32[np.ndarray, "N H W 3"]) -> list[np.ndarray]:
        """What the network says of each image: for each output an array whose first axis is N."""
        answers = self._session.run(self._outputs, {IMAGES: images})
        return [np.asarray(answer) for answer in answers]


def open_session(onnx: bytes, *, threads: int = 1) -> "onnxruntime.InferenceSession":
    """Open the content of an ONNX file on the CPU. Raises onnxruntime's own errors."""
    from fitting_core.detect.runtime import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3  # errors: its warnings say nothing to a user
    # Threads that wait for work would take the time of those that decode the video.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(onnx, options, providers=["CPUExecutionProvider"])


def _not_there(name: str, place: Path) -> str:
    needed = f"{WHEEL.megabytes} MB to fetch"
    what = f"MediaPipe's network {name} ({NETWORKS[name].title}; {LICENCE}) is not in {place}."
    if NETWORKS[name].optional:
        what += " It comes from npm; pose_landmark_full is used without it."
        needed, file = f"{NETWORKS[name].package.megabytes} MB to fetch", "FILE.tgz"
    else:
        file = "FILE.whl"
    return (
        f"{what} Get it by `tcfit models add mediapipe` ({needed}), in a checkout of tcfit by `make install`, or "
        f"without a network by `tcfit models add {file}`, with {NETWORKS[name].package.title}."
    )
