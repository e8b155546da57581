"""Several people in one GLB, against what each has in a file of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.camera import path_of
from fitting_core.ground.level import Level
from fitting_core.ground.level import upright as make_upright
from fitting_core.io.motion.glb import write_people_glb
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.gltf_player import Player
from tests.fitting_core.io.motion.motions import meshes, swinging


@pytest.fixture(scope="module")
def people(free_body: BodyModel) -> list[Motion]:
    """Frames 12 to 18, and 15 to 19 of somebody who stands elsewhere."""
    level = Level(turn=make_upright(np.array([0.1, -0.9, -0.4])), height=1.6, text="")
    one, other = swinging(free_body), swinging(free_body, 5, amplitude=0.2)
    moved = replace(other.params, camera_translation=other.params.camera_translation + 1.0)
    return [
        replace(one, level=level, name="person 1"),
        replace(other, params=moved, first_frame=15, level=level, name="person 2"),
    ]


@pytest.fixture(scope="module")
def played(people: list[Motion], tmp_path_factory: pytest.TempPathFactory) -> Player:
    path = tmp_path_factory.mktemp("glb") / "two.glb"
    write_people_glb(path, people, name="two")
    return Player.of(path)


@pytest.mark.parametrize(("person", "frame"), [(0, 12), (0, 17), (1, 15), (1, 18)])
def test_each_is_where_the_fit_has_them(played: Player, people: list[Motion], person: int, frame: int):
    motion = people[person]
    shown = played.vertices((frame - 12) / motion.frame_rate, person)
    expected = meshes(motion.in_axes("y-up"))[frame - motion.first_frame]
    assert np.linalg.norm(shown - expected, axis=1).max() < 1e-3


def test_who_is_not_there_is_nowhere(played: Player, people: list[Motion]):
    rate = people[0].frame_rate
    sizes = {
        (person, frame): np.ptp(played.vertices((frame - 12 + 0.01) / rate, person), axis=0).max()
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
            assert np.allclose(shown, places[t], atol=1e-6)
