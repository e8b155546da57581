"""The latent pose prior against torch's own modules, automatic differentiation, and inside whole fits."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.model import BodyModel
from fitting_core.config.schema import FitConfig, ShapeSample, SolverSettings, Temporal, Weights
from fitting_core.errors import InputError
from fitting_core.fit.fitting import fit_clip
from fitting_core.priors.files.network import Activation, Layer, PriorNetwork, write_prior_network
from fitting_core.priors.latent import ACTIVATIONS, LatentPrior
from fitting_core.priors.pose import AxisAnglePrior, make_prior
from tests.fitting_core.priors.networks import (
    modules_of,
    random_latents,
    random_network,
    rotations_by_hand,
    with_fitted_encoder,
)
from tests.samples.scenes import arms_in_motion, clip_of, hidden, keypoints_of


def network_around(pose: Tensor, spread: float = 1e-3) -> PriorNetwork:
    """A network whose poses all lie near one, (63,) axis-angle."""
    columns = rotations.exp(pose.view(21, 3))[..., :2].flatten().numpy()
    network = random_network(spread=spread)
    last = network.decoder[-1]
    return replace(network, decoder=(*network.decoder[:-1], Layer(last.weight, last.bias * spread + columns)))


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_decodes_as_modules_of_torch_do(activation: Activation):
    network = random_network(activation, spread=1.0)
    z = random_latents(20)
    expected = rotations_by_hand(modules_of(network.decoder)(z))
    pose = LatentPrior(network).decode(z)
    found = Rotation.from_rotvec(pose.reshape(-1, 3).numpy()).as_matrix().reshape(20, 21, 3, 3)
    np.testing.assert_allclose(found, expected.numpy(), rtol=0, atol=1e-11)
    assert float(pose.view(20, 21, 3).norm(dim=2).max()) <= math.pi + 1e-12


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-4, 0.03, 1.0, 3.0, math.pi - 1e-4, math.pi - 1e-9, math.pi])
def test_decode_is_differentiable_near_rest_and_near_half_turns(angle: float):
    """Of the rotation matrices, by way of exp's left Jacobian."""
    axes = torch.nn.functional.normalize(random_latents(21, 3), dim=1)
    network = network_around(angle * axes.flatten())
    prior, modules, z = LatentPrior(network), modules_of(network.decoder), random_latents(5)
    by_matrix = torch.func.vmap(torch.func.jacrev(lambda one: rotations_by_hand(modules(one))[0]))(z)
    pose = prior.decode(z).view(5, 21, 3)
    by_pose = torch.func.vmap(torch.func.jacfwd(lambda one: prior.decode(one[None])[0]))(z).view(5, 21, 3, 32)
    turn = rotations.left_jacobian(pose) @ by_pose
    turned = (rotations.hat(turn.mT) @ rotations.exp(pose)[:, :, None]).permute(0, 1, 3, 4, 2)
    torch.testing.assert_close(turned, by_matrix, rtol=0, atol=1e-9 * float(by_matrix.abs().max()) + 1e-12)
    assert float(by_matrix.abs().max()) > 1e-4


def apart(prior: LatentPrior, z: Tensor, other: Tensor) -> Tensor:
    """Largest difference of the rotation matrices, (B,)."""
    return (prior.rotations(z) - prior.rotations(other)).abs().amax((1, 2, 3))


@pytest.mark.parametrize("activation", ["silu", "tanh", "leaky_relu_0.2", "leaky_relu_0.01"])
def test_encoding_finds_a_pose_that_was_decoded(activation: Activation):
    prior, z = LatentPrior(with_fitted_encoder(random_network(activation, hidden=400))), random_latents(20)
    pose = prior.decode(z)
    assert float(apart(prior, prior._encoder(pose), z).mean()) > 0.03
    assert float(apart(prior, prior.encode(pose), z).max()) < 1e-3


def test_encoding_is_never_farther_than_the_encoder_alone(monkeypatch: pytest.MonkeyPatch):
    """Of poses that the network cannot express, too."""
    prior = LatentPrior(random_network(spread=1.0))
    pose = 0.7 * random_latents(15, 63)

    def distance(z: Tensor) -> Tensor:
        return prior._distance(z, rotations.exp(pose.view(-1, 21, 3)))

    alone = prior._encoder(pose)
    found = prior.encode(pose)
    assert (distance(found) <= distance(alone)).all()
    assert (distance(found) <= distance(torch.zeros_like(alone))).all()
    assert float(distance(found).mean()) < 0.7 * float(distance(alone).mean())


def test_choosing_by_name_and_by_path(tmp_path: Path):
    network = random_network()
    write_prior_network(tmp_path / "mine.npz", network)
    prior = make_prior(str(tmp_path / "mine.npz"), dtype=torch.float32, device="cpu")
    assert isinstance(prior, LatentPrior) and prior.title == f"random ({network.hash})"
    assert prior.neutral.dtype == torch.float32
    plain = make_prior("relaxed", dtype=torch.float32, device="cpu")
    assert isinstance(plain, AxisAnglePrior) and plain.neutral.dtype == torch.float32 and plain.title == "relaxed"
    with pytest.raises(InputError, match="does not exist"):
        make_prior(str(tmp_path / "missing.npz"), dtype=torch.float64, device="cpu")


@pytest.mark.parametrize("solver", ["lm", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_whole_fit_in_a_latent_space(tiny_body: BodyModel, tmp_path: Path, solver: str):
    """All three phases, from a file: poses that lie in the space are found."""
    network = with_fitted_encoder(random_network("leaky_relu_0.2", size=8, hidden=32, spread=0.2))
    write_prior_network(tmp_path / "prior.npz", network)
    prior = LatentPrior(network)
    along = torch.linspace(0, 0.5, 3, dtype=torch.float64)[:, None]
    truth = replace(arms_in_motion(3), body_pose=prior.decode(random_latents(1, 8) + along * random_latents(1, 8, 1)))
    config = FitConfig(
        weights=replace(Weights(), body_pose=(5.0, 2.0, 1.0, 0.5, 0.5), bending=(0.0,) * 5, collision=(0.0,) * 5),
        solver=solver,  # pyright: ignore
        pose_prior=str(tmp_path / "prior.npz"),
        hip_weight=1.0,
        neck_weight=1.0,
        shape_sample=ShapeSample(size=2, stages=(5,)),
        temporal=Temporal(mode="global", stages=(5,)),
        settings=SolverSettings(iterations=30, rounds=4),
    )
    result = fit_clip(clip_of(hidden(keypoints_of(tiny_body, truth), kp.HANDS, kp.FACE)), tiny_body, config)
    assert result.pose_prior == f"random ({network.hash})"
    pose = result.last.params.body_pose
    np.testing.assert_allclose(prior.decode(prior.encode(pose)).numpy(), pose.numpy(), atol=1e-3)

    def angle(pose: Tensor) -> float:
        turn = rotations.exp(pose.view(3, 21, 3)).mT @ rotations.exp(truth.body_pose.view(3, 21, 3))
        return float(rotations.log(turn).norm(dim=2).mean())

    assert angle(pose) < 0.05 * angle(prior.decode(torch.zeros(3, 8, dtype=torch.float64)))
