"""Lifting a whole clip: overlapping windows, blended frame by frame."""

import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.model import other_side
from fitting_core.camera import Camera, CameraPath
from fitting_core.lifting.network import FRAMES, RATE, Lifter, read_lifter
from fitting_core.lifting.rays import POINTS, SEEN, seen
from fitting_core.shipped import LIFTER

LIFTED_HEIGHT = 1.71
"""Metres: average height of the bodies in the lifter's training data."""
_STRIDE = FRAMES // 2
_MIDDLE = FRAMES // 2
_AT_ONCE = 32
_OTHER_SIDE = [kp.INDEX[other_side(name)] for name in kp.BODY_25]
_KEPT = 2048
"""Windows whose result is cached: an edit changes two or three of a clip, and the others are not lifted again."""
_SMALLEST = 0.005
"""Metres, as in training."""
_AHEAD = 0.1
"""Minimum depth, in metres or for a ray, before the middle frame's camera: nearer points are not seen by it."""


@dataclass(frozen=True, eq=False)
class LiftedClip:
    """The lifter's result for each frame, in camera axes (x right, y down, z away)."""

    points: Float[np.ndarray, "T 25 3"]
    """BODY_25 relative to the pelvis joint, metres."""
    depth_deviation: Float[np.ndarray, "T 25"]
    """Standard deviation of their z, metres."""
    up: Float[np.ndarray, "T 3"]
    """Against gravity; shorter than 1 if unsure."""
    contact: Float[np.ndarray, "T 2"]
    """Probability that the left and the right foot stand still on the ground."""


def lift(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    camera: Camera,
    frame_rate: float,
    *,
    calibrated: bool,
    depth: Float[np.ndarray, "T 25"] | None = None,
    weights: Path = LIFTER,
) -> LiftedClip:
    """Lift BODY_25 keypoints, the first 25 of K. Raises InputError if the file is not a lifter network.

    Args:
        xy: Pixels.
        confidence: 0 for keypoints to ignore.
        camera: Of the clip.
        frame_rate: Frames per second.
        calibrated: Whether the camera's focal length is known, not guessed.
        depth: Depth in metres of the keypoints before a moving camera. With it the camera's whole motion is removed
            from what the network sees, without it only its rotation.
        weights: The network's file.
    """
    factor = read_lifter(weights)[1]
    rays = (xy[:, :POINTS] - np.array(camera.center)) / np.array(camera.focal)
    time, starts, given = _windows_of(rays, confidence, frame_rate)
    moves = None if camera.path is None else _moves_in(camera.path, time, _places_in_clip(starts, len(time)), depth)
    parts = _windows(weights, given if moves is None else moves.taken_from(given), calibrated=calibrated)
    if moves is not None:
        parts = _turned(parts, moves.turns[:, _MIDDLE, None])
    values = _interpolated(_together(parts, starts, len(time)), time, len(xy))
    if camera.path is not None:
        values = _turned(values, camera.path.to_still.swapaxes(1, 2))
    points, error, up, contact = np.split(values, np.cumsum([3 * POINTS, POINTS, 3]), axis=1)
    # For a Laplace distribution the deviation is sqrt(2) times the mean distance.
    deviation = np.sqrt(2) * factor * np.maximum(np.exp(error), _SMALLEST)
    return LiftedClip(points.reshape(-1, POINTS, 3), deviation, up, 1 / (1 + np.exp(-contact)))


@dataclass(frozen=True, eq=False)
class _Moves:
    """How a camera moves through the samples of W windows."""

    turns: Float[np.ndarray, "W F 3 3"]
    """Rotations of camera space into still space."""
    places: Float[np.ndarray, "W F 3"]
    """Of the camera in still space, metres."""
    depth: Float[np.ndarray, "W F 25"] | None
    """Of the keypoints, metres; None: ignore the camera's translation."""

    def taken_from(self, given: Float[np.ndarray, "W F 25 3"]) -> Float[np.ndarray, "W F 25 3"]:
        """Windows as seen by the camera of their middle frame: the network was trained on static cameras."""
        points = np.concatenate([given[..., :2], np.ones_like(given[..., :1])], -1)
        back = self.turns[:, _MIDDLE, None]
        if self.depth is None:
            points = points @ (back.swapaxes(-1, -2) @ self.turns).swapaxes(-1, -2)
        else:
            still = (points * self.depth[..., None]) @ self.turns.swapaxes(-1, -2)
            points = (still + (self.places - self.places[:, _MIDDLE, None])[..., None, :]) @ back
        ahead = points[..., 2:] > _AHEAD
        flat = points[..., :2] / np.where(ahead, points[..., 2:], 1.0)
        return (np.concatenate([flat, given[..., 2:]], -1) * ahead).astype(np.float32)


def _moves_in(
    path: CameraPath, time: Float[np.ndarray, "S"], samples: Int[np.ndarray, "W F"], depth: np.ndarray | None
) -> _Moves:
    """Interpolated linearly between frames."""
    frames = np.arange(len(path))
    at = np.minimum(time, frames[-1])
    turns = np.broadcast_to(path.to_still[0], (len(time), 3, 3))
    if len(path) > 1:
        turns = Slerp(frames, Rotation.from_matrix(path.to_still))(at).as_matrix()

    def sampled(values: Float[np.ndarray, "T n"]) -> Float[np.ndarray, "W F n"]:
        return np.stack([np.interp(at, frames, column) for column in values.T], 1)[samples]

    return _Moves(turns[samples], sampled(path.places), None if depth is None else sampled(depth))


def _turned(values: Float[np.ndarray, "*n v"], turns: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n v"]:
    """The network's output, with points and up rotated into other axes."""
    points, error, up, contact = np.split(values, np.cumsum([3 * POINTS, POINTS, 3]), axis=-1)
    back = turns.swapaxes(-1, -2)
    around = (points.reshape(*points.shape[:-1], POINTS, 3) @ back).reshape(points.shape)
    return np.concatenate([around, error, (up[..., None, :] @ back)[..., 0, :], contact], -1)


def _windows_of(
    rays: Float[np.ndarray, "T 25 2"], confidence: Float[np.ndarray, "T K"], frame_rate: float
) -> tuple[Float[np.ndarray, "S"], Int[np.ndarray, "W"], Float[np.ndarray, "W F 25 3"]]:
    """A clip as overlapping windows.

    Returns:
        The sample times in the clip's frames; the first sample of each window; rays and confidence of the windows.
    """
    time = np.arange(max(2, int(np.ceil((len(rays) - 1) / frame_rate * RATE)) + 1)) / RATE * frame_rate
    sampled, there = _sampled(rays, confidence[:, :POINTS], time)
    # The first and last windows extend beyond the clip, so that its ends are not theirs.
    starts = np.arange(-_STRIDE // 2, max(len(time) - _STRIDE // 2, 1), _STRIDE)
    index = _places_in_clip(starts, len(time))
    return time, starts, np.concatenate([sampled, there[..., None]], -1)[index].astype(np.float32)


def _places_in_clip(starts: Int[np.ndarray, "W"], length: int) -> Int[np.ndarray, "W F"]:
    """Of the samples that each window has."""
    return _reflected(starts[:, None] + np.arange(FRAMES), length)


def _sampled(rays: np.ndarray, confidence: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays and confidences at given times, in frames: interpolated if both neighbours show a keypoint, or of the
    nearer."""
    before = np.minimum(np.floor(time).astype(int), len(rays) - 1)
    after = np.minimum(before + 1, len(rays) - 1)
    share = np.broadcast_to((time - before)[:, None], (len(time), POINTS))
    one, other = confidence[before] > SEEN, confidence[after] > SEEN
    share = np.where(one & other, share, np.where(one, 0.0, np.where(other, 1.0, share)))
    near = np.where(share < 0.5, one, other)
    value = (1 - share)[..., None] * rays[before] + share[..., None] * rays[after]
    level = (1 - share) * confidence[before] + share * confidence[after]
    return np.where(near[..., None], value, 0.0), np.where(near, np.minimum(level, 1.0), 0.0)


def _reflected(index: np.ndarray, length: int) -> np.ndarray:
    """Beyond its ends a clip is played backward, as in training."""
    last = max(length - 1, 1)
    index = np.abs(index) % (2 * last)
    return np.where(index > last, 2 * last - index, index).clip(0, length - 1)


_remembered: OrderedDict[bytes, np.ndarray] = OrderedDict()
_lock = Lock()


def _windows(weights: Path, given: np.ndarray, *, calibrated: bool) -> np.ndarray:
    """(windows, FRAMES, 25 points x 3 + 25 + 3 + 2) in camera axes, of rays and confidence as of `_windows_of`."""
    network, by = read_lifter(weights)[0], str(weights).encode() + bytes([calibrated])
    keys = [hashlib.sha1(window.tobytes() + by).digest() for window in given]
    with _lock:
        found = {key: _remembered[key] for key in keys if key in _remembered}
    fresh = [i for i, key in enumerate(keys) if key not in found]
    for start in range(0, len(fresh), _AT_ONCE):
        some = fresh[start : start + _AT_ONCE]
        for i, values in zip(some, _lifted(network, torch.as_tensor(given[some]), calibrated), strict=True):
            found[keys[i]] = values
    with _lock:
        _remembered.update(found)
        while len(_remembered) > _KEPT:
            _remembered.popitem(last=False)
    return np.stack([found[key] for key in keys])


@torch.no_grad()
def _lifted(network: Lifter, given: Float[Tensor, "B T 25 3"], calibrated: bool) -> np.ndarray:
    """The mean over the windows and their mirror images, 2 % more accurate than the windows alone."""
    seen_mirrored = given[:, :, _OTHER_SIDE] * given.new_tensor([-1.0, 1.0, 1.0])
    straight, mirrored = (_one_way(network, some, calibrated) for some in (given, seen_mirrored))
    values = torch.stack([straight, _mirrored(mirrored)])
    return values.mean(0).double().numpy()


def _one_way(network: Lifter, given: Float[Tensor, "B T 25 3"], calibrated: bool) -> Float[Tensor, "B T n"]:
    made = seen(given[..., :2], given[..., 2], torch.full((len(given),), float(calibrated)))
    out = network(made.features)
    back = made.to_virtual[:, None]
    points, up = out.points @ back, (out.up[:, :, None] @ back)[:, :, 0]
    return torch.cat([points.flatten(2), out.log_error, up, out.contact], 2)


def _mirrored(values: Float[Tensor, "B T n"]) -> Float[Tensor, "B T n"]:
    """The network's result for a mirrored person, mirrored back."""
    points, error, up, contact = values.split([3 * POINTS, POINTS, 3, 2], 2)
    flip = values.new_tensor([-1.0, 1.0, 1.0])
    back = points.unflatten(2, (POINTS, 3))[:, :, _OTHER_SIDE] * flip
    return torch.cat([back.flatten(2), error[:, :, _OTHER_SIDE], up * flip, contact.flip(2)], 2)


def _together(parts: Float[np.ndarray, "W F n"], starts: np.ndarray, length: int) -> Float[np.ndarray, "S n"]:
    """Blend windows: the middle of one has more weight than its ends."""
    weight = np.bartlett(FRAMES + 2)[1:-1, None]
    total, shares = np.zeros((length, parts.shape[2])), np.zeros((length, 1))
    for start, part in zip(starts, parts, strict=True):
        inside = slice(max(0, -start), min(FRAMES, length - start))
        rows = slice(start + inside.start, start + inside.stop)
        total[rows] += weight[inside] * part[inside]
        shares[rows] += weight[inside]
    return total / shares


def _interpolated(values: Float[np.ndarray, "S n"], time: np.ndarray, frames: int) -> Float[np.ndarray, "T n"]:
    """Resample from the windows' times to a clip's frames."""
    at = np.interp(np.arange(frames), time, np.arange(len(time)))
    before = np.minimum(np.floor(at).astype(int), len(values) - 1)
    after = np.minimum(before + 1, len(values) - 1)
    share = (at - before)[:, None]
    return (1 - share) * values[before] + share * values[after]
