"""Chooses the vertices of nose, eyes, ears, toes, heels and fingertips."""

import numpy as np
from jaxtyping import Float, Int

from build_assets.free_body.makehuman import Rig
from build_assets.free_body.rest_pose import FINGER_BONES, SIDES, RestBody
from build_assets.free_body.skin.surface import Surface
from fitting_core.body.files.forms import KINDS
from fitting_core.body.geometry import unit

SMPLX_VERTICES = KINDS["smplx"].surface_keypoints()
"""Vertex numbers at which programs that read SMPL-X files look for these keypoints."""

_TIP_BONES = {"big_toe": "toe1-2", "small_toe": "toe5-3"} | {
    finger: f"finger{number}-3" for finger, number in FINGER_BONES.items()
}
_MIDLINE = 1e-4  # metres
_NOSE_BELOW_EYES = 0.07
_SOLE = 0.035  # metres above the lowest point of the foot


def pick_surface_keypoints(
    surface: Surface, rig: Rig, rest: RestBody, positions: Float[np.ndarray, "N 3"]
) -> dict[str, int]:
    """The base mesh's vertex of each surface keypoint.

    Args:
        surface: the body's surface.
        rig: MakeHuman's skeleton.
        rest: a typical body in the rest pose.
        positions: its vertices by their numbers in the base mesh.
    """
    found: dict[str, int] = {"nose": nose_tip(surface, positions, rest.bone_heads[rig.index["eye.L"], 1])}
    for side, name in SIDES.items():
        front = surface.vertices_of(surface.parts[f"eye_front.{side}"])
        found[f"{name}_eye"] = int(front[positions[front, 2].argmax()])
        found[f"{name}_ear"] = _ear(surface, positions, 1 if side == "L" else -1)
        found[f"{name}_heel"] = _heel(surface, rig, positions, f"foot.{side}")
        for tip, bone in _TIP_BONES.items():
            found[f"{name}_{tip}"] = _tip(surface, rig, rest, positions, f"{bone}.{side}")
    return found


def nose_tip(surface: Surface, positions: Float[np.ndarray, "N 3"], eye_height: float) -> int:
    """The foremost vertex of the face's middle line below the eyes."""
    head = surface.vertices_of(surface.parts["head"])
    below = eye_height - positions[head, 1]
    nose = head[(np.abs(positions[head, 0]) < _MIDLINE) & (below > 0) & (below < _NOSE_BELOW_EYES)]
    return int(nose[positions[nose, 2].argmax()])


def _ear(surface: Surface, positions: Float[np.ndarray, "N 3"], sign: int) -> int:
    """The outermost vertex near the tragus: the front of the ear, half way up."""
    ears = surface.vertices_of(surface.parts["ears"])
    ear = ears[positions[ears, 0] * sign > 0]
    low, high = positions[ear].min(0), positions[ear].max(0)
    tragus = low + np.array([0, 0.48, 0.72]) * (high - low)
    near = ear[np.argsort(np.linalg.norm((positions[ear] - tragus)[:, 1:], axis=1))[:25]]
    return int(near[np.abs(positions[near, 0]).argmax()])


def _tip(surface: Surface, rig: Rig, rest: RestBody, positions: Float[np.ndarray, "N 3"], bone: str) -> int:
    """The vertex that lies furthest along a finger's or toe's last bone."""
    number = rig.index[bone]
    skin = _skin(surface, rig, bone)
    direction = unit(rest.bone_tails[number] - rest.bone_heads[number])
    reach = positions[skin] - rest.bone_heads[number]
    along = reach @ direction
    aside = np.linalg.norm(reach - along[:, None] * direction, axis=1)
    return int(skin[(along - 0.3 * aside).argmax()])


def _heel(surface: Surface, rig: Rig, positions: Float[np.ndarray, "N 3"], bone: str) -> int:
    """The hindmost vertex of the sole."""
    foot = _skin(surface, rig, bone)
    sole = foot[positions[foot, 1] < positions[foot, 1].min() + _SOLE]
    return int(sole[positions[sole, 2].argmin()])


def _skin(surface: Surface, rig: Rig, bone: str) -> Int[np.ndarray, "v"]:
    return surface.used[rig.weights[surface.used, rig.index[bone]] > 0.5]
