"""A body posed through points: its derivatives, what comes back, and what the points leave open."""

from dataclasses import replace

import numpy as np
import torch

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, N_JOINTS, BodyModel
from fitting_core.body.params import full_pose
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Joint, keypoint_points, vertex
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.starts.posing import pose_through
from tests.samples.scenes import arms_in_motion, random_params


def test_the_whole_derivative_by_the_pose(tiny_body: BodyModel):
    """With the way through the pose correctives, against central differences."""
    params = random_params(2)
    points = BodyPoints(tiny_body, [vertex(i) for i in (3, 77, 200, 431)] + [Joint(JOINT["left_wrist"])])
    pose, coefficients = full_pose(tiny_body, params), torch.cat([params.betas, params.expression], 1)
    orient = rotations.exp(pose[:, 0])
    posed = points.forward(orient, pose[:, 1:], coefficients)
    found = points.corrective_jacobian(posed)
    eye = torch.eye(3, dtype=pose.dtype).expand(2, 5, 3, 3)
    found[:, points.entry_point, :, points.entry_joint] += points.rotation_entries(posed, eye).transpose(0, 1)
    for joint in range(1, N_JOINTS):
        for axis in range(3):
            step = torch.zeros_like(pose[:, 1:])
            step[:, joint - 1, axis] = 1e-6
            ends = [points.forward(orient, pose[:, 1:] + s * step, coefficients).points for s in (1, -1)]
            torch.testing.assert_close(found[:, :, :, joint, axis], (ends[0] - ends[1]) / 2e-6, rtol=0, atol=1e-7)


def test_a_motion_comes_back_through_its_keypoints(free_body: BodyModel):
    """Seen from behind too: the start is turned as the points are. Of unknown points nothing is asked."""
    params = arms_in_motion(4, depth=3.5)
    turned = rotations.yaw(160.0, params.global_orient) @ rotations.exp(params.global_orient)
    params = replace(params, global_orient=rotations.log(turned))
    places, exists = keypoints_in_space(free_body, params)
    points = keypoint_points(free_body)
    chosen = [i for i in range(kp.HANDS.stop) if exists[i]]
    places[:, kp.INDEX["left_ear"]] = np.nan
    found = pose_through(free_body, [p for i in chosen if (p := points[i])], places[:, chosen])
    off = np.linalg.norm(joints_in_space(free_body, found.params) - joints_in_space(free_body, params), axis=-1)
    assert found.off.max() < 0.005 and off[:, :22].mean() < 0.01 and off.max() < 0.06
    assert (found.params.betas == found.params.betas[:1]).all()
