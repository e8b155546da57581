"""Other views of a clip as arrays, for npz files. The first has the prefix view1_, the second view2_:

| key | shape | |
|---|---|---|
| view1_keypoints | (M, 137, 3) | of its M frames, like keypoints |
| view1_camera_*, view1_image_size, view1_vertical_*, view1_lens_*, view1_world_* | | its camera: see camera_arrays.py |
| view1_name, view1_detector, view1_frame_rate, view1_first_frame | () | like the first clip's |
| view1_times | (M,) | only of frames that are unevenly spaced in time: seconds |
| view1_rotation, view1_translation | (3, 3), (3,) | x_other = rotation @ x_first + translation, metres if the person \
is as tall as the average adult |
| view1_offset | () | seconds: what is at a time in the first clip is this much later in the other, each counted \
from its first frame |
| view1_deviations | (3,) | standard deviations of the rotation and of the direction from camera to camera, degrees, \
and of the offset, seconds |
| view1_agreement | (3,) | median angle by which viewing rays of the same keypoint miss each other, radians; seconds \
that both show; degrees between what both say is up |
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting_core.camera import is_rotation, matrix_of, vector_of
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.io.camera_arrays import camera_arrays, camera_from
from fitting_core.keypoints import COUNT, Keypoints

_PREFIX = re.compile(r"view([1-9][0-9]{0,2})_")
_DEVIATIONS = ("rotation_deviation", "direction_deviation", "offset_deviation")
_AGREEMENT = ("disagreement", "overlap", "vertical_off")


def view_arrays(views: Sequence[OtherView]) -> dict[str, np.ndarray]:
    """The arrays of the table above, of views that are related to the first clip."""
    found: dict[str, np.ndarray] = {}
    for number, view in enumerate(views, 1):
        found |= {f"view{number}_{name}": np.asarray(value) for name, value in _arrays(view).items()}
    return found


def _arrays(view: OtherView) -> dict[str, Any]:
    clip, relation = view.clip, view.relation
    assert relation is not None, "views of a clip are related to it"
    return {
        "keypoints": keypoint_array(clip.keypoints),
        "name": clip.name,
        "detector": clip.detector,
        "frame_rate": clip.frame_rate,
        "first_frame": clip.first_frame,
        "rotation": relation.turn,
        "translation": relation.shift,
        "offset": relation.offset,
        "deviations": [getattr(relation, name) for name in _DEVIATIONS],
        "agreement": [getattr(relation, name) for name in _AGREEMENT],
        **({} if view.times is None else {"times": view.times}),
        **camera_arrays(clip.camera),
    }


def views_from(arrays: dict[str, np.ndarray]) -> tuple[OtherView, ...]:
    """What `view_arrays` wrote.

    Raises:
        KeyError: An array is missing.
        ValueError: An array has another shape than it should, or holds what cannot be.
        TypeError: They do not make a camera.
    """
    numbers = {int(found[1]) for name in arrays if (found := _PREFIX.match(name))}
    return tuple(_view(_Prefixed(arrays, f"view{number}_")) for number in range(1, max(numbers, default=0) + 1))


class _Prefixed(dict[str, np.ndarray]):
    """The arrays with a prefix, without it; errors name them in full."""

    def __init__(self, arrays: dict[str, np.ndarray], prefix: str) -> None:
        super().__init__({name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)})
        self._prefix = prefix

    def __missing__(self, name: str) -> np.ndarray:
        raise KeyError(self._prefix + name)

    def numbers(self, name: str, *shape: int) -> np.ndarray:
        """An array of finite numbers. Raises ValueError if it is not that."""
        array = self[name]
        if array.shape != shape or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise ValueError(
                f"{self._prefix}{name} is {array.dtype} of the shape {array.shape}; expected finite numbers {shape}"
            )
        return array.astype(float)


def _view(arrays: _Prefixed) -> OtherView:
    count = len(arrays["keypoints"])
    keypoints = keypoints_from(arrays.numbers("keypoints", count, COUNT, 3))
    times = arrays.numbers("times", count) if "times" in arrays else None
    if times is not None and not (np.diff(times) > 0).all():
        raise ValueError("the times of a view's frames do not rise")
    rotation, translation = arrays.numbers("rotation", 3, 3), arrays.numbers("translation", 3)
    if not is_rotation(rotation):
        raise ValueError("the rotation of a view is not a rotation")
    deviations = zip(_DEVIATIONS, arrays.numbers("deviations", 3).tolist(), strict=True)
    agreement = zip(_AGREEMENT, arrays.numbers("agreement", 3).tolist(), strict=True)
    relation = Relation(
        rotation=matrix_of(rotation),
        translation=vector_of(translation),
        offset=float(arrays.numbers("offset")),
        **dict(deviations),
        **dict(agreement),
    )
    rate = float(arrays.numbers("frame_rate"))
    if rate <= 0:
        raise ValueError(f"the frame rate of a view is {rate:g}, expected above 0")
    clip = Clip(
        keypoints=keypoints,
        camera=camera_from(arrays),
        frame_rate=rate,
        name=str(arrays["name"]),
        first_frame=int(arrays["first_frame"]),
        detector=str(arrays["detector"]),
    )
    return OtherView(clip=clip, times=times, relation=relation)


def keypoint_array(keypoints: Keypoints) -> np.ndarray:
    """x, y and confidence of each keypoint in each frame."""
    return np.dstack([keypoints.xy, keypoints.confidence]).astype(np.float32)


def keypoints_from(found: np.ndarray) -> Keypoints:
    """What `keypoint_array` made. Raises ValueError if it has what cannot be."""
    if not np.isfinite(found).all() or found[..., 2].min() < 0 or found[..., 2].max() > 1:
        raise ValueError("a keypoint is not finite, or its confidence not between 0 and 1")
    return Keypoints(xy=found[..., :2].astype(float), confidence=found[..., 2].astype(float))
