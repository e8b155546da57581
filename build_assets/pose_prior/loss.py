"""What the autoencoder is trained to minimise, in nats per pose."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from build_assets.pose_prior.autoencoder import LATENT, PoseAutoencoder
from build_assets.pose_prior.skeleton import N_POSED, Contact, Skeleton
from fitting_core.body import rotations
from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.fit.terms.limits import AngleTable
from fitting_core.priors.pose import relaxed_pose

_SAMPLES = 128
"""Random poses that are judged in each step."""
_DIRECTIONS = 64
"""Along which the latent numbers are compared with a normal distribution."""


@dataclass(frozen=True, kw_only=True)
class Precision:
    """Standard deviations of what may remain; they set how much each part counts."""

    angle: float = 0.025
    """Radians, of each joint of a pose that comes back."""
    position: float = 0.008
    """Metres, of each joint and end point of a pose that comes back."""
    beyond: float = 0.1
    """Radians beyond a joint's range in random poses."""
    overlap: float = 0.03
    """Metres by which parts of random poses lie in each other."""
    middle: float = 0.03
    """Radians, of each joint of the pose in the middle of the latent space against `relaxed_pose`."""
    shape: float = 0.04
    """Of the latent numbers' distribution against a normal one, along any direction."""


class Loss:
    """Negative evidence lower bound, and two things that make random poses those of people.

    With the bound alone poses came back exactly, but the encoded ones filled a small and bent part of the normal
    distribution: of 32 random poses about 14 were folded up. So the distribution of the latent numbers is drawn to it
    along random directions (sliced Wasserstein distance: Kolouri et al., Sliced-Wasserstein Autoencoder, 2018), and
    random poses must keep to the joints' ranges and not collide. Held-out poses come back as exactly as without. And
    the middle, where fits start and unseen limbs rest, is a person standing at ease: left to itself it was lopsided.
    """

    def __init__(self, body: BodyModel, precision: Precision, device: str = "cpu") -> None:
        self.precision = precision
        self.skeleton = Skeleton(body).to(device)
        self.contact = Contact(Skeleton(body)).to(device)
        ranges = {name: r for name, r in joint_ranges(body).items() if JOINT[name] < N_POSED}
        like = torch.zeros(0, device=device)
        self.angles = AngleTable.of(ranges, like)
        bounds = torch.stack([like.new_tensor(r.bounds) for r in ranges.values()]).deg2rad()
        self.low, self.high = self.angles.ordered(bounds).unbind(-1)
        self.relaxed = rotations.exp(relaxed_pose().view(1, 21, 3)).to(like)
        self.quantiles: dict[int, Tensor] = {}

    def __call__(
        self,
        network: PoseAutoencoder,
        matrices: Float[Tensor, "B 21 3 3"],
        kl_weight: float,
        random: torch.Generator,
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss of a batch, and its parts before they are weighted together."""
        mean, log_variance = network.encode(matrices)

        def normal(*shape: int) -> Tensor:
            return torch.randn(shape, generator=random).to(mean)  # from the CPU: the same numbers on every device

        z = mean + normal(*mean.shape) * (0.5 * log_variance).exp()
        turned, moved = self._apart(matrices, network.decode(z))
        kl = 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(1).mean()
        directions = torch.nn.functional.normalize(normal(LATENT, _DIRECTIONS), dim=0)
        shape = self._unlike_normal(z @ directions) / (2 * self.precision.shape**2)
        beyond, overlap = self._implausible(network.decode(normal(_SAMPLES, LATENT)))
        off = (network.decode(torch.zeros_like(mean[:1])) - self.relaxed).square().sum()
        middle = off / (4 * self.precision.middle**2)
        parts = {"turned": turned, "moved": moved, "kl": kl, "shape": shape, "beyond": beyond, "overlap": overlap}
        parts["middle"] = middle
        return sum(parts.values(), (kl_weight - 1) * kl), parts

    def _apart(self, matrices: Tensor, back: Tensor) -> tuple[Tensor, Tensor]:
        # |R - R'|^2 = 8 sin^2(angle / 2), about 2 angle^2: no logarithm, whose slope is infinite at pi.
        turned = (matrices - back).square().sum((1, 2, 3)) / (4 * self.precision.angle**2)
        moved = (self.skeleton.points(matrices) - self.skeleton.points(back)).square().sum((1, 2))
        return turned.mean(), moved.mean() / (2 * self.precision.position**2)

    def _unlike_normal(self, along: Float[Tensor, "B D"]) -> Tensor:
        """Squared Wasserstein distance to the normal distribution along each direction; their mean."""
        count = len(along)
        if count not in self.quantiles:
            self.quantiles[count] = torch.special.ndtri((torch.arange(count) + 0.5) / count)[:, None].to(along)
        return (along.sort(0).values - self.quantiles[count]).square().mean()

    def _implausible(self, matrices: Float[Tensor, "B 21 3 3"]) -> tuple[Tensor, Tensor]:
        angles = self.angles.angles(rotations.log(matrices)[:, self.angles.joint - 1])
        beyond = (angles - angles.clamp(self.low, self.high)).square().sum((1, 2)).mean()
        overlap = self.contact.depths(matrices).square().sum(1).mean()
        return beyond / (2 * self.precision.beyond**2), overlap / (2 * self.precision.overlap**2)
