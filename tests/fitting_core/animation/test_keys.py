"""Fewer keys: what is played of them, by evaluators of their own, against what all keys play."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from fitting_core.animation import keys as thinning
from fitting_core.animation.keys import Animation, Keys, fewer_keys
from fitting_core.animation.rig_keys import feet_held
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.errors import InputError
from fitting_core.ground.contacts import Contacts
from fitting_core.io.motion.glb import write_glb
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.gltf_player import Player
from tests.fitting_core.io.motion.motions import swinging

FRAMES = 60
WITHIN = 0.004


def arm(turns: np.ndarray, places: np.ndarray | None = None) -> Animation:
    """Three joints in a row, 30 cm from each other, the middle one turned about x by these angles; a tip."""
    still = np.tile([0.0, 0, 0, 1], (len(turns), 1))
    bent = Rotation.from_rotvec(turns[:, None] * [1.0, 0, 0]).as_quat()
    return Animation(
        parents=np.array([-1, 0, 1]),
        offsets=np.array([[9.0, 9, 9], [0, 0.3, 0], [0, 0.3, 0]]),
        turns=np.stack([still, bent, still], 1),
        places=np.zeros((len(turns), 3)) if places is None else places,
        point_joints=np.array([0, 1, 2, 2]),
        points=np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0.1, 0.02]]),
    )


def test_what_does_not_move_keeps_its_ends():
    found = fewer_keys(arm(np.full(FRAMES, 0.3)), 0.001)
    assert [k.tolist() for k in (found.places, *found.turns)] == [[0, FRAMES - 1]] * 4 and found.largest < 1e-9


def test_what_moves_evenly_keeps_its_ends():
    way = np.linspace(0, 1, FRAMES)
    found = fewer_keys(arm(0.1 * way, way[:, None] * [1.0, 2, 3]), 0.001)
    assert found.places.tolist() == found.turns[1].tolist() == [0, FRAMES - 1]


def test_a_corner_keeps_its_key():
    angle = np.abs(np.arange(FRAMES) - 23) / 200
    assert 23 in fewer_keys(arm(angle), 0.001).turns[1]


def test_one_frame_and_two():
    for count in (1, 2):
        found = fewer_keys(arm(np.linspace(0, 1, count)), 0.001)
        assert found.count == found.all == 4 * count and found.largest < 1e-9


def test_straight_and_along_the_arc_both_hold():
    """Over 2.6 radians the two differ by decimetres at the tip, so that keys are needed though the turn is even."""
    animation = arm(np.linspace(0, 2.6, FRAMES))
    found = fewer_keys(animation, 0.002)
    assert 2 < len(found.turns[1]) < FRAMES / 3
    bent, kept = animation.turns[:, 1], found.turns[1]
    exact = Rotation.from_quat(bent)
    arc = Slerp(kept, exact[kept])(np.arange(FRAMES))
    straight = Rotation.from_quat(np.stack([np.interp(np.arange(FRAMES), kept, bent[kept, c]) for c in range(4)], 1))
    for played in (arc, straight):
        off = np.linalg.norm(played.apply([0, 0.4, 0.02]) - exact.apply([0, 0.4, 0.02]), axis=1)
        assert off.max() <= 0.002


def test_errors_of_a_chain_are_held_together():
    """Each of twelve joints trembles a little: alone none of them would need a key, together they do."""
    frames = np.arange(FRAMES)
    turns = Rotation.from_rotvec(0.004 * np.cos(np.pi * frames)[:, None] * [1.0, 0, 0]).as_quat()
    chain = Animation(
        parents=np.arange(12) - 1,
        offsets=np.tile([0, 0.1, 0], (12, 1)),
        turns=np.repeat(turns[:, None], 12, 1),
        places=np.zeros((FRAMES, 3)),
        point_joints=np.array([11]),
        points=np.array([[0.0, 0.1, 0]]),
    )
    found = fewer_keys(chain, 0.01)
    assert found.largest <= 0.01 and found.count > 0.1 * found.all
    alone = replace(chain, turns=np.where(np.arange(12)[:, None] == 0, chain.turns, [0.0, 0, 0, 1]))
    assert fewer_keys(alone, 0.01).count == 2 * 13


def test_keys_come_back_where_the_first_order_is_not_enough(monkeypatch: pytest.MonkeyPatch):
    draw = np.random.default_rng(1)
    animation = arm(np.cumsum(draw.normal(0, 0.2, FRAMES)))
    kept = []
    for margin in (0.96, 3.0):
        monkeypatch.setattr(thinning, "_MARGIN", margin)
        found = fewer_keys(animation, 0.02)
        kept.append(found.count)
        assert found.largest <= 0.02
    assert kept[0] < animation.turns.shape[0] * 4


@pytest.mark.parametrize("within", [0.0, -0.001, 0.2, float("nan")])
def test_bounds_that_are_none_are_explained(within: float):
    with pytest.raises(InputError, match="at most 100 mm"):
        fewer_keys(arm(np.zeros(3)), within)


def test_feet_keep_keys_where_they_begin_and_end_to_stand():
    standing = np.zeros((FRAMES, 2), bool)
    standing[10:20, 0] = standing[30:31, 0] = standing[:5, 1] = True
    contacts = Contacts(probability=standing.astype(float), standing=standing, let_go=np.zeros_like(standing))
    assert feet_held(contacts) == {JOINT["left_foot"]: [10, 19, 30], JOINT["right_foot"]: [0, 4]}
    assert feet_held(None) == {}
    found = fewer_keys(arm(np.zeros(FRAMES)), 0.001, held={1: [10, 19]})
    held = [0, 10, 19, FRAMES - 1]
    assert [k.tolist() for k in (found.places, *found.turns)] == [held, held, held, [0, FRAMES - 1]]


# --- of a body, in a file ---


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    standing = np.zeros((FRAMES, 2), bool)
    standing[11:30, 0] = True
    motion = swinging(free_body, FRAMES, amplitude=0.3).in_axes("y-up")
    return replace(
        motion, contacts=Contacts(probability=standing.astype(float), standing=standing, let_go=np.zeros_like(standing))
    )


@pytest.fixture(scope="module")
def written(upright: Motion, tmp_path_factory: pytest.TempPathFactory) -> tuple[Player, Player, Keys]:
    """The file with all keys, and with fewer."""
    folder = tmp_path_factory.mktemp("keys")
    write_glb(folder / "all.glb", upright)
    keys = write_glb(folder / "fewer.glb", upright, within=WITHIN).keys
    assert keys is not None
    return Player.of(folder / "all.glb"), Player.of(folder / "fewer.glb"), keys


def times(player: Player, node: str, path: str) -> np.ndarray:
    """When a channel has its keys, seconds."""
    document = player.document
    (channel,) = (
        c
        for c in document.animations[0].channels
        if document.nodes[c.target.node].name == node and c.target.path == path
    )
    return player.array(document.animations[0].samplers[channel.sampler].input)[:, 0]


@pytest.mark.thorough
def test_joints_finger_tips_and_toes_stay_within_the_bound(written: tuple[Player, Player, Keys], upright: Motion):
    every, fewer, keys = written
    assert 0.05 * keys.all < keys.count < 0.8 * keys.all
    weights = upright.body.skinning_weights
    tips = [
        int(own[np.linalg.norm(upright.body.template[own] - upright.body.rest_joints[JOINT[name]], axis=1).argmax()])
        for name in ("left_index3", "right_thumb3", "right_pinky3", "left_foot", "head")
        for own in [np.flatnonzero(weights[:, JOINT[name]] > 0.9)]
    ]
    farthest = 0.0
    for frame in range(FRAMES):
        time = frame / upright.frame_rate
        joints = np.linalg.norm(every.joints(time) - fewer.joints(time), axis=1).max()
        skin = np.linalg.norm((every.vertices(time) - fewer.vertices(time))[tips], axis=1).max()
        farthest = max(farthest, joints, skin)
    assert 0.5 * WITHIN < farthest <= WITHIN + 1e-6  # the player's single precision
    assert keys.largest <= WITHIN


def test_the_file_says_how_many_keys_are_left(written: tuple[Player, Player, Keys]):
    every, fewer, keys = written
    animation = fewer.document.animations[0]
    found = sum(fewer.document.accessors[animation.samplers[c.sampler].input].count for c in animation.channels)
    assert found == keys.count and keys.all == FRAMES * len(animation.channels) == FRAMES * 57
    assert fewer.document.asset.extras["keys"] == keys.text and f"{keys.count:,} of {keys.all:,} keys" in keys.text
    assert every.document.asset.extras["keys"] == "every frame"


@pytest.mark.thorough
def test_the_stated_deviation_is_that_of_the_fewer_keys(written: tuple[Player, Player, Keys], upright: Motion):
    _, fewer, _ = written
    shown = [fewer.vertices(t / upright.frame_rate) for t in range(FRAMES)]
    off = max(np.linalg.norm(a - b, axis=1).max() for a, b in zip(shown, upright.vertices(), strict=True))
    assert fewer.document.asset.extras["largest_deviation_m"] == pytest.approx(off, abs=2e-6)


def test_whole_chain_has_keys_where_a_foot_begins_and_ends_to_stand(
    written: tuple[Player, Player, Keys], upright: Motion
):
    _, fewer, _ = written
    for node in ("pelvis", "left_hip", "left_knee", "left_ankle", "left_foot"):
        for path in ("rotation", "translation") if node == "pelvis" else ("rotation",):
            for frame in (11, 29):
                assert np.isclose(times(fewer, node, path), frame / upright.frame_rate, atol=1e-5).any()
    kept = [len(times(fewer, name, "rotation")) for name in JOINTS]
    assert min(kept) < 0.5 * FRAMES, "channels have keys of their own"


def test_files_are_the_same_each_time(upright: Motion, tmp_path: Path):
    for name in ("a", "b"):
        write_glb(tmp_path / name, upright[:20], within=0.002)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_finding_keys_can_be_stopped(upright: Motion, tmp_path: Path):
    shares: list[float] = []

    def stop(share: float) -> None:
        shares.append(share)
        if len(shares) == 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_glb(tmp_path / "x.glb", upright, stop, within=0.002)
    assert not list(tmp_path.iterdir()) and shares == sorted(shares) and shares[-1] < 0.3
