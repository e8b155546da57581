"""Another system's result as the start of a fit: its poses on the fitted body, placed by the keypoints."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, hand_basis
from fitting_core.body.points.positions import body_keypoints_in_space, joints_in_space
from fitting_core.camera import Camera
from fitting_core.fit.evidence.observations import USABLE
from fitting_core.fit.variables.state import Parametrisation, State
from fitting_core.frame_runs import runs_where
from fitting_core.ground.placing import NEAREST, place_on_rays, rays_of
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import SEEN, Keypoints
from fitting_core.results.given_start import GivenStart, StartRecord

FOLLOWS = 0.15
"""Metres: if half of a frame's visible keypoints are farther off, it shows someone else, or another time."""
_ROBUST = 0.1
"""rho of the Geman-McClure function for placing a pose, metres."""
_PLACING_STEPS = 6
_STEADY = 0.24
"""Seconds over which held points are smoothed by a parabola. A fit held near a jittering start would jitter too: 31 in
place of 22 mm/frame² with starts from single images, and no closer to the truth (8 tuning windows of the motion suite).
Over 0.4 s the errors grow."""
_PARABOLA = 2
"""Its degree."""


def corrected_start(start: GivenStart, keypoints: Keypoints, camera: Camera) -> GivenStart:
    """Update a start to corrected keypoints: where a person has moved some, the start is off by that much.

    A held start must yield to corrections. All other frames keep the distances measured when the fit started.

    Args:
        start: as measured when the fit started.
        keypoints: the clip's.
        camera: the fit's camera.
    """
    edited = np.flatnonzero(keypoints.placed[:, kp.BODY].any(1) & start.there)
    if not len(edited):
        return start
    found = place_by_keypoints(start.points[edited], keypoints[edited], camera).off
    off = start.off.copy()
    off[edited] = np.where(np.isfinite(found), found, off[edited])
    return replace(start, off=off)


def state_of(start: GivenStart, parametrisation: Parametrisation) -> State:
    """A start's poses in a solver's variables, as closely as its pose prior and hand space can express them."""
    basis = parametrisation.hand_basis.to(start.params.left_hand_pose)
    left, right = start.params.left_hand_pose @ basis[0], start.params.right_hand_pose @ basis[1]
    return parametrisation.from_params(replace(start.params, left_hand_pose=left, right_hand_pose=right))


def steadied(start: GivenStart, frame_rate: float) -> GivenStart:
    """The start with its points smoothed over time.

    By parabolas (Savitzky and Golay, 1964), as far as a point exists in all frames of the window.

    Args:
        start: as placed.
        frame_rate: frames per second.
    """
    from scipy.signal import savgol_filter  # with it comes scipy.stats, for which the app need not wait

    window, points = 2 * round(_STEADY * frame_rate / 2) + 1, start.points.copy()
    if window <= _PARABOLA + 1:  # a parabola interpolates so few exactly
        return start
    known = start.there[:, None] & np.isfinite(start.points).all(-1)
    for point in range(known.shape[1]):
        for run in runs_where(known[:, point]):
            if len(run) >= window:
                own = slice(run.start, run.stop), point
                points[own] = savgol_filter(start.points[own], window, _PARABOLA, axis=0)
    return replace(start, points=points)


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """Where bodies must be to project onto their keypoints."""

    pelvis: Float[np.ndarray, "T 3"]
    """Camera space, metres; NaN where too few keypoints are visible, or it would be behind the camera."""
    off: Float[np.ndarray, "T 25"]
    """Remaining distance of each point from its viewing ray, metres; NaN for missing keypoints."""

    @property
    def median_off(self) -> Float[np.ndarray, "T"]:
        """Of each frame, metres; infinite where unknown."""
        known = np.isfinite(self.off).any(1)
        found = np.full(len(self.off), np.inf)
        found[known] = np.nanmedian(self.off[known], axis=1)
        return found


def place_by_keypoints(points: Float[np.ndarray, "T 25 3"], keypoints: Keypoints, camera: Camera) -> Placed:
    """Place bodies in front of a camera by their keypoints; their poses are unchanged.

    Iteratively reweighted least squares for the Geman-McClure function of the distances from the viewing rays: the
    gradient of rho^2 r^2 / (rho^2 + r^2) is that of r^2 times (rho^2 / (rho^2 + r^2))^2.

    Args:
        points: BODY_25 relative to the pelvis, metres in camera axes; NaN for missing ones.
        keypoints: of these frames.
        camera: the camera.
    """
    known = np.asarray(np.isfinite(points).all(-1))
    confidence = seen_confidence(keypoints, camera)[:, kp.BODY]
    counted = np.where(known & (confidence > SEEN), confidence, 0.0)
    from_pelvis, rays = np.where(known[..., None], points, 0.0), rays_of(keypoints.xy[:, kp.BODY], camera)
    pelvis, off = place_on_rays(from_pelvis, rays, counted)  # without robust weights, for the first residuals
    for _ in range(_PLACING_STEPS - 1):
        pelvis, off = place_on_rays(from_pelvis, rays, counted * (_ROBUST**2 / (_ROBUST**2 + off**2)) ** 2)
    good = np.asarray(((counted > 0).sum(1) >= USABLE) & (pelvis[:, 2] > NEAREST))[:, None]
    return Placed(pelvis=np.where(good, pelvis, np.nan), off=np.where(good & (counted > 0), off, np.nan))


def given_start(
    params: BodyParams,
    there: Bool[np.ndarray, "T"],
    keypoints: Keypoints,
    camera: Camera,
    body: BodyModel,
    *,
    about: StartRecord,
    points: Float[np.ndarray, "T 25 3"] | None = None,
) -> GivenStart:
    """A motion as a start: placed by the keypoints, without frames that do not match them.

    Frames with too few keypoints are placed by interpolation.

    Args:
        params: T frames of the fitted body in camera space; their translation is replaced.
        there: frames that the motion has.
        keypoints: the clip's detections.
        camera: the clip's.
        body: the fitted body.
        about: its record; frames and distance are filled in.
        points: BODY_25 relative to the pelvis on the motion's own body, metres; None: those of the fitted body.
    """
    params = with_whole_hands(body, params.to(dtype=torch.float64))
    points = from_pelvis(body, params) if points is None else points
    found = place_by_keypoints(points, keypoints, camera)
    follows = np.asarray(there & (found.median_off < FOLLOWS))
    there = np.asarray(there & (follows | np.isinf(found.median_off)) & follows.any())
    translation, off = params.camera_translation.numpy().copy(), np.zeros_like(found.off)
    if follows.any():
        moved = found.pelvis - joints_in_space(body, params)[:, JOINT["pelvis"]]
        translation += _between(moved, follows)
        seen = np.isfinite(found.off) & follows[:, None]
        middle = np.where(seen, found.off, 0.0).sum(1) / seen.sum(1).clip(1)
        off = np.where(seen, found.off, _between(middle[:, None], follows))
    return GivenStart(
        params=replace(params, camera_translation=torch.as_tensor(translation)),
        there=there,
        points=points,
        off=off,
        about=replace(
            about,
            frames=int(there.sum()),
            clip_frames=len(there),
            off=float(np.nanmedian(found.off[follows])) if follows.any() else float("nan"),
        ),
    )


def _between(values: Float[np.ndarray, "T n"], known: Bool[np.ndarray, "T"]) -> Float[np.ndarray, "T n"]:
    """Values where known, linearly interpolated in time between these frames."""
    at = np.flatnonzero(known)
    return np.stack([np.interp(np.arange(len(values)), at, column) for column in values[known].T], 1)


def with_whole_hands(body: BodyModel, params: BodyParams) -> BodyParams:
    """Hands of any number of components as axis-angle over the mean, 45 numbers each."""
    basis, _ = hand_basis(body, params.left_hand_pose.shape[1], params.body_pose)
    left, right = params.left_hand_pose @ basis[0].T, params.right_hand_pose @ basis[1].T
    return replace(params, left_hand_pose=left, right_hand_pose=right)


def from_pelvis(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 25 3"]:
    """BODY_25 keypoints of posed bodies relative to the pelvis joint, metres; NaN for those that the body lacks."""
    return body_keypoints_in_space(body, params) - joints_in_space(body, params)[:, JOINT["pelvis"], None]
