"""The lifter's file."""

import math
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

from fitting_core.lifting.network import FRAMES, RATE, Lifter
from fitting_core.lifting.network_file import NetworkAbout, fill, read_network, write_network
from fitting_core.shipped import LIFTER

FORMAT = "tcfit lifter 1"


class AboutLifter(NetworkAbout, kw_only=True):
    """Metadata of the file."""

    error_factor: float
    """Factor for the network's expected errors, from motion that it was not trained on."""

    @property
    def possible(self) -> bool:
        """Whether such a network is possible."""
        return super().possible and math.isfinite(self.error_factor) and self.error_factor > 0


def write_lifter(path: Path, network: Lifter, *, error_factor: float, notes: str) -> None:
    """Write a network atomically, at half the precision of its training."""
    of_windows = {"frames": FRAMES, "rate": RATE, **asdict(network.size)}
    about = AboutLifter(format=FORMAT, error_factor=error_factor, notes=notes, **of_windows)
    write_network(path, network.state_dict(), about)


@lru_cache(maxsize=2)
def read_lifter(path: Path = LIFTER) -> tuple[Lifter, float]:
    """The network that `write_lifter` wrote, and its error factor. Raises InputError if it is missing, damaged, or has
    the wrong form."""
    about, arrays = read_network(path, AboutLifter, FORMAT, "lifter")
    network = Lifter(about.size)
    fill(network, arrays, path)
    return network, about.error_factor
