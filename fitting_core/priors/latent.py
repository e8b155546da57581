"""A latent pose prior: a network decodes some normally distributed numbers to the body's pose, as VPoser does."""

from collections.abc import Callable, Sequence
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from fitting_core.body import rotations
from fitting_core.priors.files.network import INPUTS, Activation, Layer, PriorNetwork

N_JOINTS = 21
PARENTS = (-1, -1, -1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 8, 11, 12, 13, 15, 16, 17, 18)
"""Of the body joints, from left_hip to right_wrist, among themselves; -1 is the pelvis."""
CARRIED = (5.7, 5.7, 3.3, 4.7, 4.7, 0.7, 0.3, 0.3, 6.7, 0.1, 0.1, 0.3, 0.8, 0.8, 0.2, 2.6, 2.6, 1.9, 1.9, 0.2, 0.2)
"""How much each joint's rotation against the pelvis counts in an encoding: squared length of the bone that it turns, in
metres, times the joints and ends that this bone carries, times (0.025 rad / 0.008 m)^2, the precision of training."""
TOGETHER = 8
"""Frames whose derivatives pass through the layers together: (8, 32, 512) float64 is 1 MB and stays in the cache."""
TOGETHER_ROUGH = 64
"""Poses that are encoded roughly, in float32: 1.1 ms each, 2.3 with eight at a time or in float64."""
SPREAD = 1e-6
"""Weight of |z|^2 beside the squared angles when a pose is encoded: it only decides between equal poses."""
ENCODER_STEPS, ROUGH_STEPS = 30, 5
"""Most Gauss-Newton steps of an encoding, and of one that a descent goes on from."""
_SETTLED, _STUCK = 1e-3, 1e3
"""Relative decrease under which a frame's encoding is done; damping over which it finds no lower point."""


def _leaky(slope: float) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    def leaky_relu(x: Tensor) -> tuple[Tensor, Tensor]:
        return functional.leaky_relu(x, slope), torch.full_like(x, slope).masked_fill(x > 0, 1.0)

    return leaky_relu


def _elu(x: Tensor) -> tuple[Tensor, Tensor]:
    return functional.elu(x), x.clamp_max(0).exp()


def _silu(x: Tensor) -> tuple[Tensor, Tensor]:
    s = x.sigmoid()
    return x * s, s * (1 + x * (1 - s))


def _softplus(x: Tensor) -> tuple[Tensor, Tensor]:
    return functional.softplus(x), x.sigmoid()


def _tanh(x: Tensor) -> tuple[Tensor, Tensor]:
    value = x.tanh()
    return value, 1 - value * value


ACTIVATIONS: dict[Activation, Callable[[Tensor], tuple[Tensor, Tensor]] | None] = {
    "linear": None,
    "leaky_relu_0.01": _leaky(0.01),
    "leaky_relu_0.2": _leaky(0.2),
    "elu": _elu,
    "silu": _silu,
    "softplus": _softplus,
    "tanh": _tanh,
}
"""Value and slope of each, by name; None: the value itself."""


class _Dense:
    """Fully connected layers, in one type and on one device."""

    def __init__(self, layers: Sequence[Layer], dtype: torch.dtype, device: torch.device | str) -> None:
        self.layers = [
            # Transposed: the product with a batch of rows is then one plain matrix product.
            (torch.tensor(a.weight.T, dtype=dtype, device=device).contiguous(),
             torch.tensor(a.bias, dtype=dtype, device=device),
             ACTIVATIONS[a.activation])
            for a in layers
        ]  # fmt: skip

    def __call__(self, x: Float[Tensor, "B in"]) -> Float[Tensor, "B out"]:
        for weight, bias, activation in self.layers:
            x = x @ weight + bias
            x = activation(x)[0] if activation else x
        return x

    def with_jacobian(self, x: Float[Tensor, "B in"]) -> tuple[Float[Tensor, "B out"], Float[Tensor, "B in out"]]:
        """Output and its derivative by each input, carried forward through the layers: 32 rows instead of 126."""
        rows: Tensor | None = None
        for weight, bias, activation in self.layers:
            x = x @ weight + bias
            if rows is None:
                rows = weight.expand(len(x), -1, -1)
            else:
                rows = (rows.reshape(-1, weight.shape[0]) @ weight).view(*rows.shape[:2], weight.shape[1])
            if activation:
                x, slope = activation(x)
                rows = rows * slope[:, None]
        assert rows is not None, "a network has layers"
        return x, rows


class LatentPrior:
    """The pose prior that a network holds; the penalty is |z|^2.

    Poses come as axis-angle, which jumps where a joint turns by pi: what looks at the rotations (points, their
    derivatives) does not notice.

    Args:
        network: decoder and encoder.
        dtype: of the computation; the network may be stored in another.
        device: where to compute.
    """

    def __init__(
        self, network: PriorNetwork, *, dtype: torch.dtype = torch.float64, device: torch.device | str = "cpu"
    ) -> None:
        self.network, self.size = network, network.size
        self.title = f"{network.title} ({network.hash})"
        self.neutral = torch.zeros(self.size, dtype=dtype, device=device)
        self._decoder = _Dense(network.decoder, dtype, device)
        self._encoder = _Dense(network.encoder, dtype, device)

    def to(self, *, dtype: torch.dtype, device: torch.device | str) -> "LatentPrior":
        """The same prior in another type or on another device."""
        return LatentPrior(self.network, dtype=dtype, device=device)

    def decode(self, z: Float[Tensor, "B size"]) -> Float[Tensor, "B 63"]:
        """Axis-angle of the 21 body joints, each of a length of pi at most."""
        return rotations.log(self.rotations(z)).flatten(-2)

    def rotations(self, z: Float[Tensor, "B size"]) -> Float[Tensor, "B 21 3 3"]:
        """Rotation matrices of the 21 body joints; these are smooth in z."""
        return rotations.orthonormalised(self._decoder(z).unflatten(-1, (N_JOINTS, 3, 2)))

    def _turns(self, z: Float[Tensor, "B size"]) -> tuple[Float[Tensor, "B 21 3 3"], Float[Tensor, "B 21 3 size"]]:
        """The rotations, and how they turn about their own axes: R(z + dz) = R(z) exp(turn @ dz) to first order."""
        columns, rows = self._decoder.with_jacobian(z)
        matrices, tangent = rotations.orthonormalised_with_tangent(columns.view(-1, N_JOINTS, 3, 2))
        by_joint = rows.view(len(z), self.size, N_JOINTS, 6).permute(0, 2, 3, 1)
        return matrices, tangent @ by_joint

    @torch.no_grad()
    def encode(self, body_pose: Float[Tensor, "B 63"], *, rough: bool = False) -> Float[Tensor, "B size"]:
        """The z whose decoded pose is nearest: the encoder's mean (or zero, if that is nearer), then Gauss-Newton.

        What is minimised is the sum over joints of 2 (1 - cos angle), about the squared angle, of their rotations
        against their parents and against the pelvis, and SPREAD |z|^2. The latter decide where limbs are: without them
        what a network cannot express is left where it shows most (joints 6.5 mm off instead of 2.7).
        """
        if not rough:
            return torch.cat([self._encode(part, ENCODER_STEPS) for part in body_pose.split(TOGETHER)])
        parts = body_pose.float().split(TOGETHER_ROUGH)
        return torch.cat([self._single._encode(part, ROUGH_STEPS) for part in parts]).to(body_pose.dtype)

    @cached_property
    def _single(self) -> "LatentPrior":
        return self.to(dtype=torch.float32, device=self.neutral.device)

    def _encode(self, body_pose: Tensor, steps: int) -> Tensor:
        target = rotations.exp(body_pose.view(-1, N_JOINTS, 3))
        z = self._encoder(_ENCODED[self.network.encoder[0].weight.shape[1]](body_pose, target))
        rest = torch.zeros_like(z)
        cost, rest_cost = self._distance(z, target), self._distance(rest, target)
        better = ~(cost <= rest_cost)
        z, cost = torch.where(better[:, None], rest, z), torch.where(better, rest_cost, cost)
        # Not by `least_squares`: there a step lowers the damping to a fifth at most, and a rough encoding has five.
        damping, done = torch.full_like(cost, 1e-2), torch.zeros_like(better)
        for _ in range(steps):
            trial = z + self._step(z, target, damping)
            trial_cost = self._distance(trial, target)
            better = trial_cost < cost
            done |= (better & (cost - trial_cost < _SETTLED * cost)) | (damping > _STUCK)
            z, cost = torch.where(better[:, None], trial, z), torch.where(better, trial_cost, cost)
            damping = torch.where(better, damping / 10, damping * 10)
            if bool(done.all()):
                break
        return z

    def _distance(self, z: Tensor, target: Float[Tensor, "B 21 3 3"]) -> Float[Tensor, "B"]:
        """Sum of 2 (1 - cos angle), which is half the squared distance of the matrices, and SPREAD |z|^2."""
        matrices = self.rotations(z)
        world = (in_pelvis(matrices) - in_pelvis(target)).square().sum((2, 3))
        apart = (matrices - target).square().sum((1, 2, 3)) + world @ z.new_tensor(CARRIED)
        return apart / 2 + SPREAD * z.square().sum(1)

    def _step(self, z: Tensor, target: Tensor, damping: Float[Tensor, "B"]) -> Tensor:
        matrices, turn = self._turns(z)
        world = in_pelvis(matrices)
        moved: list[Tensor] = []
        for j, parent in enumerate(PARENTS):
            own = world[:, j] @ turn[:, j]
            moved.append(own if parent < 0 else own + moved[parent])
        weight = z.new_tensor(CARRIED).sqrt()[:, None]
        jacobian = torch.cat([turn, weight[..., None] * (world.mT @ torch.stack(moved, 1))], 1).flatten(1, 2)
        sine = torch.cat([_sine(matrices.mT @ target), weight * _sine(world.mT @ in_pelvis(target))], 1)
        pull = (jacobian.mT @ sine.flatten(1)[..., None])[..., 0] - SPREAD * z
        normal = jacobian.mT @ jacobian
        scale = normal.diagonal(dim1=1, dim2=2).mean(1)
        diagonal = torch.eye(self.size, dtype=z.dtype, device=z.device)
        return torch.linalg.solve(normal + (SPREAD + damping * scale)[:, None, None] * diagonal, pull)


def in_pelvis(matrices: Float[Tensor, "B 21 3 3"]) -> Float[Tensor, "B 21 3 3"]:
    """Rotations of the body joints against the pelvis, from those against their parents."""
    world: list[Tensor] = []
    for j, parent in enumerate(PARENTS):
        world.append(matrices[:, j] if parent < 0 else world[parent] @ matrices[:, j])
    return torch.stack(world, 1)


def _sine(matrices: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Axis times the sine of the angle."""
    a, b = matrices, matrices.mT
    return torch.stack([(a - b)[..., 2, 1], (a - b)[..., 0, 2], (a - b)[..., 1, 0]], -1) / 2


_ENCODED: dict[int, Callable[[Tensor, Tensor], Tensor]] = {
    63: lambda pose, matrices: pose,
    126: lambda pose, matrices: matrices[..., :2].flatten(1),
    189: lambda pose, matrices: matrices.flatten(1),
}
"""What an encoder looks at, of axis-angle and rotation matrices, by how many numbers it takes."""
assert _ENCODED.keys() == INPUTS.keys()
