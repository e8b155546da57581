"""A person as VRM 1.0, and their motion as VRM animation 1.0: two files, as VRM holds no motion.

Both have the bones of `known_rigs.VRM` in T pose, facing +z, in metres. The avatar has the person's surface with linear
skinning; each component of the body's expression becomes two custom expressions, one per sign, with a weight of 1 for
three units, and likewise in the animation. Of VRM's presets it has `aa`, which opens the jaw, and for the free body,
whose components are known, some of the face. Eyes are bones in the avatar but not in the animation, where VRM has a
look-at point instead, which is not written.

Sources: the specifications VRMC_vrm-1.0 and VRMC_vrm_animation-1.0 of the VRM Consortium.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gltf
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.animation.animated import RigSurface, below, on_standard, surface_on
from fitting_core.animation.known_rigs import VRM
from fitting_core.animation.morphs import Morphs
from fitting_core.animation.retargeting import RigMotion
from fitting_core.animation.standard import bent
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.io.motion.rig_glb import FIRST_JOINT, MESH, GltfFile, animation_of, joint_nodes, skinned_file
from fitting_core.motion import Motion, Progress, stated
from fitting_core.shipped import FREE_FOLDER

UNITS = 3.0
"""Units of an expression component at a weight of 1."""
_OPEN = 0.35
"""Radians by which the jaw opens for `aa`."""
_JAW = "jaw_open"
_FREE_PRESETS = {
    "happy": ("expression_0", 0.7),
    "ou": ("expression_1", 0.7),
    "ih": ("expression_1_negative", 0.7),
    "blink": ("expression_5", 0.7),
    "blinkLeft": ("expression_8", 0.7),
    "blinkRight": ("expression_8_negative", 0.7),
}
"""Meaning of the free body's components (assets/bodies/ATTRIBUTION.md): smile, lips protruded and wide, eyes closed;
and their largest value: beyond it, lids and lips bulge."""
_EYES = ("leftEye", "rightEye")


@dataclass(frozen=True, kw_only=True)
class _Licence:
    """The terms of use of a body's files."""

    names: str
    url: str


_OF_KINDS = {
    "smplx": _Licence(names="SMPL-X", url="https://smpl-x.is.tue.mpg.de/modellicense.html"),
    "smplh": _Licence(names="SMPL-H", url="https://mano.is.tue.mpg.de/license.html"),
    "smpl": _Licence(names="SMPL", url="https://smpl.is.tue.mpg.de/modellicense.html"),
}


def write_vrm(path: Path, motion: Motion, progress: Progress | None = None) -> None:
    """Write the person as an avatar, without motion. Raises OSError if that fails; nothing is left of the file."""
    moving = on_standard(motion, VRM)
    still = replace(motion.one_shape[:1], contacts=None)
    surface = _avatar(motion, replace(moving, moved=moving.moved[:1], root=moving.root[:1]), still)
    file = skinned_file(still, moving, surface, stated(motion))
    file.document.extensionsUsed = ["VRMC_vrm"]
    file.document.extensions = {"VRMC_vrm": _extension(motion, moving, surface)}
    file.save(path)
    if progress:
        progress(1.0)


def write_vrm_animation(path: Path, motion: Motion, progress: Progress | None = None) -> None:
    """Write the motion for avatars of VRM 1.0, of any proportions: their hips' height scales it.

    It starts at the origin, on the floor, where programs that show avatars look.

    Raises:
        OSError: The file cannot be written; nothing is left of it.
    """
    moving = on_standard(motion, VRM)
    moving = replace(moving, root=moving.root - below(motion, moving))
    expressions = _values(motion)
    nodes = {name: FIRST_JOINT + len(moving.target) + k for k, name in enumerate(expressions)}
    # As in the avatar's file, the joints begin at FIRST_JOINT: node 1 has no mesh here and holds the expressions.
    above = [
        gltf.Node(name=motion.name, children=[MESH, FIRST_JOINT]),
        gltf.Node(name="expressions", children=list(nodes.values())),
    ]
    places = [gltf.Node(name=name, translation=[0.0, 0.0, 0.0]) for name in nodes]
    file = GltfFile(motion.name, stated(motion.in_axes("y-up")), [*above, *joint_nodes(moving), *places], [0])
    document = file.document
    document.scenes[0].extras = {}
    document.extensionsUsed = ["VRMC_vrm_animation"]
    # glTF has an expression's weight in the x of a node's translation.
    more = [(nodes[name], values[:, None] * (1.0, 0.0, 0.0)) for name, values in expressions.items()]
    document.animations = [animation_of(motion, moving, file, more=more)]
    document.extensions = {
        "VRMC_vrm_animation": {
            "specVersion": "1.0",
            "humanoid": {"humanBones": _bones(moving, without=_EYES)},
            "expressions": {"custom": {name: {"node": node} for name, node in nodes.items()}},
        }
    }
    file.save(path)
    if progress:
        progress(1.0)


def _bones(moving: RigMotion, *, without: tuple[str, ...] = ()) -> dict[str, dict[str, int]]:
    names = moving.target.names
    return {name: {"node": FIRST_JOINT + k} for k, name in enumerate(names) if name not in without}


# --- the avatar ---


def _components(body: BodyModel) -> list[tuple[str, int, float]]:
    """Names, components and signs of the expressions that move this body."""
    found = np.flatnonzero(abs(body.expression_directions).max((0, 1)) > 0)
    return [(f"expression_{k}{'_negative' * (sign < 0)}", int(k), sign) for k in found for sign in (1.0, -1.0)]


def _values(motion: Motion) -> dict[str, Float[np.ndarray, "T"]]:
    """The motion's expressions as weights from 0 to 1."""
    found = {}
    for name, k, sign in _components(motion.body):
        values = (sign * motion.params.expression[:, k].double().numpy() / UNITS).clip(0.0, 1.0)
        if values.any():
            found[name] = values
    return found


def _avatar(motion: Motion, moving: RigMotion, still: Motion) -> RigSurface:
    """The person's surface at rest, with morph targets for its face instead of a motion's."""
    surface = surface_on(still, moving)
    body, target = still.shaped_body, moving.target
    weights = body.skinning_weights
    turns = np.einsum("vj,jab->vab", weights, target.rest)
    shapes = {
        name: UNITS * sign * np.einsum("vab,vb->va", turns, body.expression_directions[..., k])
        for name, k, sign in _components(body)
    }
    shapes[_JAW] = _opened(body, moving) - surface.vertices
    none = np.zeros((1, len(shapes)), np.float32)
    morphs = Morphs(
        names=tuple(shapes),
        directions=np.stack(list(shapes.values())).astype(np.float32),
        weights=none,
        units=(UNITS,) * (len(shapes) - 1) + (_OPEN,),
    )
    return replace(surface, morphs=morphs)


def _opened(body: BodyModel, moving: RigMotion) -> Float[np.ndarray, "V 3"]:
    target = moving.target
    places = np.stack([target.places[target.of_joint[name]] for name in JOINT])
    turns = target.rest.copy()
    turns[JOINT["jaw"]] = turns[JOINT["jaw"]] @ Rotation.from_rotvec([_OPEN, 0.0, 0.0]).as_matrix()
    return bent(body, turns, places)


def _extension(motion: Motion, moving: RigMotion, surface: RigSurface) -> dict[str, Any]:
    names = list(surface.morphs.names)

    def expression(name: str, weight: float = 1.0) -> dict[str, Any]:
        return {"morphTargetBinds": [{"node": MESH, "index": names.index(name), "weight": weight}]}

    free = is_free(motion.body)
    presets = {"aa": (_JAW, 1.0)} | ({name: of for name, of in _FREE_PRESETS.items() if of[0] in names} if free else {})
    eyes = moving.target.places[[moving.target.names.index(name) for name in _EYES]].mean(0)
    head = moving.target.places[moving.target.names.index("head")]
    turn = {"inputMaxValue": 90.0, "outputScale": 30.0}
    ranges = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
    return {
        "specVersion": "1.0",
        "meta": meta_of(motion),
        "humanoid": {"humanBones": _bones(moving)},
        "expressions": {
            "preset": {name: expression(*of) for name, of in presets.items()},
            "custom": {name: expression(name) for name in names if name != _JAW},
        },
        "lookAt": {"offsetFromHeadBone": (eyes - head).tolist(), "type": "bone"}
        | {f"rangeMap{name}": turn for name in ranges},
        "firstPerson": {"meshAnnotations": [{"node": MESH, "type": "auto"}]},
    }


# --- what may be done with it ---


def is_free(body: BodyModel) -> bool:
    """Whether it is one of the bodies that come with tcfit."""
    return body.source is not None and FREE_FOLDER in body.source.resolve().parents


def meta_of(motion: Motion) -> dict[str, Any]:
    """VRM's terms of use: those of the body's files, with a reminder that the person was not asked."""
    person = "The shape is that of a person who was filmed: ask them before others use it."
    common = {
        "name": f"{motion.name} (tcfit)",
        "version": "1",
        "authors": ["made with tcfit"],
        "licenseUrl": "https://vrm.dev/licenses/1.0/",
        "avatarPermission": "onlyAuthor",
        "allowExcessivelyViolentUsage": False,
        "allowExcessivelySexualUsage": False,
        "allowPoliticalOrReligiousUsage": False,
        "allowAntisocialOrHateUsage": False,
        "creditNotation": "required",
    }
    if is_free(motion.body):
        return common | {
            "copyrightInformation": f"Body of tcfit, made from MakeHuman (CC0 1.0). {person}",
            "thirdPartyLicenses": "The free body that comes with tcfit: Apache-2.0.",
            "otherLicenseUrl": "https://www.apache.org/licenses/LICENSE-2.0",
            "commercialUsage": "corporation",
            "allowRedistribution": True,
            "modification": "allowModificationRedistribution",
        }
    licence = _OF_KINDS[motion.body.kind]
    return common | {
        "copyrightInformation": f"Made from the body model {licence.names}, which has a licence of its own. {person}",
        "thirdPartyLicenses": (
            f"{licence.names}: for non-commercial scientific research only, not to be redistributed. Holders "
            "of another licence follow that."
        ),
        "otherLicenseUrl": licence.url,
        "commercialUsage": "personalNonProfit",
        "allowRedistribution": False,
        "modification": "prohibited",
    }
