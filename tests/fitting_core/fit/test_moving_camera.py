"""A fit that is told how its camera moves: the body is even, and where it is, in the world."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import CameraPath, path_of
from fitting_core.config.schema import SolverSettings, Temporal
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip, rerun_events
from fitting_core.fit.stages import Stages
from fitting_core.io.motion.imported_motion import from_still
from fitting_core.metrics import jitter
from tests.samples import scenes
from tests.samples.scenes import CAMERA, arms_in_motion, clip_of, hidden, keypoints_of

FRAMES = 4
QUICK = replace(
    scenes.QUICK,
    settings=SolverSettings(iterations=10),
    temporal=Temporal(mode="global", space="camera", stages=(5,), weight=2000.0),
)


def shaking() -> CameraPath:
    """Turns and goes to and fro from frame to frame."""
    random = np.random.default_rng(3)
    turns = Rotation.from_rotvec(0.05 * random.standard_normal((FRAMES, 3))).as_matrix()
    turns[0], moves = np.eye(3), 0.1 * random.standard_normal((FRAMES, 3))
    moves[0] = 0
    return path_of(turns, moves)


def test_the_fit_is_even_in_the_world(free_body: BodyModel):
    truth, moving = arms_in_motion(FRAMES), replace(CAMERA, path=shaking())
    keypoints = hidden(keypoints_of(free_body, from_still(free_body, truth, moving)), kp.HANDS, kp.FACE)
    true = joints_in_space(free_body, truth)
    told = replace(clip_of(keypoints), camera=moving)
    fit = fit_clip(told, free_body, QUICK)
    found = moving.to_still(joints_in_space(free_body, fit.last.params))
    # Without the path, E_T pulls every joint away from where the image shows it.
    blind = joints_in_space(free_body, fit_clip(clip_of(keypoints), free_body, QUICK).last.params)
    assert jitter(found) < 1.5 * jitter(true) < 0.5 * jitter(blind)
    assert fit.camera.path == moving.path

    again = drained(rerun_events(told, free_body, QUICK, fit.last.params, range(1, 3))).params
    refitted = moving.to_still(joints_in_space(free_body, again))
    assert abs(refitted - found).max() < 0.05
    np.testing.assert_array_equal(refitted[[0, 3]], found[[0, 3]])


def test_a_part_of_a_clip_has_its_part_of_the_path(free_body: BodyModel):
    moving = replace(CAMERA, path=shaking())
    keypoints = hidden(keypoints_of(free_body, arms_in_motion(FRAMES)), kp.HANDS, kp.FACE)
    part = Stages.of(keypoints, moving, free_body, QUICK).within(range(1, 3))
    assert part.context.camera.path == shaking()[1:3]
