"""Published models that detection can use: where they come from, and which of them are on this computer.

Nothing of them ships with tcfit. `download` fetches one when the user asks for it.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import platformdirs

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import at_home

ENVIRONMENT = "TCFIT_DETECTORS"
"""Environment variable with the folder of the models, as where several users share them."""
_SERVER = "https://download.openmmlab.com/mmpose/v1/projects"
_HUMANART = "Apache-2.0 (MMPose); trained on Human-Art, whose annotations are for non-commercial use"


@dataclass(frozen=True, kw_only=True)
class KnownModel:
    """A model that can be downloaded."""

    name: str
    title: str
    url: str
    """Official address of the file, or of a ZIP archive with one ONNX file in it."""
    finds: Literal["points", "boxes"] = "points"
    """Points of one person in a box, or the boxes of people."""
    licence: str = "Apache-2.0 (MMPose)"
    """Of the model as its publisher states it; the data it was trained on have terms of their own."""
    size: str
    """Of the download, in words."""
    sha256: str = ""
    """Of the ONNX file. Empty if none is published: the first download is then trusted, and its
    checksum remembered."""


_TABLE = (
    KnownModel(
        name="dwpose-m",
        title="DWPose-m, 192 x 256",
        url=f"{_SERVER}/rtmposev1/onnx_sdk/rtmpose-m_simcc-ucoco_dw-ucoco_270e-256x192-c8b76419_20230728.zip",
        size="about 60 MB",
    ),
    KnownModel(
        name="dwpose-l",
        title="DWPose-l, 288 x 384",
        url=f"{_SERVER}/rtmposev1/onnx_sdk/rtmpose-l_simcc-ucoco_dw-ucoco_270e-384x288-2438fd99_20230728.zip",
        size="125 MB",
        sha256="8cfecfc2226d8e14b510c2fd28442226c518b4d60690535753187877411d4005",
    ),
    KnownModel(
        name="rtmw-l",
        title="RTMW-l, 288 x 384",
        url=f"{_SERVER}/rtmw/onnx_sdk/rtmw-dw-x-l_simcc-cocktail14_270e-384x288_20231122.zip",
        size="213 MB",
        sha256="bd033156e5104c4f5d2edfe0453e02661e30a2f3da453ec93c8764d561b83054",
    ),
    KnownModel(
        name="rtmdet-nano",
        title="RTMDet-nano, people",
        finds="boxes",
        url=f"{_SERVER}/rtmposev1/onnx_sdk/rtmdet_nano_8xb32-100e_coco-obj365-person-05d8511e.zip",
        licence="Apache-2.0 (MMDetection)",
        size="about 4 MB",
    ),
    KnownModel(
        name="rtmdet-m",
        title="RTMDet-m, people",
        finds="boxes",
        url=f"{_SERVER}/rtmposev1/onnx_sdk/rtmdet_m_8xb32-100e_coco-obj365-person-235e8209.zip",
        licence="Apache-2.0 (MMDetection)",
        size="about 90 MB",
    ),
    KnownModel(
        name="yolox-m",
        title="YOLOX-m, people",
        finds="boxes",
        url=f"{_SERVER}/rtmposev1/onnx_sdk/yolox_m_8xb8-300e_humanart-c2c7a14a.zip",
        licence=_HUMANART,
        size="94 MB",
        sha256="3dea6513388889f0fff4b77bf7a26013600321b9eb9ceb0e9a400a82572f5f23",
    ),
)
# The publisher states no checksums. Those above were not computed by this project: they are what several public
# projects, which have nothing to do with each other, recorded for the ONNX files in these archives.
KNOWN_MODELS: dict[str, KnownModel] = {model.name: model for model in _TABLE}
"""By name."""


def models_folder() -> Path:
    """Where downloaded models are kept: the folder in the environment variable, else one of the user's data."""
    if given := os.environ.get(ENVIRONMENT):
        return at_home(given)
    return platformdirs.user_data_path("tcfit", appauthor=False) / "detectors"


def model_path(name: str, folder: Path | None = None) -> Path:
    """Where a known model lies once it has been downloaded."""
    return (folder or models_folder()) / f"{name}.onnx"


def is_here(name: str, folder: Path | None = None) -> bool:
    """Whether a known model is on this computer."""
    return model_path(name, folder).is_file()


def find_model(given: str, folder: Path | None = None) -> Path:
    """The file that a user names: by its path, or by the name of a known model that has been downloaded. Raises
    InputError if there is no such file, or the known model is not on this computer."""
    path = at_home(given)
    if given not in KNOWN_MODELS or path.is_file():
        if not path.is_file():
            raise InputError(
                f"{given}: there is no such model file; expected an ONNX file (*.onnx), or one of the names "
                f"{', '.join(KNOWN_MODELS)}, which `tcfit models add NAME` fetches."
            )
        return path
    if not model_path(given, folder).is_file():
        raise InputError(f"{given} is not on this computer: fetch it by `tcfit models add {given}`.")
    return model_path(given, folder)


def pinned(name: str, folder: Path) -> str:
    """The checksum that an earlier download of a model had; empty without one."""
    return _pins(folder).get(name, "")


def pin(name: str, sha256: str, folder: Path) -> None:
    """Remember the checksum of a model's first download."""
    with replacing(folder / _PINS) as draft:
        draft.write_text(json.dumps(_pins(folder) | {name: sha256}, indent=1), encoding="utf-8")


_PINS = "checksums.json"


def _pins(folder: Path) -> dict[str, str]:
    try:
        known = json.loads((folder / _PINS).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(f"{folder / _PINS}: cannot be read ({error}); delete it to forget all checksums.") from error
    return {str(name): str(value) for name, value in known.items()} if isinstance(known, dict) else {}
