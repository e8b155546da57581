"""A motion as an npz of SMPL-X animation, as AMASS has it and the Blender add-ons read.

| key | shape | |
|---|---|---|
| poses | (N, 165) | axis-angle: root, 21 of the body, jaw, eyes, left and right hand with their mean pose |
| root_orient, pose_body, pose_jaw, pose_eye, pose_hand | (N, 3), (N, 63), (N, 3), (N, 6), (N, 90) | its parts |
| trans, expressions | (N, 3), (N, 10) | |
| betas | (16,) | ten, then zeros: AMASS has 16, and programs with fewer take the first |
| gender, surface_model_type, mocap_frame_rate, mocap_framerate | () | |
| axes, camera_to_world, camera_place, ground, camera_*, image_size, lens_*, world_*, first_frame, \
body_kind, body_hash, betas_source, generator | | tcfit's own: x_world = camera_to_world @ x_camera + camera_place, \
with a row for each frame where the camera moves |

Posed as in SMPL-X: the root turns about the pelvis, and trans is added. AMASS's world has z up, which is the
add-on's format "AMASS"; its format "SMPL-X" has y up.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import N_BETAS, POSE_COLUMNS
from fitting_core.files.npz import write_npz
from fitting_core.io.camera_arrays import camera_arrays
from fitting_core.motion import Motion, stated

_BETAS = 16
POSE_KEYS: dict[str, slice] = {
    "root_orient": POSE_COLUMNS["global_orient"],
    "pose_body": POSE_COLUMNS["body_pose"],
    "pose_jaw": POSE_COLUMNS["jaw_pose"],
    "pose_eye": slice(POSE_COLUMNS["leye_pose"].start, POSE_COLUMNS["reye_pose"].stop),
    "pose_hand": slice(POSE_COLUMNS["left_hand_pose"].start, POSE_COLUMNS["right_hand_pose"].stop),
}
"""AMASS's keys of the pose's parts: their columns in `poses`."""


def write_animation_npz(path: Path, motion: Motion) -> None:
    """Write a motion with one shape; it reads with np.load(allow_pickle=False). Raises OSError if the file cannot be
    written; nothing is left of it."""
    write_npz(path, animation_arrays(motion))


def animation_arrays(motion: Motion) -> dict[str, np.ndarray]:
    """The arrays of the table above, by name."""
    shaped = motion.one_shape
    poses = shaped.pose.flatten(1).numpy()
    facts = stated(motion)
    arrays: dict[str, Any] = {
        "surface_model_type": "smplx",
        "gender": motion.body.gender,
        "mocap_frame_rate": motion.frame_rate,
        "mocap_framerate": motion.frame_rate,
        "betas": np.pad(shaped.params.betas[:1].double().numpy().reshape(-1)[:N_BETAS], (0, _BETAS - N_BETAS)),
        "trans": shaped.params.camera_translation.double().numpy(),
        "expressions": shaped.params.expression.double().numpy(),
        **pose_arrays(poses),
        "axes": f"{motion.axes}: {facts['axes_text']}",
        "camera_to_world": motion.camera_to_world,
        "camera_place": motion.camera_place,
        "ground": facts["ground"],
        **camera_arrays(motion.camera),
        **{name: facts[name] for name in ("first_frame", "body_kind", "body_hash", "betas_source", "generator")},
    }
    return {name: np.asarray(value) for name, value in arrays.items()}


def pose_arrays(poses: Float[np.ndarray, "T 165"]) -> dict[str, np.ndarray]:
    """Axis-angle of all joints under AMASS's keys, as a whole and in parts."""
    return {"poses": poses, **{name: poses[:, part] for name, part in POSE_KEYS.items()}}
