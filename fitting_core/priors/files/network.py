"""The two networks of a latent pose prior as plain arrays: decoder and encoder, layer by layer. Imports no torch."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError

Activation = Literal["linear", "leaky_relu_0.01", "leaky_relu_0.2", "elu", "silu", "softplus", "tanh"]
"""What follows a layer; latent.ACTIVATIONS says what each of them is."""
OUTPUTS = 126
"""Of the decoder: 21 joints x a 3 x 2 matrix, row by row, whose columns become a rotation by Gram-Schmidt."""
INPUTS = {63: "axis-angle", 126: "the first two columns of the rotation matrices", 189: "rotation matrices"}
"""Of the encoder, by their number: 21 joints x 3, x 3 x 2 or x 3 x 3, matrices row by row."""


@dataclass(frozen=True, eq=False)
class Layer:
    """activation(weight @ x + bias)."""

    weight: Float[np.ndarray, "out in"]
    bias: Float[np.ndarray, "out"]
    activation: Activation = "linear"

    def after_norm(
        self, scale: Float[np.ndarray, "in"], shift: Float[np.ndarray, "in"], mean: np.ndarray, variance: np.ndarray
    ) -> "Layer":
        """The layer with a batch normalisation of its input built in: at inference that is an affine map.

        (x - mean) / sqrt(variance + 1e-5) * scale + shift, as torch's BatchNorm1d has it.
        """
        slope = scale / np.sqrt(variance + 1e-5)
        return Layer(self.weight * slope, self.bias + self.weight @ (shift - slope * mean), self.activation)


@dataclass(frozen=True, kw_only=True, eq=False)
class PriorNetwork:
    """A latent pose prior: poses decode from numbers that are independent and normal with variance 1.

    Raises:
        InputError: The layers do not fit together, or are no network of a body pose.
    """

    decoder: tuple[Layer, ...]
    """From the latent numbers to OUTPUTS."""
    encoder: tuple[Layer, ...]
    """From a pose in one of INPUTS to the mean of its latent numbers."""
    title: str
    """What it is, for people: "VPoser 1"."""
    licence: str = ""

    def __post_init__(self) -> None:
        _check_chain("decoder", self.decoder)
        _check_chain("encoder", self.encoder)
        last, first = self.decoder[-1].weight.shape[0], self.encoder[0].weight.shape[1]
        if last != OUTPUTS:
            raise InputError(f"its decoder puts out {last} numbers, expected {OUTPUTS}: 21 joints x 6")
        if first not in INPUTS:
            raise InputError(f"its encoder takes {first} numbers, expected one of {', '.join(map(str, INPUTS))}")
        if self.encoder[-1].weight.shape[0] != self.size:
            found = self.encoder[-1].weight.shape[0]
            raise InputError(f"its encoder puts out {found} numbers, but its decoder takes {self.size}")

    @property
    def size(self) -> int:
        """Latent numbers."""
        return self.decoder[0].weight.shape[1]

    @property
    def hash(self) -> str:
        """Of the numbers, the first 16 digits of their SHA-256."""
        digest = hashlib.sha256()
        for layer in (*self.decoder, *self.encoder):
            for values in (layer.weight, layer.bias):
                digest.update(np.ascontiguousarray(values, "<f4").tobytes())
            digest.update(layer.activation.encode())
        return digest.hexdigest()[:16]


def _check_chain(name: str, layers: Sequence[Layer]) -> None:
    if not layers:
        raise InputError(f"its {name} has no layer")
    for number, layer in enumerate(layers):
        where = f"layer {number} of its {name}"
        weight, bias = layer.weight, layer.bias
        if layer.activation not in get_args(Activation):
            known = ", ".join(get_args(Activation))
            raise InputError(f"{where} has the activation {layer.activation!r}, expected one of {known}")
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.size == 0:
            raise InputError(f"{where} has a weight of shape {weight.shape} and a bias of shape {bias.shape}")
        if number and weight.shape[1] != layers[number - 1].weight.shape[0]:
            before = layers[number - 1].weight.shape[0]
            raise InputError(f"{where} takes {weight.shape[1]} numbers, but the one before puts out {before}")
        for values in (weight, bias):
            if values.dtype.kind != "f" or not np.isfinite(values).all():
                raise InputError(f"{where} holds values that are no finite numbers")
