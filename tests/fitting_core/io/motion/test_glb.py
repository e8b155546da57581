"""The GLB of one person and of several, played by an evaluator of its own, against the fit's mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting import same_hemisphere
from fitting_core.body.model import JOINTS, BodyModel
from fitting_core.camera import path_of
from fitting_core.ground.level import Level
from fitting_core.ground.level import upright as make_upright
from fitting_core.io.motion.glb import write_glb, write_people_glb
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.gltf_player import Player
from tests.fitting_core.io.motion.motions import meshes, swinging


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    return swinging(free_body).in_axes("y-up")


@pytest.fixture(scope="module")
def played(upright: Motion, tmp_path_factory: pytest.TempPathFactory) -> Player:
    path = tmp_path_factory.mktemp("glb") / "swing.glb"
    write_glb(path, upright)
    return Player.of(path)


def off(player: Player, motion: Motion) -> np.ndarray:
    """Each frame's farthest vertex, metres."""
    shown = [player.vertices(float(time)) for time in player.times]
    return np.linalg.norm(shown - meshes(motion), axis=2).max(1)


def test_vertices_are_as_near_as_it_says_and_within_a_millimetre(played: Player, upright: Motion):
    found = off(played, upright).max()
    assert found < 1e-3 and played.document.asset.extras["largest_deviation_m"] == pytest.approx(found, abs=2e-6)  # pyright: ignore[reportOptionalSubscript]


def test_joints_and_their_names(played: Player, upright: Motion):
    document = played.document
    assert [document.nodes[n].name for n in document.skins[0].joints] == list(JOINTS)  # pyright: ignore[reportOptionalIterable]
    assert np.allclose(played.joints(float(played.times[5])), upright.joints()[5], atol=1e-3)


def test_time_is_the_video_s(played: Player, upright: Motion):
    assert np.allclose(played.times, np.arange(7) / 29.97)
    extras = played.document.asset.extras
    assert extras["frame_rate"] == 29.97 and extras["first_frame"] == 12 and extras["axes"] == "y-up"  # pyright: ignore[reportOptionalSubscript]


def test_signs_of_quaternions_do_not_jump():
    turns = np.array([[[0, 0, 0, 1.0]], [[0, 0, 0.1, -0.99]], [[0, 0, 0.2, -0.98]]])
    even = same_hemisphere(turns)
    assert ((even[1:] * even[:-1]).sum(-1) > 0).all() and np.array_equal(abs(even), abs(turns))


def test_the_camera_sees_what_the_fit_s_camera_sees(played: Player, upright: Motion):
    lens = played.document.cameras[0].perspective
    _, height = upright.camera.size
    point = upright.joints()[0, 15]
    assert lens.aspectRatio == pytest.approx(640 / 480)  # pyright: ignore[reportOptionalMemberAccess]
    below = height / 2 - point[1] / -point[2] * (height / 2 / np.tan(lens.yfov / 2))  # pyright: ignore[reportOptionalMemberAccess]
    in_camera = point * (1, -1, -1)
    assert below == pytest.approx(910.0 * in_camera[1] / in_camera[2] + height / 2)


@pytest.mark.parametrize("height", [None, 1.6])
def test_the_camera_stands_above_the_floor_as_it_was_held(tiny_body: BodyModel, tmp_path: Path, height: float | None):
    level = Level(turn=make_upright(np.array([0.1, -0.9, -0.4])), height=height, text="")
    motion = replace(swinging(tiny_body), level=level)
    write_glb(tmp_path / "x.glb", motion)
    player = Player.of(tmp_path / "x.glb")
    node = next(node for node in player.document.nodes if node.camera is not None)
    # A glTF camera looks along its own -z with y up.
    seen = (motion.in_axes("y-up").joints() - node.translation) @ Rotation.from_quat(node.rotation).as_matrix()
    assert np.allclose(seen * (1, -1, -1), motion.joints(), atol=1e-5)
    assert node.translation[1] == pytest.approx(height or 0.0)  # pyright: ignore[reportOptionalSubscript]


def test_expressions_are_named_and_animated(played: Player, upright: Motion):
    extras = played.document.meshes[0].extras
    for frame in (0, 4):
        weights = played.values(1, "weights", float(played.times[frame]))
        assert weights is not None and len(weights) == len(extras["targetNames"])  # pyright: ignore[reportOptionalSubscript]
        value = dict(zip(extras["targetNames"], weights * extras["targetUnits"], strict=True))  # pyright: ignore[reportOptionalSubscript]
        found = [value[f"expression_{k}"] - value.get(f"expression_{k}_negative", 0.0) for k in range(10)]
        assert np.allclose(found, upright.params.expression[frame], atol=1e-5)


def test_a_body_without_correctives_and_expressions(tiny_body: BodyModel, tmp_path: Path):
    plain = replace(
        tiny_body,
        pose_directions=np.zeros_like(tiny_body.pose_directions),
        expression_directions=np.zeros_like(tiny_body.expression_directions),
    )
    motion = swinging(plain).in_axes("y-up")
    write_glb(tmp_path / "x.glb", motion)
    player = Player.of(tmp_path / "x.glb")
    assert player.document.meshes[0].primitives[0].targets in (None, [])
    assert off(player, motion).max() < 1e-5


def test_more_than_four_weights_are_stated(tiny_body: BodyModel, tmp_path: Path):
    weights = tiny_body.skinning_weights + 0.02
    many = replace(tiny_body, skinning_weights=weights / weights.sum(1, keepdims=True))
    motion = swinging(many).in_axes("y-up")
    write_glb(tmp_path / "x.glb", motion)
    player = Player.of(tmp_path / "x.glb")
    largest = player.document.asset.extras["largest_deviation_m"]  # pyright: ignore[reportOptionalSubscript]
    assert largest > 0.01 and off(player, motion).max() == pytest.approx(largest, abs=1e-5)


def test_what_stops_the_writing_leaves_nothing(tiny_body: BodyModel, tmp_path: Path):
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    (tmp_path / "x.glb").write_bytes(b"older")
    with pytest.raises(KeyboardInterrupt):
        write_glb(tmp_path / "x.glb", swinging(tiny_body), stop)
    assert [p.name for p in tmp_path.iterdir()] == ["x.glb"] and (tmp_path / "x.glb").read_bytes() == b"older"


# --- several people ---


@pytest.fixture(scope="module")
def people(free_body: BodyModel) -> list[Motion]:
    """Frames 12 to 18, and 15 to 19 of a second person at another place."""
    level = Level(turn=make_upright(np.array([0.1, -0.9, -0.4])), height=1.6, text="")
    one, other = swinging(free_body), swinging(free_body, 5, amplitude=0.2)
    moved = replace(other.params, camera_translation=other.params.camera_translation + 1.0)
    return [
        replace(one, level=level, name="person 1"),
        replace(other, params=moved, first_frame=15, level=level, name="person 2"),
    ]


@pytest.fixture(scope="module")
def both(people: list[Motion], tmp_path_factory: pytest.TempPathFactory) -> Player:
    path = tmp_path_factory.mktemp("glb") / "two.glb"
    write_people_glb(path, people, name="two")
    return Player.of(path)


@pytest.mark.parametrize(("person", "frame"), [(0, 12), (0, 17), (1, 15), (1, 18)])
def test_each_is_where_the_fit_has_them(both: Player, people: list[Motion], person: int, frame: int):
    motion = people[person]
    shown = both.vertices((frame - 12) / motion.frame_rate, person)
    expected = meshes(motion.in_axes("y-up"))[frame - motion.first_frame]
    assert np.linalg.norm(shown - expected, axis=1).max() < 1e-3


def test_who_is_not_there_is_nowhere(both: Player, people: list[Motion]):
    rate = people[0].frame_rate
    sizes = {
        (person, frame): np.ptp(both.vertices((frame - 12 + 0.01) / rate, person), axis=0).max()
        for person in (0, 1)
        for frame in (12, 14, 15, 18, 19)
    }
    hidden = {place for place, size in sizes.items() if size < 1e-6}
    assert hidden == {(1, 12), (1, 14), (0, 19)}


def test_a_camera_that_moves_goes_on_while_anybody_is_there(people: list[Motion], tmp_path: Path):
    turns = np.stack([np.eye(3)] * 8)
    way = np.stack([np.linspace(0, 0.7, 8), np.zeros(8), np.zeros(8)], 1)
    path = path_of(turns, way)
    one, other = (
        replace(motion, camera=replace(motion.camera, path=path[motion.first_frame - 12 :][: len(motion)]))
        for motion in people
    )
    write_people_glb(tmp_path / "two.glb", [one, other], name="two")
    player = Player.of(tmp_path / "two.glb")
    rate = one.frame_rate
    for motion in (one, other):
        places = motion.in_axes("y-up").camera_place
        for t in (0, len(motion) - 1):
            shown = player.values(2, "translation", (motion.first_frame + t - 12) / rate)
            assert np.allclose(shown, places[t], atol=1e-6)  # pyright: ignore[reportArgumentType]
