"""The pictures that benchmarks draw show bodies and skeletons where they are."""

import numpy as np
import pytest
import trimesh

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.render.sheets import View
from tests.samples.body_pictures import body_picture, fitted_views, pose_cells, skeleton_picture

needs_gl = pytest.mark.usefixtures("off_screen_gl")


def test_fitted_views_show_everything_in_one_scale():
    points = np.random.default_rng(0).uniform([-0.2, 0, -2], [0.2, 1, 2], (50, 3))
    views = fitted_views(points, (0, 90), size=(120, 160))
    assert views[0].extent == views[1].extent
    for view in views:
        pixels = view.pixels(points)
        assert (pixels > 0).all() and (pixels < view.size).all()
    assert np.ptp(views[1].pixels(points)[:, 0]) > 0.8 * 120, "no larger than needed"


@needs_gl
def test_body_and_skeleton_are_drawn_where_the_view_has_them():
    ball = trimesh.creation.icosphere(radius=0.2)
    view = View(center=(0.0, 0.0, 0.0), extent=2.0, size=(100, 100), degrees=90)
    expected = view.pixels(np.array([[0.0, 0.4, 0.5]]))[0]
    body = body_picture(ball.vertices + np.array([0, 0.4, 0.5]), np.asarray(ball.faces), view)
    line = skeleton_picture(np.array([[0, 0.4, 0.4], [0, 0.4, 0.6]]), np.array([-1, 0]), view)
    for picture in (body, line):
        rows, columns = np.nonzero(picture.min(axis=-1) < 200)
        assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx(tuple(expected), abs=1.0)


@needs_gl
def test_poses_become_captioned_cells(tiny_body: BodyModel):
    cells = pose_cells(Mesh(tiny_body), BodyParams.neutral(2), ["a", "b"], degrees=(0, 45, 90), size=(40, 60))
    assert [cell.caption for cell in cells] == ["a", "b"]
    assert all(cell.picture.shape == (60, 120, 3) and cell.picture.min() < 200 for cell in cells)
