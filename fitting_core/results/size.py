"""The size of a fitted person in files."""

from collections.abc import Mapping

import numpy as np

from fitting_core.config.schema import FitConfig
from fitting_core.lifting.clip_lifting import LIFTED_HEIGHT


def size_from(arrays: Mapping[str, np.ndarray]) -> float | None:
    """`FitResult.size` of a stored fit; None in files of earlier versions. Raises ValueError if it is no person's."""
    if "size" not in arrays:
        return None
    if not 0.1 < (size := float(arrays["size"])) < 10:
        raise ValueError(f"its size is {size:g}, expected 0.1 to 10")
    return size


def earlier_size(config: FitConfig) -> float | None:
    """`FitResult.size` of fits of earlier versions, which took a given height from the beginning."""
    return None if config.height is None else config.height / 100 / LIFTED_HEIGHT
