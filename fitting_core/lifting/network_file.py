"""Files of networks over windows of keypoints: an npz of a network's arrays by name, and `about`, JSON that describes
it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
import torch
from torch import Tensor, nn

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.lifting.network import FRAMES, RATE, LifterSize


class NetworkAbout(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Metadata of a network's file."""

    format: str
    width: int
    layers: int
    heads: int
    frames: int
    """Of a window, as the network expects."""
    rate: float
    """Frames per second of a window."""
    notes: str = ""
    """How it was made, for people."""

    @property
    def size(self) -> LifterSize:
        """Of the network's trunk."""
        return LifterSize(width=self.width, layers=self.layers, heads=self.heads)

    @property
    def possible(self) -> bool:
        """Whether such a network is possible."""
        return self.width % max(self.heads, 1) == 0


About = TypeVar("About", bound=NetworkAbout)


def write_network(path: Path, arrays: Mapping[str, Tensor], about: NetworkAbout) -> None:
    """Write a network atomically, at half the precision of its training."""
    halves = {name: values.detach().cpu().numpy().astype(np.float16) for name, values in arrays.items()}
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **halves})


def read_network(path: Path, kind: type[About], expected: str, noun: str) -> tuple[About, dict[str, Tensor]]:
    """The network that `write_network` wrote. Raises InputError if it is missing, damaged, or has the wrong form.

    Args:
        path: The file.
        kind: The class of its description.
        expected: Its format.
        noun: Its name in errors.
    """
    try:
        arrays = read_npz(path, most=2**26)
        about = msgspec.json.decode(str(arrays.pop("about")), type=kind)
    except (OSError, ValueError, KeyError, msgspec.DecodeError) as error:
        raise InputError(f"{path}: is not a {noun} ({error}). Reinstall tcfit, or name another file.") from error
    if (about.format, about.frames, about.rate) != (expected, FRAMES, RATE):
        found = f"{about.format!r} for {about.frames} frames at {about.rate:g} per second"
        raise InputError(f"{path}: is {found}, expected {expected!r} for {FRAMES} at {RATE:g}. Reinstall tcfit.")
    if not about.possible:
        raise InputError(f"{path}: its description is impossible ({about}). Reinstall tcfit.")
    return about, {name: torch.as_tensor(array.astype(np.float32)) for name, array in arrays.items()}


def fill(network: nn.Module, arrays: Mapping[str, Tensor], path: Path, *, without: tuple[str, ...] = ()) -> None:
    """Load a network's arrays for use. Raises InputError if the arrays are not those of the network, or not finite.

    Args:
        network: Keeps what it has under the names that begin with one of `without`.
        arrays: All others.
        path: The file, for errors.
        without: Beginnings of names.
    """
    wanted = {name: values.shape for name, values in network.state_dict().items() if not name.startswith(without)}
    if {name: values.shape for name, values in arrays.items()} != wanted:
        raise InputError(f"{path}: its arrays are not those of its network. Reinstall tcfit.")
    if not all(bool(values.isfinite().all()) for values in arrays.values()):
        raise InputError(f"{path}: holds values that are not finite. Reinstall tcfit.")
    network.load_state_dict(arrays, strict=False)
    network.eval().requires_grad_(False)
