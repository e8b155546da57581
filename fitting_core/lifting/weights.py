"""The lifter's file: an npz of the network's arrays by name, and `about`, JSON that describes it."""

import math
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
import torch

from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.lifting.network import FRAMES, RATE, Lifter, LifterSize
from fitting_core.shipped import LIFTER

FORMAT = "tcfit lifter 1"


class AboutLifter(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Metadata of the file."""

    format: str
    width: int
    layers: int
    heads: int
    frames: int
    """Of a window, as the network expects."""
    rate: float
    """Frames per second of a window."""
    error_factor: float
    """Factor for the network's expected errors, from motion that it was not trained on."""
    notes: str = ""
    """How it was made, for people."""

    @property
    def possible(self) -> bool:
        """Whether such a network is possible."""
        return self.width % max(self.heads, 1) == 0 and math.isfinite(self.error_factor) and self.error_factor > 0


def write_lifter(path: Path, network: Lifter, *, error_factor: float, notes: str) -> None:
    """Write a network atomically, at half the precision of its training."""
    of_windows = {"frames": FRAMES, "rate": RATE, **asdict(network.size)}
    about = AboutLifter(format=FORMAT, error_factor=error_factor, notes=notes, **of_windows)
    halves = {name: values.detach().cpu().numpy().astype(np.float16) for name, values in network.state_dict().items()}
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **halves})


@lru_cache(maxsize=2)
def read_lifter(path: Path = LIFTER) -> tuple[Lifter, float]:
    """The network that `write_lifter` wrote, and its error factor. Raises InputError if it is missing, damaged, or has
    the wrong form."""
    try:
        arrays = read_npz(path, most=2**26)
        about = msgspec.json.decode(str(arrays.pop("about")), type=AboutLifter)
    except (OSError, ValueError, KeyError, msgspec.DecodeError) as error:
        raise InputError(f"{path}: is not a lifter ({error}). Reinstall tcfit, or name another file.") from error
    if (about.format, about.frames, about.rate) != (FORMAT, FRAMES, RATE):
        found = f"{about.format!r} for {about.frames} frames at {about.rate:g} per second"
        raise InputError(f"{path}: is {found}, expected {FORMAT!r} for {FRAMES} at {RATE:g}. Reinstall tcfit.")
    if not about.possible:
        raise InputError(f"{path}: its description is impossible ({about}). Reinstall tcfit.")
    network = Lifter(LifterSize(width=about.width, layers=about.layers, heads=about.heads))
    wanted = {name: values.shape for name, values in network.state_dict().items()}
    if {name: values.shape for name, values in arrays.items()} != wanted:
        raise InputError(f"{path}: its arrays are not those of its network. Reinstall tcfit.")
    if not all(np.isfinite(values).all() for values in arrays.values()):
        raise InputError(f"{path}: holds values that are not finite. Reinstall tcfit.")
    network.load_state_dict({name: torch.as_tensor(values.astype(np.float32)) for name, values in arrays.items()})
    network.eval().requires_grad_(False)
    return network, about.error_factor
