"""Anatomical joint centres: between their landmarks at rest, on any mesh, and carried rigidly by their bones."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting_core.body import rotations
from fitting_core.body.files.reading import load_body
from fitting_core.body.markers.joint_centres import CENTRES, joint_centres_in_space, with_joint_centres
from fitting_core.body.markers.marker_set import MarkerSet, marker_places
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.motion import rest_joints
from fitting_core.shipped import FREE_FOLDER
from tests.samples.scenes import random_params

LANDMARKS = {"knee": ("KNE", "KNM"), "ankle": ("ANK", "MED"), "elbow": ("ELB", "ELM"), "wrist": ("WRA", "WRB")}
GENDERS = ("NEUTRAL", *(pytest.param(gender, marks=pytest.mark.thorough) for gender in ("MALE", "FEMALE", "CHILD")))


def at_rest(body: BodyModel, params: BodyParams) -> dict[str, np.ndarray]:
    """By SMPL-X's joint, in one frame."""
    places = joint_centres_in_space(body, replace(BodyParams.neutral(1), betas=params.betas[:1]))[0]
    return dict(zip(CENTRES.values(), places, strict=True))


@pytest.mark.parametrize("gender", GENDERS)
def test_centres_lie_between_landmarks_of_the_resting_body(gender: str):
    """Of heavy and slim people as well. A marker sits on a vertex, which is up to 8 mm from its landmark."""
    body = load_body(FREE_FOLDER / f"SMPLX_{gender}.npz")
    for shape in (0.0, -2.0, 2.0):
        params = BodyParams.neutral(1)
        params.betas[0, 1:4] = shape
        centres, skin = at_rest(body, params), Mesh(body)(params)[0].numpy()
        for side in ("left", "right"):
            for part, names in LANDMARKS.items():
                ends = MarkerSet({name: f"{side[0].upper()}{name}" for name in names}, radius=0.0)
                a, b = marker_places(body, params, ends)[0]
                assert np.linalg.norm(centres[f"{side}_{part}"] - (a + b) / 2) < 0.01
            hip = centres[f"{side}_hip"]
            thigh = body.skinning_weights[:, [JOINT[f"{side}_{n}"] for n in ("hip", "knee")]].sum(1) > 0.5
            level = skin[thigh & (abs(skin[:, 1] - hip[1]) < 0.03)]
            assert abs(hip[0]) == pytest.approx(abs(level[:, 0]).max() / 2, abs=0.01), "of the trochanters' distance"
            shoulder = rest_joints(body, params)[0, JOINT[f"{side}_shoulder"]].numpy()
            np.testing.assert_allclose(centres[f"{side}_shoulder"], shoulder, atol=1e-6)


def test_bones_carry_centres_rigidly(free_body: BodyModel):
    """In a bent limb as in a straight one, the centre has the same place in the frame of the bone above it."""
    params = random_params(3)
    params = replace(params, betas=params.betas[:1].expand(3, -1).clone(), expression=0 * params.expression)
    double = params.to(dtype=torch.float64)
    skeleton = Mesh(free_body, dtype=torch.float64).skeleton(
        rotations.exp(full_pose(free_body, double)), torch.cat([double.betas, double.expression], 1)
    )
    rest = at_rest(free_body, params)
    moved = joint_centres_in_space(free_body, params).swapaxes(0, 1)
    for name, found in zip(CENTRES.values(), moved, strict=True):
        bone = int(free_body.parents[JOINT[name]])
        turned = np.einsum("tij,j->ti", skeleton.world[:, bone].numpy(), rest[name])
        expected = turned + skeleton.offset[:, bone].numpy() + double.camera_translation.numpy()
        np.testing.assert_allclose(found, expected, atol=1e-9, err_msg=name)


def test_centres_are_those_of_any_mesh_of_the_same_shape(free_body: BodyModel):
    """A user's SMPL-X file has other vertices, and hips 14 cm apart: neither moves the centres."""
    params = random_params(2)
    regressor = free_body.joint_regressor.copy()
    hips = [JOINT["left_hip"], JOINT["right_hip"]]
    regressor[hips] = np.array([[0.81, 0.19], [0.19, 0.81]]) @ regressor[hips]
    order = np.random.default_rng(0).permutation(len(free_body.template))
    place = np.argsort(order)
    other = replace(
        free_body,
        template=free_body.template[order],
        shape_directions=free_body.shape_directions[order],
        expression_directions=free_body.expression_directions[order],
        skinning_weights=free_body.skinning_weights[order],
        joint_regressor=regressor[:, order],
        faces=place[free_body.faces],
    )
    upper = replace(params, body_pose=params.body_pose.clone())
    upper.body_pose[:, :6] = 0.0  # the hips' own turns are about the joints
    np.testing.assert_allclose(
        joint_centres_in_space(other, upper), joint_centres_in_space(free_body, upper), atol=1e-9
    )


def test_a_landmark_that_the_skin_lacks_leaves_the_joint(tiny_body: BodyModel):
    bare = replace(tiny_body, faces=tiny_body.faces[:0])
    params = random_params(2)
    limbs = [JOINT[name] for name in CENTRES.values()]
    joints = Mesh(bare, dtype=torch.float64).joints(params).numpy()[:, limbs]
    np.testing.assert_allclose(joint_centres_in_space(bare, params), joints, atol=1e-9)
    np.testing.assert_array_equal(rest_joints(with_joint_centres(bare), params), rest_joints(bare, params))
