"""A loosened prior: any pose exactly, derivatives, and the prior itself where nothing is added."""

import pytest
import torch

from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.loosened import Loosened
from tests.fitting_core.priors.networks import random_latents, random_network


@pytest.fixture
def latent() -> LatentPrior:
    return LatentPrior(random_network(size=8, hidden=24))


def test_every_pose_comes_back(latent: LatentPrior):
    """The latent space alone is far from it."""
    poses = 0.5 * random_latents(3, 63)
    loosened = Loosened(latent, 0.05)
    torch.testing.assert_close(loosened.decode(loosened.encode(poses)), poses)
    assert (latent.decode(latent.encode(poses)) - poses).abs().max() > 0.1


def test_derivative_is_that_of_automatic_differentiation(latent: LatentPrior):
    loosened = Loosened(latent, 0.05)
    z = random_latents(3, loosened.size)
    expected = torch.autograd.functional.jacobian(lambda x: loosened.decode(x).sum(0), z).permute(1, 0, 2)  # pyright: ignore
    torch.testing.assert_close(loosened.jacobian(z), expected)


def test_nothing_added_is_the_prior(latent: LatentPrior):
    z = random_latents(3, latent.size)
    both = torch.cat([z, z.new_zeros(3, 63)], 1)
    torch.testing.assert_close(Loosened(latent, 0.05).decode(both), latent.decode(z))
