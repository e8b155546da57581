"""What the lifter is trained on: figures, windows of motion, cameras and detectors; and that training goes on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from build_assets.lifter.__main__ import Options, main
from build_assets.lifter.figure import Figure
from build_assets.lifter.filming import Film, Studio
from build_assets.lifter.motions import Corpus, Windows
from build_assets.lifter.training import Schedule, Training, losses, score
from build_assets.motion_capture.retarget import MotionClip
from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.lifting.network import FRAMES, RATE, LifterSize, read_lifter
from tests.build_assets.captured import DEEPMIMIC_NUMBERS, deepmimic_frames, write_deepmimic

pytestmark = pytest.mark.thorough

SMALL = LifterSize(width=24, layers=1, heads=2)
KNEE = DEEPMIMIC_NUMBERS["left_knee"][0]


def swinging(frames: int = 90, subject: str = "cmu01", seed: int = 0, speed: float = 1.0) -> MotionClip:
    """Somebody who walks along x and swings arms and legs."""
    random = np.random.default_rng(seed)
    phase = speed * np.arange(frames) / 5 + random.uniform(0, 6)
    pose = np.zeros((frames, 63))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pose[:, 3 * (JOINT[f"{side}_hip"] - 1)] = 0.5 * sign * np.sin(phase)
        pose[:, 3 * (JOINT[f"{side}_knee"] - 1)] = 0.4 + 0.4 * np.sin(phase + sign)
        pose[:, 3 * (JOINT[f"{side}_elbow"] - 1) + 1] = -sign * (0.6 + 0.5 * np.sin(phase - sign))
    pelvis = np.stack([0.02 * np.arange(frames), np.full(frames, 0.9), np.zeros(frames)], 1)
    feet = pelvis[:, None] + np.array([[0.1, -0.85, 0.0], [-0.1, -0.85, 0.0]])
    feet[:, 0, 0] = 0.1  # the left one stands, the right one hurries along
    feet[:, 1, 0] += 0.05 * np.arange(frames)
    return MotionClip(
        name="a",
        subject=subject,
        source="cmu",
        fps=30.0,
        body_pose=pose,
        orient=np.tile(np.eye(3), (frames, 1, 1)),
        pelvis=pelvis,
        feet=feet,
        leg=0.8,
        frames=np.arange(frames),
        dropped=0,
    )


@pytest.fixture(scope="module")
def figure(free_body: BodyModel) -> Figure:
    return Figure.of(free_body)


@pytest.fixture(scope="module")
def corpus(figure: Figure) -> Corpus:
    return Corpus.of([swinging(seed=k, speed=1 + k / 3) for k in range(4)], figure, np.random.default_rng(0))


def film_of(figure: Figure, corpus: Corpus, count: int, seed: int = 0) -> Film:
    rng = np.random.default_rng(seed)
    return Studio(figure, Windows(corpus, rng), rng).film(count)


def test_the_figure_has_the_bodys_keypoints(free_body: BodyModel, figure: Figure):
    """Those in joints exactly, those on the skin within what skinning moves them by."""
    torch.manual_seed(0)
    pose, betas = 0.3 * torch.randn(4, 63, dtype=torch.float64), torch.randn(4, 10, dtype=torch.float64)
    params = replace(BodyParams.neutral(4), body_pose=pose, betas=betas)
    points, _ = keypoints_in_space(free_body, params)
    rest = free_body.with_shape(betas[0].numpy()).rest_joints[0] if hasattr(free_body, "with_shape") else None
    turns = torch.eye(3).expand(4, 22, 3, 3).clone()
    turns[:, 1:] = torch.linalg.matrix_exp(_hats(pose.view(4, 21, 3))).float()
    found = figure.pose(turns, betas.float()).double().numpy()
    hips = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
    expected = points[:, :25] - points[:, hips].mean(1, keepdims=True)
    got = found - found[:, hips].mean(1, keepdims=True)
    off = np.linalg.norm(got - expected, axis=2)
    limbs = [kp.INDEX[f"{s}_{n}"] for s in ("left", "right") for n in ("shoulder", "elbow", "wrist", "knee", "ankle")]
    assert off[:, limbs].max() < 0.03 and off.max() < 0.06 and rest is not None


def _hats(v: torch.Tensor) -> torch.Tensor:
    x, y, z = v.unbind(-1)
    o = torch.zeros_like(x)
    return torch.stack([o, -z, y, z, o, -x, -y, x, o], -1).view(*v.shape[:-1], 3, 3)


def test_stretches_have_no_gap_and_know_who_stands(figure: Figure):
    clip = swinging()
    broken = replace(clip, frames=np.concatenate([np.arange(20), np.arange(25, 31), np.arange(40, 104)]))
    corpus = Corpus.of([broken], figure, np.random.default_rng(0))
    assert sorted(set(zip(corpus.start.tolist(), corpus.stop.tolist(), strict=True))) == [(0, 20), (20, 84)]
    assert corpus.stands.float().mean(0).tolist() == [1.0, 0.0]
    assert len(corpus.upright) == len(corpus)
    scaled = float((corpus.pelvis[1] - corpus.pelvis[0]).norm())
    assert scaled == pytest.approx(0.02 * figure.leg / clip.leg, rel=1e-5)


@pytest.mark.parametrize("varied", [True, False])
def test_windows_are_motion_of_the_corpus(corpus: Corpus, varied: bool):
    windows = Windows(corpus, np.random.default_rng(1), varied=varied)
    motion = windows.draw(16, upright=np.ones(16, bool))
    assert motion.turns.shape == (16, FRAMES, 22, 3, 3)
    torch.testing.assert_close(motion.turns @ motion.turns.mT, torch.eye(3).expand_as(motion.turns), atol=1e-4, rtol=0)
    assert bool((torch.linalg.det(motion.turns) > 0.99).all())
    if not varied:
        step = (motion.pelvis[:, 1:] - motion.pelvis[:, :-1]).norm(dim=-1)
        assert float(step.median()) == pytest.approx(
            0.02 * 30 / RATE * float(corpus.pelvis[:, 0].max() / 1.78), rel=0.1
        )
        mirrored = motion.stands[..., 1].mean(1) > 0.9  # who stands on the right foot is in a mirror
        assert 0 < int(mirrored.sum()) < 16
        assert bool((motion.stands[mirrored][..., 0] == 0).all())


def test_films_show_people_where_they_are(figure: Figure, corpus: Corpus):
    """With a known focal length the rays of what is seen point at the truth, but for a detector's errors."""
    film = film_of(figure, corpus, 200)
    assert 0.5 < float(film.usable.float().mean()) <= 1.0
    known, off = film.usable & (film.calibrated == 1), []
    for b in known.nonzero()[:, 0].tolist():
        there = film.confidence[b, FRAMES // 2] > 0
        points, rays = film.points[b, FRAMES // 2][there], film.rays[b, FRAMES // 2][there]
        # The pelvis' place that explains the rays best: x - u z = -(X - u Z), two equations a keypoint.
        rows = torch.cat([torch.eye(3)[:2].expand(len(rays), 2, 3) - rays[..., None] * torch.tensor([0.0, 0, 1])], 0)
        right = -(points[:, :2] - rays * points[:, 2:])
        place = torch.linalg.lstsq(rows.flatten(0, 1), right.flatten()[:, None]).solution[:, 0]
        error = ((points[:, :2] + place[:2]) - rays * (points[:, 2:] + place[2])).norm(dim=1)
        off.append(float(error.median()))
    assert np.median(off) < 0.04 and np.percentile(off, 90) < 0.12, "some are guessed, and far off"
    assert float((film.up.norm(dim=1) - 1).abs().max()) < 1e-5
    assert float((film.up[:, 1] < 0).float().mean()) > 0.98, "y points down in a camera"


@pytest.mark.slow
def test_training_learns_and_goes_on(figure: Figure, corpus: Corpus, tmp_path: Path):
    schedule = Schedule(steps=40, batch=8)

    def training() -> Training:
        rng = np.random.default_rng(0)
        return Training(Studio(figure, Windows(corpus, rng), rng), size=SMALL, schedule=schedule)

    first = training()
    film = film_of(figure, corpus, 32, seed=9)
    before = float(losses(first.network, film)["points"].detach())
    for _ in first.run(report_every=20):
        first.save(tmp_path / "checkpoint.pt")
    assert float(losses(first.network, film)["points"].detach()) < 0.6 * before
    again = training()
    again.load(tmp_path / "checkpoint.pt")
    assert again.step == 40 and torch.equal(again.average.place, first.average.place)
    judged = score(again.average, [film])
    assert judged.known_depth <= 1.2 * judged.depth and len(judged.calibration) == 5
    other = Training(again.studio, size=replace(SMALL, width=32), schedule=schedule)
    with pytest.raises(InputError, match="other settings"):
        other.load(tmp_path / "checkpoint.pt")


def test_the_command_writes_a_lifter(tmp_path: Path):
    frames = deepmimic_frames(frames=60)
    frames[:, KNEE] = -np.linspace(0.1, 1.0, 60)
    write_deepmimic(tmp_path / "data", {"sink": frames})
    options = Options(
        data=tmp_path / "data", out=tmp_path / "out", save_every=2, size=SMALL, schedule=Schedule(steps=4, batch=4)
    )
    main(options)
    network, factor = read_lifter(tmp_path / "out/tcfit_lifter.npz")
    assert network.size == SMALL and factor > 0
    assert (tmp_path / "out/curve.jsonl").exists() and (tmp_path / "out/checkpoint.pt").exists()
