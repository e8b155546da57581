"""The lifter's file: an npz of its arrays by their names, and `about`, JSON that says what they are."""

import math
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
import torch

from assets import LIFTER
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.lifting.network import FRAMES, RATE, Lifter, LifterSize

FORMAT = "tcfit lifter 1"


class About(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What the file says of itself."""

    format: str
    width: int
    layers: int
    heads: int
    frames: int
    """Of a window, which the network is made for."""
    rate: float
    """Frames per second of a window."""
    error_factor: float
    """What the network's expected errors are to be multiplied by, from motion that it was not trained on."""
    notes: str = ""
    """How it came about, for people."""


def write_lifter(path: Path, network: Lifter, *, error_factor: float, notes: str) -> None:
    """Write a network, whole or not at all, with half the digits that it was trained with."""
    arrays = {name: values.detach().cpu().numpy().astype(np.float16) for name, values in network.state_dict().items()}
    size = network.size
    about = About(
        format=FORMAT,
        width=size.width,
        layers=size.layers,
        heads=size.heads,
        frames=FRAMES,
        rate=RATE,
        error_factor=error_factor,
        notes=notes,
    )
    write_npz(path, {"about": np.array(msgspec.json.encode(about).decode()), **arrays})


@lru_cache(maxsize=2)
def read_lifter(path: Path = LIFTER) -> tuple[Lifter, float]:
    """The network that `write_lifter` wrote, and its error factor.

    Raises:
        InputError: It is missing, damaged, or of another form.
    """
    try:
        arrays = read_npz(path, most=2**26)
        about = msgspec.json.decode(str(arrays.pop("about")), type=About)
    except (OSError, ValueError, KeyError, msgspec.DecodeError) as error:
        raise InputError(f"{path}: is no lifter ({error}). Install tcfit again, or name another file.") from error
    if (about.format, about.frames, about.rate) != (FORMAT, FRAMES, RATE):
        found = f"{about.format!r} for {about.frames} frames at {about.rate:g} per second"
        raise InputError(f"{path}: is {found}, expected {FORMAT!r} for {FRAMES} at {RATE:g}. Install tcfit again.")
    if not (math.isfinite(about.error_factor) and about.error_factor > 0 and about.width % max(about.heads, 1) == 0):
        raise InputError(f"{path}: says impossible things of itself ({about}). Install tcfit again.")
    network = Lifter(LifterSize(width=about.width, layers=about.layers, heads=about.heads))
    try:
        network.load_state_dict({name: torch.as_tensor(a.astype(np.float32)) for name, a in arrays.items()})
    except RuntimeError as error:
        raise InputError(f"{path}: its arrays are not those of its network ({error}). Install tcfit again.") from error
    if not all(bool(p.isfinite().all()) for p in network.parameters()):
        raise InputError(f"{path}: holds values that are not finite. Install tcfit again.")
    return network.eval().requires_grad_(False), about.error_factor
