"""A motion in other worlds: checked on posed meshes and joints."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.model import BodyModel
from fitting_core.camera import World
from fitting_core.ground.level import Level, level_of, upright
from fitting_core.motion import AXES, OWN_WORLD, stated, stated_by_frame
from tests.fitting_core.io.motion.motions import meshes, swinging


@pytest.mark.parametrize("start", AXES)
@pytest.mark.parametrize("axes", AXES)
def test_the_mesh_turns_as_a_whole(tiny_body: BodyModel, start: str, axes: str):
    motion = swinging(tiny_body).in_axes(start)
    turned = motion.in_axes(axes)
    turn = np.array(AXES[axes].from_camera) @ np.array(AXES[start].from_camera).T
    assert np.linalg.det(turn) == 1
    assert np.allclose(meshes(turned), meshes(motion) @ turn.T, atol=1e-5)
    assert np.allclose(turned.joints(), motion.joints() @ turn.T, atol=1e-5)
    assert np.allclose(turned.pelvis, turned.joints()[:, 0], atol=1e-5)


def test_the_translation_takes_the_pelvis_into_account(free_body: BodyModel):
    motion = swinging(free_body)
    naive = motion.params.camera_translation.numpy() * (1, -1, -1)
    assert abs(motion.in_axes("y-up").params.camera_translation.numpy() - naive).max() > 0.1


def test_there_and_back(tiny_body: BodyModel):
    motion = swinging(tiny_body)
    back = motion.in_axes("z-up").in_axes("camera")
    assert torch.allclose(back.params.camera_translation, motion.params.camera_translation, atol=1e-9)
    assert np.allclose(meshes(back), meshes(motion), atol=1e-5)


def test_a_part_knows_its_frames(tiny_body: BodyModel):
    part = swinging(tiny_body)[2:5]
    assert (len(part), part.first_frame) == (3, 14)
    said = stated_by_frame(part)
    assert said["frames"] == 3 and len(said["translation"]) == 3 and said["frame_rate"] == 29.97
    assert np.allclose(said["pelvis"], part.joints()[:, 0], atol=1e-5)


@pytest.mark.parametrize("axes", AXES)
def test_one_shape_leaves_the_pelvis_where_it_is_in_any_world(tiny_body: BodyModel, axes: str):
    motion = swinging(tiny_body)
    betas = torch.randn(motion.params.betas.shape, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    varied = replace(motion, params=replace(motion.params, betas=betas))
    shaped = varied.in_axes(axes).one_shape
    assert shaped.has_one_shape and not varied.has_one_shape
    assert abs(shaped.in_axes("camera").pelvis - varied.pelvis).max() < 1e-12
    moved = varied.params.camera_translation - shaped.in_axes("camera").params.camera_translation
    assert moved.abs().max() > 1e-3, "the betas must move the pelvis for this to be seen"
    said = stated_by_frame(varied)
    assert said["betas_source"] == "mean of the frames' own" and stated(motion)["betas_source"] == "the fit's"
    assert np.allclose(said["translation"], varied.one_shape.params.camera_translation)


TILT = np.radians(20)
UP = np.array([0.0, -np.cos(TILT), -np.sin(TILT)])
"""In a camera that looks down by 20 degrees."""
FLOOR = Level(turn=upright(UP), height=1.6, text="as it is")


@pytest.mark.parametrize(("axes", "vertical"), [("y-up", 1), ("z-up", 2)])
def test_with_a_floor_heights_are_heights_above_it(free_body: BodyModel, axes: str, vertical: int):
    camera = replace(swinging(free_body), level=FLOOR)
    world = camera.in_axes(axes)
    assert np.allclose(world.joints()[..., vertical], camera.joints() @ UP + 1.6, atol=1e-5)
    assert np.allclose(meshes(world)[..., vertical], meshes(camera) @ UP + 1.6, atol=1e-5)
    assert (
        world.camera_place[vertical] == pytest.approx(1.6) and abs(np.delete(world.camera_place, vertical)).max() == 0
    )
    assert "floor is at height 0" in stated(world)["axes_text"] and stated(world)["ground"] == "as it is"


@pytest.mark.parametrize("start", AXES)
@pytest.mark.parametrize("axes", AXES)
def test_what_is_stated_gets_from_the_camera_into_the_world(tiny_body: BodyModel, start: str, axes: str):
    camera = replace(swinging(tiny_body), level=FLOOR)
    said = stated(camera.in_axes(start).in_axes(axes))
    expected = camera.joints() @ np.array(said["camera_to_world"]).T + said["camera_place"]
    assert np.allclose(camera.in_axes(start).in_axes(axes).joints(), expected, atol=1e-5)


@pytest.mark.parametrize("axes", [OWN_WORLD, "z-up", "y-up"])
def test_a_calibrated_camera_puts_the_motion_into_its_world(free_body: BodyModel, axes: str):
    turn = Rotation.from_rotvec([1.7, 1.0, -0.4])
    one, two, three = ((x, y, z) for x, y, z in turn.as_matrix().tolist())
    world = World(rotation=(one, two, three), translation=(0.3, 0.9, 2.9), up="z")
    plain = swinging(free_body)
    calibrated = replace(plain, camera=replace(plain.camera, world=world), level=level_of(None, world))
    there = turn.inv().apply((plain.joints() - (0.3, 0.9, 2.9)).reshape(-1, 3)).reshape(plain.joints().shape)
    expected = there[..., [0, 2, 1]] * (1, 1, -1) if axes == "y-up" else there
    moved = calibrated.in_axes(axes)
    assert np.allclose(moved.joints(), expected, atol=1e-5)
    assert np.allclose(moved.in_axes("camera").joints(), plain.joints(), atol=1e-5)
    said = stated(moved)
    assert np.allclose(plain.joints() @ np.array(said["camera_to_world"]).T + said["camera_place"], expected, atol=1e-5)
    assert "calibration" in said["axes_text"] and f"{axes[0] if axes != OWN_WORLD else 'z'} up" in said["axes_text"]


def test_without_a_level_the_camera_counts_as_held_level(tiny_body: BodyModel):
    said = stated(swinging(tiny_body).in_axes("y-up"))
    assert said["camera_to_world"] == [list(row) for row in AXES["y-up"].from_camera]
    assert "the camera stands at the origin" in said["axes_text"] and "not known" in said["ground"]
