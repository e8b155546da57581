"""Training of the pose prior: what it is trained on and what it minimises."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.retarget import MotionClip, mirrored
from build_assets.pose_prior import dataset
from build_assets.pose_prior.__main__ import Options, exported, main
from build_assets.pose_prior.autoencoder import LATENT, NetworkSize, PoseAutoencoder
from build_assets.pose_prior.loss import Precision
from build_assets.pose_prior.skeleton import Contact, Skeleton
from build_assets.pose_prior.training import Schedule, Training
from fitting_core.body import rotations
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.errors import InputError
from fitting_core.priors.files.network import read_prior_network
from fitting_core.priors.latent import LatentPrior
from tests.build_assets.captured import cmu_channels, write_cmu

pytestmark = pytest.mark.thorough

INWARD = tuple(Rotation.from_euler("ZX", [-80, 90], degrees=True).as_rotvec(degrees=True))
"""A hanging left arm, turned so that a bent elbow takes the forearm to the right."""
SMALL = NetworkSize(encoder=16, decoder=16)


@pytest.fixture(scope="module")
def skeleton(free_body: BodyModel) -> Skeleton:
    return Skeleton(free_body)


@pytest.fixture(scope="module")
def contact(skeleton: Skeleton) -> Contact:
    return Contact(skeleton)


@pytest.fixture(scope="module")
def captured(skeleton: Skeleton) -> dataset.Poses:
    """Mostly hanging arms, seldom raised ones, which differ more among themselves."""
    rng = np.random.default_rng(0)
    return dataset.balanced([clip(standing(rng, 900)), clip(standing(rng, 100, raised=True))], skeleton, rng)


def turned(**angles: tuple[float, float, float]) -> Float[np.ndarray, "1 63"]:
    """A pose with some joints turned, degrees of axis-angle."""
    pose = np.zeros((21, 3))
    for name, angle in angles.items():
        pose[JOINT[name] - 1] = np.radians(angle)
    return pose.reshape(1, 63)


def standing(rng: np.random.Generator, count: int, *, raised: bool = False) -> Float[np.ndarray, "n 63"]:
    arm = 60.0 if raised else -75.0
    pose = turned(left_shoulder=(0, 0, arm), right_shoulder=(0, 0, -arm))
    return pose + rng.normal(0, 0.3 if raised else 0.05, (count, 63))


def clip(pose: Float[np.ndarray, "T 63"], subject: str = "cmu01") -> MotionClip:
    count = len(pose)
    return MotionClip(
        name="a",
        subject=subject,
        source="cmu",
        fps=30.0,
        body_pose=pose,
        orient=np.tile(np.eye(3), (count, 1, 1)),
        pelvis=np.zeros((count, 3)),
        feet=np.zeros((count, 2, 3)),
        leg=0.8,
        frames=np.arange(count),
        dropped=0,
    )


def training(body: BodyModel, poses: np.ndarray, steps: int = 30) -> Training:
    schedule = Schedule(steps=steps, batch=32)
    return Training(poses, body, size=SMALL, precision=Precision(), schedule=schedule)


def test_the_skeleton_is_the_body(free_body: BodyModel, skeleton: Skeleton):
    from fitting_core.body.mesh import Mesh
    from fitting_core.body.params import BodyParams

    pose = torch.as_tensor(np.random.default_rng(0).normal(0, 0.4, (3, 63)))
    joints = Mesh(free_body).joints(replace(BodyParams.neutral(3), body_pose=pose))
    points = skeleton.points(dataset.matrices(pose.numpy()))
    assert torch.allclose(points[:, :22].double(), joints[:, :22].double(), atol=1e-5)
    assert torch.allclose(points[:, 22].double(), joints[:, JOINT["jaw"]].double(), atol=1e-5)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (turned(), False),
        (turned(left_shoulder=(0, 0, -75), right_shoulder=(0, 0, 75)), False),
        (turned(left_shoulder=INWARD, left_elbow=(0, -90, 0)), True),  # the forearm through the belly
        (turned(left_hip=(0, 0, -25)), True),  # one thigh through the other
        (turned(left_hip=(-90, 0, 0), left_knee=(90, 0, 0)), False),
    ],
)
def test_contact_sees_what_goes_through_the_body(contact: Contact, pose: np.ndarray, expected: bool):
    assert bool(contact.overlaps(dataset.matrices(pose))[0]) is expected
    assert bool(contact.overlaps(dataset.matrices(mirrored(pose)))[0]) is expected


def test_the_pool_is_seeded_and_free_of_collisions(captured: dataset.Poses, contact: Contact):
    def drawn(seed: int) -> np.ndarray:
        return dataset.pool(captured, contact, 200, np.random.default_rng(seed), as_captured=0.25)

    pool = drawn(3)
    assert pool.shape == (200, 63) and np.isfinite(pool).all()
    assert not contact.overlaps(dataset.matrices(pool[50:])).any()
    np.testing.assert_array_equal(pool, drawn(3))
    assert not np.array_equal(pool, drawn(4))


@pytest.mark.slow
def test_training_makes_poses_come_back(free_body: BodyModel, captured: dataset.Poses):
    reports = list(training(free_body, captured.body_pose).run(report_every=10))
    assert [r.step for r in reports] == [10, 20, 30]
    assert reports[-1].parts["turned"] < 0.9 * reports[0].parts["turned"]


def test_what_is_exported_decodes_and_encodes_alike():
    torch.manual_seed(0)
    network = PoseAutoencoder(NetworkSize(encoder=24, decoder=16, activation="softplus"))
    prior = LatentPrior(exported(network))
    z = torch.randn(5, LATENT)
    found = rotations.exp(prior.decode(z.double()).view(5, 21, 3))
    torch.testing.assert_close(found.float(), network.decode(z), atol=1e-5, rtol=0)
    mean, _ = network.encode(found.float())
    torch.testing.assert_close(prior._encoder(found[..., :2].flatten(1)).float(), mean, atol=1e-5, rtol=1e-4)


def test_the_command_writes_a_prior_from_captured_motion(tmp_path: Path):
    write_cmu(tmp_path / "data", {"01_01": cmu_channels(frames=300), "05_01": cmu_channels(frames=20)})
    schedule = Schedule(steps=4, batch=16)
    options = Options(data=tmp_path / "data", out=tmp_path / "prior.npz", poses=40, size=SMALL, schedule=schedule)
    main(options)
    prior = LatentPrior(read_prior_network(tmp_path / "prior.npz"))
    assert prior.size == LATENT
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data", "prior.npz"]
    with pytest.raises(InputError, match="missing"):
        main(replace(options, data=tmp_path / "missing"))
