"""Networks over windows of keypoints in files: an npz of a network's arrays by their names, and `about`, JSON that
says what it is."""

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
    """What the file of any network says of itself."""

    format: str
    width: int
    layers: int
    heads: int
    frames: int
    """Of a window, which the network is made for."""
    rate: float
    """Frames per second of a window."""
    notes: str = ""
    """How it came about, for people."""

    @property
    def size(self) -> LifterSize:
        """Of the network's trunk."""
        return LifterSize(width=self.width, layers=self.layers, heads=self.heads)

    @property
    def possible(self) -> bool:
        """Whether there can be such a network."""
        return self.width % max(self.heads, 1) == 0


Told = TypeVar("Told", bound=NetworkAbout)


def write_network(path: Path, arrays: Mapping[str, Tensor], about: NetworkAbout) -> None:
    """Write a network, whole or not at all, with half the digits that it was trained with."""
    halves = {name: values.detach().cpu().numpy().astype(np.float16) for name, values in arrays.items()}
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **halves})


def read_network(path: Path, kind: type[Told], expected: str, noun: str) -> tuple[Told, dict[str, Tensor]]:
    """What `write_network` wrote.

    Args:
        path: The file.
        kind: What it says of itself.
        expected: Its format.
        noun: What it is called in errors.

    Raises:
        InputError: It is missing, damaged, or of another form.
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
        raise InputError(f"{path}: says impossible things of itself ({about}). Reinstall tcfit.")
    return about, {name: torch.as_tensor(array.astype(np.float32)) for name, array in arrays.items()}


def fill(network: nn.Module, arrays: Mapping[str, Tensor], path: Path, *, without: tuple[str, ...] = ()) -> None:
    """Give a network what its file holds, for use.

    Args:
        network: Keeps what it has under the names that begin with one of `without`.
        arrays: All others.
        path: The file, for errors.
        without: Beginnings of names.

    Raises:
        InputError: The arrays are not those of the network, or not finite.
    """
    wanted = {name: values.shape for name, values in network.state_dict().items() if not name.startswith(without)}
    if {name: values.shape for name, values in arrays.items()} != wanted:
        raise InputError(f"{path}: its arrays are not those of its network. Reinstall tcfit.")
    if not all(bool(values.isfinite().all()) for values in arrays.values()):
        raise InputError(f"{path}: holds values that are not finite. Reinstall tcfit.")
    network.load_state_dict(arrays, strict=False)
    network.eval().requires_grad_(False)
