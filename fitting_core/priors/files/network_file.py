"""Latent pose priors as files of our own: an npz of arrays, and what they are as JSON. Imports no torch.

| key | shape | |
|---|---|---|
| decoder_weight_0, decoder_bias_0, decoder_weight_1, ... | (out, in), (out,) | float32 or float16, layer by layer |
| encoder_weight_0, ... | | the same |
| about | () | JSON text: `About` |
"""

from pathlib import Path

import msgspec
import numpy as np

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.npz import read_npz
from fitting_core.priors.files.network import Activation, Layer, PriorNetwork

FORMAT = "tcfit pose prior 1"


class About(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What an npz of a pose prior says of itself."""

    format: str
    title: str
    licence: str
    decoder: list[Activation]
    """What follows each layer."""
    encoder: list[Activation]
    notes: str = ""
    """How it came about, for people."""


def write_network(path: Path, network: PriorNetwork, *, dtype: type[np.floating] = np.float32, notes: str = "") -> None:
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
    about = About(
        format=FORMAT,
        title=network.title,
        licence=network.licence,
        decoder=[layer.activation for layer in network.decoder],
        encoder=[layer.activation for layer in network.encoder],
        notes=notes,
    )
    with replacing(path) as draft:
        np.savez_compressed(draft, allow_pickle=False, about=np.array(msgspec.json.encode(about).decode()), **arrays)


def read_network(path: Path) -> PriorNetwork:
    """Read what `write_network` wrote.

    Raises:
        InputError: It is missing, damaged, of another version, or its layers do not fit together.
    """
    arrays = _arrays(path)
    try:
        about = msgspec.json.decode(str(arrays.pop("about")), type=About)
        decoder, encoder = (
            tuple(
                Layer(arrays.pop(f"{name}_weight_{i}"), arrays.pop(f"{name}_bias_{i}"), activation)
                for i, activation in enumerate(activations)
            )
            for name, activations in (("decoder", about.decoder), ("encoder", about.encoder))
        )
        if arrays:
            raise InputError(f"it holds {', '.join(sorted(arrays))}, which belongs to no layer")
        return PriorNetwork(decoder=decoder, encoder=encoder, title=about.title, licence=about.licence)
    except KeyError as error:
        raise InputError(f"{path}: lacks {error}, expected a file of the form {FORMAT!r}.") from error
    except (msgspec.DecodeError, InputError) as error:
        raise InputError(f"{path}: is no sound pose prior: {error}.") from error


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        arrays = read_npz(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: does not exist. Give VPoser or the npz file of a pose prior.") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no complete npz archive ({error}). Get it again.") from error
    try:
        found = msgspec.json.decode(str(arrays["about"]))["format"]
    except (KeyError, TypeError, msgspec.DecodeError):
        found = "an npz of another kind"
    if found != FORMAT:
        raise InputError(f"{path}: is {found!r}, expected {FORMAT!r}.")
    return arrays
