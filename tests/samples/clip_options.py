"""Options of a clip and of its camera by their names, as tables of tests have them."""

from dataclasses import fields
from typing import Any

from fitting_core.clips.options import CameraOptions, ClipOptions


def as_options(options: dict[str, Any]) -> dict[str, Any]:
    """What `read_clip` is given for them."""
    clip, camera = (
        {f.name: options[f.name] for f in fields(kind) if f.name in options} for kind in (ClipOptions, CameraOptions)
    )
    assert len(clip) + len(camera) == len(options)
    return {"clip": ClipOptions(**clip), "camera": CameraOptions(**camera)}
