"""The scene in a real browser: exact overlay, colours at vertices, the modes."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from fitting_core.camera import Camera
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.poster import Poster, Posters
from tcfit_app.review.scene.space import Space
from tests.drivers.screens import (
    PLATE,
    Screen,
    expected_body,
    overlap,
    plain_body,
    plate_errors,
    screen,
    seen_body,
    seen_plate,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

WINDOW = (800, 568)
CAMERA = Camera(focal=(620.0, 600.0), center=(150.0, 260.0), size=(640, 480))


def capsule(x: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (camera space) and faces of a leaning capsule."""
    shape = trimesh.creation.capsule(height=0.6, radius=0.18, count=(24, 24))
    shape.apply_transform(trimesh.transformations.euler_matrix(1.1, 0.5, 0.3))
    return np.add(shape.vertices, (x, -0.1, z)).astype(np.float32), np.asarray(shape.faces)


VERTICES, FACES = capsule(0.55, 1.9)
BODY = plain_body(VERTICES, FACES)


@pytest.fixture(scope="module")
def shown(browser: "Browser") -> Iterator[Screen]:
    with screen(browser, WINDOW) as running:
        yield running


def test_overlay_is_exact_with_a_principal_point_off_the_middle(shown: Screen):
    posters = Posters(camera=CAMERA, posters=(Poster(image=PLATE, bodies=(BODY,)),))
    shown.show(posters)
    shown.settle()
    assert overlap(seen_body(shown.picture()), expected_body(posters, shown.view.cameras.pose, WINDOW)) > 0.98
    shown.view.zoom_to((250.0, 120.0, 420.0, 300.0))
    shown.settle()
    assert overlap(seen_body(shown.picture()), expected_body(posters, shown.view.cameras.pose, WINDOW)) > 0.98
    moved = replace(BODY, vertices=VERTICES + np.float32(0.05))
    shown.show(Posters(camera=CAMERA, posters=(Poster(image=PLATE, bodies=(moved,)),)))
    shown.settle()
    assert overlap(seen_body(shown.picture()), expected_body(posters, shown.view.cameras.pose, WINDOW)) < 0.95
    shown.view.cameras.reset()


def test_the_image_lies_where_its_pixels_are(shown: Screen):
    posters = Posters(camera=CAMERA, posters=(Poster(image=PLATE),))
    shown.show(posters)
    shown.view.cameras.reset()
    shown.settle()
    assert plate_errors(shown.picture(), posters, shown.view.cameras.pose) < 0.5


def test_pictures_that_are_zoomed_stay_in_their_windows(shown: Screen):
    other = plain_body(*capsule(0.3, 2.6))
    posters = Posters(camera=CAMERA, posters=tuple(Poster(image=PLATE, bodies=(b,)) for b in (BODY, other)))
    shown.show(posters)
    shown.view.zoom_to((250.0, 120.0, 420.0, 300.0))
    shown.settle()
    expected = expected_body(posters, shown.view.cameras.pose, WINDOW)
    seen = seen_body(shown.picture())
    assert overlap(seen, expected) > 0.97
    gap = posters.divide(shown.view.cameras.window).windows
    between = seen[:, round(gap[0][2]) + 1 : round(gap[1][0]) - 1]
    assert between.shape[1] > 3 and not between.any()
    shown.view.cameras.reset()


def test_an_outline_has_the_video_between_its_lines(shown: Screen):
    posters = Posters(camera=CAMERA, posters=(Poster(image=PLATE, bodies=(replace(BODY, outline=True),)),))
    shown.show(posters)
    shown.settle()
    picture = shown.picture()
    body = expected_body(posters, shown.view.cameras.pose, WINDOW)
    lines = seen_body(picture)
    rim = body & ~ndimage.binary_erosion(body, iterations=4)
    near = ndimage.binary_dilation(body, iterations=3)
    assert lines.any() and not (lines & ~near).any(), "it is where the body is"
    assert lines[body & ~rim].mean() < 0.02, "and nothing is drawn within"
    edge = body & ~ndimage.binary_erosion(body)
    assert ndimage.binary_dilation(lines, iterations=3)[edge].mean() > 0.95, "and it is closed"
    assert seen_plate(picture)[body & ~rim].mean() > 0.9, "the picture is seen there"
    shown.show(Posters(camera=CAMERA, posters=(Poster(image=PLATE, bodies=(BODY,)),)))
    shown.settle()
    assert overlap(seen_body(shown.picture()), body) > 0.97


def test_values_become_colours_and_go_again(shown: Screen):
    values = np.where(VERTICES[:, 1] < -0.1, 0.0, 0.1).astype(np.float32)
    for painted in (True, False):
        layer = BodyLayer(
            vertices=VERTICES, faces=FACES, color=(60, 60, 255), opacity=1.0, values=values if painted else None
        )
        posters = Posters(camera=CAMERA, posters=(Poster(image=PLATE, bodies=(layer,)),))
        shown.show(posters)
        shown.settle()
        picture = shown.picture().astype(int)
        mask = expected_body(posters, shown.view.cameras.pose, WINDOW)
        yellow = (picture[..., 0] > 140) & (picture[..., 1] > 110)
        assert (0.2 < yellow[mask].mean() < 0.9) == painted


def test_space_hides_the_posters(shown: Screen):
    shown.show(Space(camera=CAMERA, bodies=(BODY,), image=PLATE, ground=0.6))
    shown.settle()
    picture = shown.picture()
    body = seen_body(picture) & (picture[..., 1] < 0.6 * picture[..., 0])
    ys, xs = np.nonzero(body)
    assert body.mean() > 0.02 and abs(xs.mean() - WINDOW[0] / 2) < 60 and ys.mean() < WINDOW[1] / 2
    shown.show(Space(camera=CAMERA, bodies=()))
    shown.settle()
    assert not (seen_body(shown.picture()) & body).any()
