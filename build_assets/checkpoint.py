"""Checkpoints of trainings, from which they go on."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file


def write_checkpoint(path: Path, of: Mapping[str, object], state: Mapping[str, object]) -> None:
    """Write how far a training is, whole or not at all.

    Args:
        path: The file.
        of: The training's settings, which it cannot go on without.
        state: Tensors, numbers, and lists and dictionaries of them.
    """
    with replacing(path) as draft:
        torch.save({"of": dict(of), **state}, draft)


def read_checkpoint(path: Path, of: Mapping[str, object], device: torch.device | str = "cpu") -> dict[str, Any]:
    """The state that `write_checkpoint` wrote, of a training with these settings.

    Raises:
        InputError: It belongs to a training with other settings, or is no checkpoint.
    """
    try:
        state = torch.load(regular_file(path, most=None), map_location=device, weights_only=True)
        found = state.pop("of")
    except Exception as error:  # torch raises whatever the damage led to
        raise InputError(f"{path}: not a checkpoint of this training ({error}). Delete it to start again.") from error
    if found != dict(of):
        raise InputError(
            f"{path}: belongs to a training with other settings, {found}; now: {dict(of)}. Give the same settings to "
            f"go on with it, or delete it to start again."
        )
    return state
