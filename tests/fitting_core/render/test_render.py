"""Rendered outlines and depths against what projection says they must be."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.render import renderer as render
from fitting_core.render.renderer import DrawnMesh, Renderer, off_screen_gl, scaled_camera

needs_gl = pytest.mark.usefixtures("off_screen_gl")

OFF_CENTER = Camera(focal=(310.0, 290.0), center=(95.5, 40.25), size=(160, 120))
BALL_CENTER, BALL_RADIUS = np.array([-0.12, 0.21, 2.0]), 0.3


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(OFF_CENTER)


def ball() -> DrawnMesh:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=BALL_RADIUS)
    return DrawnMesh(vertices=np.asarray(sphere.vertices) + BALL_CENTER, faces=np.asarray(sphere.faces))


def box(center: list[float], half: float) -> DrawnMesh:
    cube = trimesh.creation.box((2 * half,) * 3)
    return DrawnMesh(vertices=np.asarray(cube.vertices) + center, faces=np.asarray(cube.faces))


def analytic_ball_depth(shift_x: float = 0.0, shift_y: float = 0.0) -> np.ndarray:
    """z (H, W) of the nearer intersection of the pixels' rays with the ball; infinite where they miss.

    Rays go through the pixels' middles, shifted by so many pixels.
    """
    x, y = np.meshgrid(np.arange(OFF_CENTER.size[0]) + 0.5 + shift_x, np.arange(OFF_CENTER.size[1]) + 0.5 + shift_y)
    flat = (np.stack([x, y], -1) - OFF_CENTER.center) / OFF_CENTER.focal
    d = np.concatenate([flat, np.ones((*x.shape, 1))], -1)
    a, b = (d * d).sum(-1), d @ BALL_CENTER
    root = b**2 - a * (BALL_CENTER @ BALL_CENTER - BALL_RADIUS**2)
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


@needs_gl
def test_outline_and_depth_of_a_ball_off_the_principal_point(renderer: Renderer) -> None:
    picture = renderer.draw([ball()])
    within = [analytic_ball_depth(x, y) for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)]
    nearest, farthest = np.min(within, axis=0), np.max(within, axis=0)
    # The polyhedron lies up to 0.05 mm inside the ball.
    assert (picture.depth[np.isfinite(farthest)] > nearest[np.isfinite(farthest)] - 1e-3).all()
    assert (picture.depth[np.isfinite(farthest)] < farthest[np.isfinite(farthest)] + 1e-3).all()
    assert np.isinf(picture.depth[np.isinf(nearest)]).all()
    # Coverage, with its soft edge, has the ball's area.
    assert picture.alpha.sum() / 255 == pytest.approx(np.isfinite(analytic_ball_depth()).sum(), rel=0.003)


@needs_gl
def test_depth_of_a_box_is_that_of_its_front_face(renderer: Renderer) -> None:
    depth = renderer.draw([box([0.05, 0.1, 3.0], 0.25)]).depth
    u, v = np.array([0.05, 0.1]) / 2.75 * OFF_CENTER.focal + OFF_CENTER.center
    assert depth[int(v), int(u)] == pytest.approx(2.75, abs=1e-3)
    rows, columns = np.nonzero(np.isfinite(depth))
    # Left and right edges of the front face, which is larger than the back one.
    left, right = (np.array([-0.2, 0.3]) / 2.75) * OFF_CENTER.focal[0] + OFF_CENTER.center[0]
    assert abs(columns.min() - left) < 1.01 and abs(columns.max() + 1 - right) < 1.01
    top, bottom = (np.array([-0.15, 0.35]) / 2.75) * OFF_CENTER.focal[1] + OFF_CENTER.center[1]
    assert abs(rows.min() - top) < 1.01 and abs(rows.max() + 1 - bottom) < 1.01


@needs_gl
def test_background_shows_around_the_mesh_and_through_it(renderer: Renderer) -> None:
    background = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    surface = ball()
    solid = renderer.render(surface.vertices, surface.faces, background=background)
    empty = renderer.draw([surface]).alpha == 0
    np.testing.assert_array_equal(solid[empty], background[empty])
    half = renderer.render(surface.vertices, surface.faces, background=background, opacity=0.5).astype(float)
    inside = renderer.draw([surface]).alpha == 255
    assert np.abs(half - (solid / 2 + background / 2))[inside].max() < 1.5


@needs_gl
def test_renderers_of_two_sizes_live_side_by_side_and_in_threads(renderer: Renderer) -> None:
    """pyrender ends every OpenGL context of a process when one of them ends."""
    before = renderer.draw([ball()])
    other = Renderer(scaled_camera(OFF_CENTER, 2.0))
    with ThreadPoolExecutor(1) as pool:
        large = pool.submit(other.draw, [ball()]).result()
    del other
    after = renderer.draw([ball()])
    assert large.rgb.shape == (240, 320, 3)
    assert (large.alpha > 0).sum() == pytest.approx(4 * (before.alpha > 0).sum(), rel=0.05)
    np.testing.assert_array_equal(after.depth, before.depth)
    np.testing.assert_array_equal(after.rgb, before.rgb)


def test_without_opengl_the_error_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "_PROBE", "raise SystemExit('libEGL is missing')")
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(render, "_target", render._Target)  # not the one that is open already
    off_screen_gl.cache_clear()
    try:
        assert off_screen_gl() is None
        with pytest.raises(InputError, match=r"libEGL is missing.*apt-get install libegl1 libgl1.*libosmesa6"):
            Renderer(OFF_CENTER)
    finally:
        off_screen_gl.cache_clear()


def test_a_crash_of_the_probe_is_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "_PROBE", "import os; os.abort()")
    reason = render.probe("egl")
    assert reason is not None and "exit status" in reason
