"""Ground truth of a generated clip: bodies, joints, keypoints and their visibility; and its file (npz)."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz

CAMERA_KEYS = ("focal", "center", "size", "source")


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """Ground truth of a clip of T frames."""

    params: BodyParams
    """In camera space."""
    joints: Float[np.ndarray, "T 55 3"]
    """Camera space, metres."""
    keypoints: Float[np.ndarray, "T 137 2"]
    """Pixels, without noise; meaningless where the body has no such point (`exists`)."""
    visible: Bool[np.ndarray, "T 137"]
    """Whether the keypoint is unoccluded."""
    exists: Bool[np.ndarray, "137"]
    camera: Camera
    frame_rate: float
    body_hash: str
    """Of the body model's file."""


def read_truth(path: Path) -> Truth:
    """Read the truth of a generated clip, as `evaluation.synthetic.truth` writes it. Raises InputError if it is not
    such a file."""
    try:
        values = read_npz(path)
        (fx, fy), (cx, cy), (width, height), source = (values[f"camera_{name}"].tolist() for name in CAMERA_KEYS)
        return Truth(
            params=BodyParams(**{f.name: torch.as_tensor(values[f.name]) for f in fields(BodyParams)}),
            camera=Camera(focal=(fx, fy), center=(cx, cy), size=(width, height), source=source),
            frame_rate=float(values["frame_rate"]),
            body_hash=str(values["body_hash"]),
            **{name: values[name] for name in ("joints", "keypoints", "visible", "exists")},
        )
    except (OSError, KeyError, ValueError) as error:
        raise InputError(
            f"{path} is not the truth of a generated clip ({error}): delete its folder and make it again."
        ) from error
