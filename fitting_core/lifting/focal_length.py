"""The focal length of a clip whose camera is unknown, with its uncertainty.

Bayes' rule: a prior over cameras, and what a network infers from how people look and move (`perspective`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.camera import Camera, default_focal, focal_from_35mm
from fitting_core.lifting.clip_lifting import windows_of
from fitting_core.lifting.perspective import LOG_EXTENTS, hidden_extent, read_perspective
from fitting_core.lifting.rays import POINTS, SEEN
from fitting_core.shipped import PERSPECTIVE

_LENSES_MM = np.geomspace(14.0, 300.0, 80)
"""35 mm equivalents that are distinguished."""
_USUAL_MM, _SPREAD = 35.0, 0.6
"""Prior over cameras, mostly phones: a normal distribution of the logarithm."""
_WEIGHT = 2.0
"""Weight of the windows' mean log likelihood. All windows show the same camera, person and errors."""
_TILT = 1.33
"""Excess slope of the weighted log likelihood over the log of the focal length, per e-fold."""
_TOO_SURE = 2.0
"""Factor by which the posterior is too narrow: with 1.7, the motion suite's tuning half's own value, 9 of 13 real
cameras were within the bounds. This and the four above are set on that half and on four real clips."""
_DOUBT = 1e-4, 1e-6
"""Floors that keep logarithms finite: of the training shares, of the network's output."""
_WHOLE = [[kp.INDEX[f"{side}_{part}"] for side in ("left", "right")] for part in ("shoulder", "hip", "ankle")]
_WHOLE_SHARE = 0.7
"""Share of a window's keypoints of the shoulders, the hips and the ankles each that must be seen."""
_MOST = 16
"""Windows that are used, spread over the clip."""
_ONE_IN_TEN = 1.2816
"""Standard deviations."""


@dataclass(frozen=True, kw_only=True)
class FocalEstimate:
    """The likeliest focal length, and bounds that contain the true one in 8 of 10 clips, in pixels."""

    focal: float
    low: float
    high: float


def estimate_focal(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    camera: Camera,
    frame_rate: float,
    *,
    weights: Path = PERSPECTIVE,
) -> FocalEstimate | None:
    """The focal length in pixels, from how near the camera seems to have stood.

    The person's height would not help: a person twice as tall, twice as far away, gives the same pictures.

    Args:
        xy: Pixels; BODY_25 are the first 25 of K.
        confidence: 0 for keypoints to ignore.
        camera: Only size and principal point are used.
        frame_rate: Frames per second.
        weights: The network's file.

    Returns:
        None if no window shows a person from shoulders to ankles.

    Raises:
        InputError: The file is not a perspective network.
    """
    assumed = default_focal(camera.size)
    rays = (xy[:, :POINTS] - np.array(camera.center)) / assumed
    given = windows_of(rays, confidence, frame_rate)[2]
    # Only windows that show people from shoulders to ankles; in others the network assumes everybody is far away.
    shares = (given[..., _WHOLE, 2] > SEEN).mean((1, 3))
    given = given[(shares >= _WHOLE_SHARE).all(1)]
    if not len(given):
        return None
    given = given[np.unique(np.linspace(0, len(given) - 1, _MOST).round().astype(int))]
    log_lens = np.log(_LENSES_MM)
    focals = focal_from_35mm(1.0, camera.size) * _LENSES_MM
    seen = _seen(given, np.log(focals / assumed), weights).mean(0)
    likely = -0.5 * ((log_lens - np.log(_USUAL_MM)) / _SPREAD) ** 2
    return _estimate(focals, likely + _WEIGHT * seen - _TILT * log_lens)


def _seen(
    given: Float[np.ndarray, "W F 25 3"], log_factor: Float[np.ndarray, "L"], weights: Path
) -> Float[np.ndarray, "W L"]:
    """The network's log likelihoods of focal lengths for each window, up to a constant.

    Args:
        given: Rays of the assumed focal length, and confidence.
        log_factor: From the assumed focal length to others; a longer lens makes the same pixels smaller in rays.
        weights: The network's file.
    """
    network, share = read_perspective(weights)
    some = torch.as_tensor(given)
    with torch.no_grad():
        features, extent = hidden_extent(some[..., :2], some[..., 2])
        probabilities = torch.softmax(network(features), 1).double().numpy()
    likelihood = np.log(probabilities + _DOUBT[1]) - np.log(share + _DOUBT[0])
    bins, own = LOG_EXTENTS.double().numpy(), extent.double().numpy()
    return np.array([np.interp(e - log_factor, bins, row) for e, row in zip(own, likelihood, strict=True)])


def _estimate(focals: Float[np.ndarray, "L"], log_posterior: Float[np.ndarray, "L"]) -> FocalEstimate:
    """Mean of the logarithm, and the 10 % and 90 % bounds."""
    posterior = np.exp(log_posterior - log_posterior.max())
    posterior /= posterior.sum()
    log = np.log(focals)
    mean = posterior @ log
    far = _ONE_IN_TEN * _TOO_SURE * float(np.sqrt(posterior @ (log - mean) ** 2))
    return FocalEstimate(focal=float(np.exp(mean)), low=float(np.exp(mean - far)), high=float(np.exp(mean + far)))
