"""The two networks of a latent pose prior as plain arrays, decoder and encoder, layer by layer. Imports no torch.

Files of our own are an npz of these arrays, with what they are as JSON:

| key | shape | |
|---|---|---|
| decoder_weight_0, decoder_bias_0, decoder_weight_1, ... | (out, in), (out,) | float32 or float16, layer by layer |
| encoder_weight_0, ... | | the same |
| about | () | JSON text: `PriorAbout` |
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError, some_of
from fitting_core.files.npz import read_npz, write_npz

Activation = Literal["linear", "leaky_relu_0.01", "leaky_relu_0.2", "elu", "silu", "softplus", "tanh"]
"""Activation after a layer; a key of latent.ACTIVATIONS."""
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
    """A latent pose prior: poses decode from numbers that are independent and normal with variance 1. Raises InputError
    if the layers do not fit together, or are not a network of body poses."""

    decoder: tuple[Layer, ...]
    """From the latent numbers to OUTPUTS."""
    encoder: tuple[Layer, ...]
    """From a pose in one of INPUTS to the mean of its latent numbers."""
    title: str
    """Title for users: "VPoser 1"."""
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
                raise InputError(f"{where} holds values that are not finite numbers")


FORMAT = "tcfit pose prior 1"


class PriorAbout(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Metadata in the npz of a pose prior."""

    format: str
    title: str
    licence: str
    decoder: list[Activation]
    """Activation after each layer."""
    encoder: list[Activation]
    notes: str = ""
    """How it came about, for people."""


def write_prior_network(
    path: Path, network: PriorNetwork, *, dtype: type[np.floating] = np.float32, notes: str = ""
) -> None:
    """Write a pose prior, whole or not at all.

    Args:
        path: File, .npz.
        network: What is written.
        dtype: Of the arrays: np.float32, or np.float16 for half the size.
        notes: How it came about.
    """
    networks = {"decoder": network.decoder, "encoder": network.encoder}
    arrays = {
        f"{name}_{part}_{i}": getattr(layer, part).astype(dtype)
        for name, layers in networks.items()
        for i, layer in enumerate(layers)
        for part in ("weight", "bias")
    }
    about = PriorAbout(
        format=FORMAT,
        title=network.title,
        licence=network.licence,
        decoder=[layer.activation for layer in network.decoder],
        encoder=[layer.activation for layer in network.encoder],
        notes=notes,
    )
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **arrays})


def read_prior_network(path: Path) -> PriorNetwork:
    """Read a file of `write_prior_network`. Raises InputError if it is missing, damaged, of another version, or its
    layers do not fit together."""
    arrays = _arrays(path)
    try:
        about = msgspec.json.decode(str(arrays.pop("about")), type=PriorAbout)
        decoder, encoder = (
            tuple(
                Layer(arrays.pop(f"{name}_weight_{i}"), arrays.pop(f"{name}_bias_{i}"), activation)
                for i, activation in enumerate(activations)
            )
            for name, activations in (("decoder", about.decoder), ("encoder", about.encoder))
        )
        if arrays:
            raise InputError(f"it holds {some_of(sorted(arrays))}, which belongs to no layer")
        return PriorNetwork(decoder=decoder, encoder=encoder, title=about.title, licence=about.licence)
    except KeyError as error:
        raise InputError(f"{path}: lacks {error}, expected a file of the form {FORMAT!r}.") from error
    except (msgspec.DecodeError, InputError) as error:
        raise InputError(f"{path}: is not a sound pose prior: {error}.") from error


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        arrays = read_npz(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: does not exist. Give VPoser or the npz file of a pose prior.") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is not a complete npz archive ({error}). Get it again.") from error
    try:
        found = msgspec.json.decode(str(arrays["about"]))["format"]
    except (KeyError, TypeError, msgspec.DecodeError):
        found = "an npz of another kind"
    if found != FORMAT:
        raise InputError(f"{path}: is {found!r}, expected {FORMAT!r}.")
    return arrays
