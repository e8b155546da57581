"""Pose and clock of a second view, found from keypoints alone; and pairs that are refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.camera import path_of
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.errors import InputError
from fitting_core.fit.views.pose import meeting, misses
from fitting_core.fit.views.relating import related
from tests.samples.two_views import camera_at, motion, seen_from


def relation(first: Clip, other: Clip, times: np.ndarray | None = None) -> Relation:
    found = related(first, [OtherView(clip=other, times=times)]).views[0].relation
    assert found is not None
    return found


def errors(found: Relation, azimuths: tuple[float, float]) -> tuple[float, float]:
    """Degrees by which the rotation and the direction from camera to camera are off."""
    one, two = (camera_at(azimuth) for azimuth in azimuths)
    turn = two.rotation @ one.rotation.T
    way = two.translation - turn @ one.translation
    cosine = found.shift @ way / np.linalg.norm(found.shift) / np.linalg.norm(way)
    off = Rotation.from_matrix(found.turn @ turn.T).magnitude()
    return float(np.degrees(off)), float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def test_a_view_at_half_the_frame_rate_that_starts_later() -> None:
    count = len(motion())
    first, other = seen_from(10, frames=slice(0, count - 9)), seen_from(80, seed=1, frames=slice(9, None, 2))
    found = relation(first, other)
    assert found.offset == pytest.approx(-9 / 30, abs=0.3 / 30)
    turn, way = errors(found, (10, 80))
    assert turn < 8 and way < 5
    assert turn < 3 * found.rotation_deviation and way < 3 * found.direction_deviation
    assert found.angle == pytest.approx(70, abs=8)
    assert found.overlap == pytest.approx((count - 18) / 30, abs=0.1)
    # The person is 2 % shorter than the average adult.
    assert np.linalg.norm(found.shift) == pytest.approx(2 * 4.5 * np.sin(np.radians(35)), rel=0.1)
    assert found.disagreement < 0.004


def test_frames_at_uneven_times() -> None:
    kept = np.sort(np.random.default_rng(4).choice(len(motion()), 60, replace=False))
    whole = seen_from(80, seed=1)
    uneven = replace(whole, keypoints=whole.keypoints[kept], frame_rate=20.0)
    found = relation(seen_from(10), uneven, times=kept / 30)
    assert found.offset == pytest.approx(-kept[0] / 30, abs=0.3 / 30)
    assert errors(found, (10, 80))[0] < 8


def test_an_estimated_lens_widens_the_deviations() -> None:
    """The other view's lens is really a quarter longer."""
    first, other = seen_from(10), seen_from(80, seed=1)
    focal = (other.camera.focal[0] / 1.25, other.camera.focal[1] / 1.25)
    short = replace(other, camera=replace(other.camera, focal=focal))
    sure = relation(first, short)
    unsure = relation(first, replace(short, camera=replace(short.camera, focal_deviation=0.22)))
    assert (unsure.turn == sure.turn).all() and unsure.offset == sure.offset
    turn, way = errors(unsure, (10, 80))
    assert way > 3 * sure.direction_deviation and way < 2 * unsure.direction_deviation
    assert turn < 2 * unsure.rotation_deviation and sure.rotation_deviation < unsure.rotation_deviation < 20


def test_a_view_of_another_person_is_refused() -> None:
    with pytest.raises(InputError, match=r"from 80 as another view of from 10: .* \d+% alike, .* \d+ px .* Check"):
        relation(seen_from(10), seen_from(80, seed=1, window="13_26_1"))


def test_a_view_of_a_later_moment_is_refused() -> None:
    half = len(motion()) // 2
    with pytest.raises(InputError, match=r"hardly moves .* Use a part"):
        relation(seen_from(10, frames=slice(0, half)), seen_from(80, seed=1, frames=slice(half, None)))


def test_a_moving_camera_is_refused() -> None:
    clip = seen_from(80)
    still = path_of(np.tile(np.eye(3), (len(clip), 1, 1)), np.zeros((len(clip), 3)))
    with pytest.raises(InputError, match="the camera of from 80 moves"):
        relation(seen_from(10), replace(clip, camera=replace(clip.camera, path=still)))


def test_a_clip_without_a_person_is_refused() -> None:
    with pytest.raises(InputError, match="from 80 shows no person"):
        relation(seen_from(10), seen_from(80, points=slice(0, 0)))


def test_rays_of_a_point_meet_there() -> None:
    one, two = camera_at(10), camera_at(100)
    points = motion()[::20, :25]
    turn = two.rotation @ one.rotation.T
    shift = two.translation - turn @ one.translation
    first, other = (camera(points) for camera in (one, two))
    rays = [inside / np.linalg.norm(inside, axis=-1, keepdims=True) for inside in (first, other)]
    way = shift / np.linalg.norm(shift)
    np.testing.assert_allclose(misses(rays[0], rays[1], turn, way, (1.0, 1.0)), 0, atol=1e-9)
    np.testing.assert_allclose(meeting(rays[0], rays[1] @ turn, -shift @ turn), first, atol=1e-9)
    # A milliradian across the plane of both rays is a milliradian.
    across = np.cross(way, rays[1])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    off = misses(rays[0], rays[1] + 1e-3 * across, turn, way, (1e-9, 1.0))
    np.testing.assert_allclose(abs(off), 1e-3, rtol=0.01)
