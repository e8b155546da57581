"""What another system found, as the start of a fit: its poses on the fitted body, placed where the keypoints are."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.signal import savgol_filter

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, hand_basis
from fitting_core.body.points.positions import body_keypoints_in_space, joints_in_space
from fitting_core.camera import Camera
from fitting_core.fit.evidence.observations import USABLE
from fitting_core.fit.variables.state import Parametrisation, State
from fitting_core.frame_runs import runs_where
from fitting_core.ground.placing import NEAREST, behind, rays_of
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import SEEN, Keypoints
from fitting_core.results.given_start import GivenStart, StartRecord

FOLLOWS = 0.15
"""Metres: where half of the seen keypoints of a frame are farther off, it shows somebody else, or another time."""
_ROBUST = 0.1
"""rho of the Geman-McClure function when a pose is placed, metres."""
_PLACING_STEPS = 6
_STEADY = 0.24
"""Seconds over which points that are held move along a parabola. A fit that is held near what trembles would tremble
with it: 31 in place of 22 mm/frame² with starts of single images, and it would be no nearer to the truth (8 tuning
windows of the motion suite). Over 0.4 s the errors grow."""
_PARABOLA = 2
"""Its degree."""


def beside(start: GivenStart, keypoints: Keypoints, camera: Camera) -> GivenStart:
    """A start beside keypoints as they stand now: where a person has placed some, what is off is off by that.

    A start that is held must give way to a hand. All other frames stay as they were measured when the fit began.

    Args:
        start: as it was measured when the fit began.
        keypoints: the clip's.
        camera: which the fit sees them with.
    """
    edited = np.flatnonzero(keypoints.placed[:, kp.BODY].any(1) & start.there)
    if not len(edited):
        return start
    found = placed(start.points[edited], keypoints[edited], camera).off
    off = start.off.copy()
    off[edited] = np.where(np.isfinite(found), found, off[edited])
    return replace(start, off=off)


def state_of(start: GivenStart, parametrisation: Parametrisation) -> State:
    """A start's poses in a solver's numbers, as near as its pose prior and its hand space come to them."""
    basis = parametrisation.hand_basis.to(start.params.left_hand_pose)
    left, right = start.params.left_hand_pose @ basis[0], start.params.right_hand_pose @ basis[1]
    return parametrisation.from_params(replace(start.params, left_hand_pose=left, right_hand_pose=right))


def steadied(start: GivenStart, frame_rate: float) -> GivenStart:
    """The same start, whose points do not tremble from frame to frame.

    By parabolas (Savitzky and Golay, 1964), as far as a point is there in all frames of one.

    Args:
        start: as it was placed.
        frame_rate: frames per second.
    """
    window, points = 2 * round(_STEADY * frame_rate / 2) + 1, start.points.copy()
    if window <= _PARABOLA + 1:  # which goes through all of them
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
    """Where points seen from the pelvis must stand to be seen where keypoints are."""

    pelvis: Float[np.ndarray, "T 3"]
    """Camera space, metres; NaN where too few keypoints are seen, or it would lie behind the camera."""
    off: Float[np.ndarray, "T 25"]
    """How far they remain off, metres across the line of sight; NaN where nothing is seen."""

    @property
    def median_off(self) -> Float[np.ndarray, "T"]:
        """Of each frame, metres; infinite where it is not known."""
        known = np.isfinite(self.off).any(1)
        found = np.full(len(self.off), np.inf)
        found[known] = np.nanmedian(self.off[known], axis=1)
        return found


def placed(points: Float[np.ndarray, "T 25 3"], keypoints: Keypoints, camera: Camera) -> Placed:
    """Place bodies in front of a camera by their keypoints; how they stand and bend stays.

    Least squares, weighted anew after each solution by the Geman-McClure function of how far points are off their rays:
    the gradient of rho^2 r^2 / (rho^2 + r^2) is that of r^2 times (rho^2 / (rho^2 + r^2))^2.

    Args:
        points: BODY_25 relative to the pelvis, metres in camera axes; NaN where there is none.
        keypoints: the detections of these frames.
        camera: which sees them.
    """
    known = np.asarray(np.isfinite(points).all(-1))
    confidence = seen_confidence(keypoints, camera)[:, kp.BODY]
    counted = np.where(known & (confidence > SEEN), confidence, 0.0)
    from_pelvis, rays = np.where(known[..., None], points, 0.0), rays_of(keypoints.xy[:, kp.BODY], camera)
    pelvis, off = behind(from_pelvis, rays, counted)
    for _ in range(_PLACING_STEPS - 1):
        pelvis, off = behind(from_pelvis, rays, counted * (_ROBUST**2 / (_ROBUST**2 + off**2)) ** 2)
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
    """A motion as a start: placed by the keypoints, and left out where it does not follow them.

    Frames that show too few keypoints to tell are placed between those around them.

    Args:
        params: T frames of the fitted body in camera space; the translation is found anew.
        there: frames that the motion has.
        keypoints: the clip's detections.
        camera: the clip's.
        body: the fitted body.
        about: what is to be remembered; frames and distance are filled in.
        points: BODY_25 relative to the pelvis on the motion's own body, metres; None: as the fitted body has them.
    """
    params = with_whole_hands(body, params.to(dtype=torch.float64))
    points = from_pelvis(body, params) if points is None else points
    found = placed(points, keypoints, camera)
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
    """Values where they are known, and linear in time between those frames."""
    at = np.flatnonzero(known)
    return np.stack([np.interp(np.arange(len(values)), at, column) for column in values[known].T], 1)


def with_whole_hands(body: BodyModel, params: BodyParams) -> BodyParams:
    """Hands of any number of components as axis-angle over the mean, 45 numbers each."""
    basis, _ = hand_basis(body, params.left_hand_pose.shape[1], params.body_pose)
    left, right = params.left_hand_pose @ basis[0].T, params.right_hand_pose @ basis[1].T
    return replace(params, left_hand_pose=left, right_hand_pose=right)


def from_pelvis(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 25 3"]:
    """BODY_25 keypoints of posed bodies relative to the pelvis joint, metres; NaN for those that the body has not."""
    return body_keypoints_in_space(body, params) - joints_in_space(body, params)[:, JOINT["pelvis"], None]
