"""The vertices of fitted bodies, frame by frame and fast enough for drawing; their joints and keypoints."""

import threading
from collections import deque
from collections.abc import Callable, Hashable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int, UInt8
from torch import Tensor

from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import body_keypoints_in_space, joints_in_space, keypoints_in_space
from tcfit_app.analysis.byte_cache import ByteCache
from tcfit_app.analysis.seen import opacities

_LIMIT = 16 * 2**20
"""A hundred frames of the free body. A mesh takes 2.7 ms, so that longer loops play without the cache."""


class Meshes:
    """All vertices of one body in any pose, with a cache; its joints and keypoints. Thread-safe.

    A version identifies a BodyParams value: a change of parameters (a new run, a live correction) needs another
    version, any hashable value; old ones are evicted when memory is needed.

    Args:
        body: Common to all versions.
        limit: Bytes of the cache; a frame of the free body takes 162 kB.
    """

    def __init__(self, body: BodyModel, *, limit: int = _LIMIT) -> None:
        self.body = body
        self._mesh = shared_mesh(body)
        self._cache: ByteCache[np.ndarray] = ByteCache(limit, lambda vertices: vertices.nbytes)
        self._opacities: ByteCache[np.ndarray] = ByteCache(_LIMIT // 32, lambda found: found.nbytes)
        self.joints = FrameByFrame(lambda params: joints_in_space(body, params))
        """(T, 55, 3) for parameters: the kinematic joints in camera space, metres."""
        self.keypoints = FrameByFrame(lambda params: _keypoints(body, params))
        """(T, 137, 3) for parameters: the keypoints in camera space (metres), NaN where the body has none."""

    @property
    def faces(self) -> Int[np.ndarray, "F 3"]:
        """Triangles of the body, the same in all frames."""
        return self.body.faces

    def vertices(self, version: Hashable, params: BodyParams, frame: int) -> Float32[np.ndarray, "V 3"]:
        """One frame of `params`, identified by `version`, in camera space (metres); a read-only array."""
        found = self._cache.get((version, frame))
        if found is None:
            found = self.batch(params[[frame]])[0]
            found.setflags(write=False)
            self._cache.put((version, frame), found)
        return found

    def body_points(self, params: BodyParams) -> Float[np.ndarray, "T 25 3"]:
        """The BODY_25 keypoints of all frames in camera space, metres, NaN where the body has none."""
        return body_keypoints_in_space(self.body, params)

    def points(self, params: BodyParams) -> Float[np.ndarray, "T 137 3"]:
        """Like `keypoints` for a few frames, but not cached."""
        return _keypoints(self.body, params)

    def opacities(self, seen: Bool[np.ndarray, "55"]) -> UInt8[np.ndarray, "V"] | None:
        """See `seen.opacities`; the same array for the same joints, so that it is sent once. None if all are seen."""
        if seen.all():
            return None
        found = self._opacities.get(seen.tobytes())
        if found is None:
            found = opacities(self.body.skinning_weights, seen)
            self._opacities.put(seen.tobytes(), found)
        return found

    def batch(self, params: BodyParams) -> Float32[np.ndarray, "T V 3"]:
        """All frames of the parameters, in camera space (metres), bypassing the cache."""
        with torch.no_grad():
            return self._mesh(params).numpy()


def _keypoints(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 137 3"]:
    points, exists = keypoints_in_space(body, params)
    points[:, ~exists] = np.nan
    return points


KEPT = 3
"""Number of cached parameters: two runs on show, and a correction of one."""


class FrameByFrame:
    """A function of parameters, evaluated per frame. Thread-safe.

    A correction changes a few of thousands of frames: for new parameters, only frames that differ from cached
    parameters are evaluated.

    Args:
        evaluate: Returns (T, ...) for T frames.
    """

    def __init__(self, evaluate: Callable[[BodyParams], np.ndarray]) -> None:
        self._evaluate = evaluate
        self._known: deque[tuple[BodyParams, np.ndarray]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()

    def __call__(self, params: BodyParams) -> np.ndarray:
        """The values, in a read-only array."""
        with self._lock:
            known = list(self._known)
        values = self._found(params, known)
        values.setflags(write=False)
        with self._lock:
            self._known = deque([entry for entry in self._known if entry[1] is not values], KEPT)
            self._known.append((params, values))
        return values

    def _found(self, params: BodyParams, known: list[tuple[BodyParams, np.ndarray]]) -> np.ndarray:
        alike = [(_differing(params, other), values) for other, values in known if len(other) == len(params)]
        if not alike:
            return self._evaluate(params)
        changed, values = min(alike, key=lambda entry: int(entry[0].sum()))
        if not bool(changed.any()):
            return values
        if bool(changed.all()):
            return self._evaluate(params)
        frames, values = changed.nonzero()[:, 0], values.copy()
        values[frames.numpy()] = self._evaluate(params[frames])
        return values


def _differing(a: BodyParams, b: BodyParams) -> Bool[Tensor, "T"]:
    """Frames in which two results of the same length differ."""
    changed = torch.zeros(len(a), dtype=torch.bool)
    for name, ours in vars(a).items():
        theirs = getattr(b, name)
        if ours.shape != theirs.shape:
            return torch.ones_like(changed)
        changed |= (ours != theirs).any(1)
    return changed
