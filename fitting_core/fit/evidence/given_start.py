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
from fitting_core.fit.evidence.observations import USABLE, seen_confidence
from fitting_core.fit.evidence.sides import SEEN
from fitting_core.fit.variables.state import Parametrisation, State
from fitting_core.frame_runs import runs_where
from fitting_core.ground.placing import NEAREST, behind, rays_of
from fitting_core.keypoints import Keypoints

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


@dataclass(frozen=True, kw_only=True)
class StartRecord:
    """What is remembered of a start with the fit."""

    source: str
    """Name of the file or folder."""
    format: str
    """What it was read as, in words."""
    person: int | None
    """Of several people in it, the number of the one that was taken."""
    frames: int
    """Of the clip, in which the fit begins with it."""
    clip_frames: int
    focal: tuple[float, float]
    """Of its camera, in pixels of the clip's images."""
    focal_source: str
    off: float
    """Median distance between its keypoints and the detected ones in these frames, metres across the line of sight."""
    notes: tuple[str, ...] = ()
    """How it was read, for the user."""

    def sentence(self) -> str:
        """For the user."""
        who = "" if self.person is None else f", person {self.person}"
        return (
            f"Phase 1 begins with {self.source}, read as {self.format}{who}, in {self.frames} of {self.clip_frames} "
            f"frames; its focal length is {self.focal[0]:.0f} px ({self.focal_source}), and its keypoints are "
            f"{100 * self.off:.1f} cm off the detected ones (median)."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenStart:
    """T frames of a motion; `start[frames]` is the same for some consecutive ones."""

    params: BodyParams
    """Of the fitted body, in camera space; hands are axis-angle over the mean, 45 numbers each."""
    there: Bool[np.ndarray, "T"]
    """Frames in which a fit may begin with it."""
    points: Float[np.ndarray, "T 25 3"]
    """Where it has the keypoints of BODY_25 relative to the pelvis joint, metres in camera axes; NaN: it has not."""
    off: Float[np.ndarray, "T 25"]
    """How far these are from the detected ones across the line of sight, metres; where nothing is detected, the mean of
    the others."""
    about: StartRecord

    def __len__(self) -> int:
        return len(self.there)

    def __getitem__(self, frames: slice) -> "GivenStart":
        return replace(
            self, params=self.params[frames], there=self.there[frames], points=self.points[frames], off=self.off[frames]
        )

    def beside(self, keypoints: Keypoints, camera: Camera) -> "GivenStart":
        """The same beside keypoints as they stand now: where a person has placed some, what is off is off by that.

        A start that is held must give way to a hand. All other frames stay as they were measured when the fit began.

        Args:
            keypoints: the clip's.
            camera: which the fit sees them with.
        """
        edited = np.flatnonzero(keypoints.placed[:, kp.BODY].any(1) & self.there)
        if not len(edited):
            return self
        found = placed(self.points[edited], keypoints[edited], camera).off
        off = self.off.copy()
        off[edited] = np.where(np.isfinite(found), found, off[edited])
        return replace(self, off=off)

    @property
    def tells_hands(self) -> bool:
        """Whether it has hands at all: most systems leave them as the body's mean."""
        return bool(self.params.left_hand_pose.any() or self.params.right_hand_pose.any())

    def state(self, parametrisation: Parametrisation) -> State:
        """The poses in a solver's numbers, as near as its pose prior and its hand space come to them."""
        basis = parametrisation.hand_basis.to(self.params.left_hand_pose)
        left, right = self.params.left_hand_pose @ basis[0], self.params.right_hand_pose @ basis[1]
        return parametrisation.from_params(replace(self.params, left_hand_pose=left, right_hand_pose=right))

    def steady(self, frame_rate: float) -> "GivenStart":
        """The same, whose points do not tremble from frame to frame.

        By parabolas (Savitzky and Golay, 1964), as far as a point is there in all frames of one.

        Args:
            frame_rate: frames per second.
        """
        window, steady = 2 * round(_STEADY * frame_rate / 2) + 1, self.points.copy()
        if window <= _PARABOLA + 1:  # which goes through all of them
            return self
        known = self.there[:, None] & np.isfinite(self.points).all(-1)
        for point in range(known.shape[1]):
            for run in runs_where(known[:, point]):
                if len(run) >= window:
                    own = slice(run.start, run.stop), point
                    steady[own] = savgol_filter(self.points[own], window, _PARABOLA, axis=0)
        return replace(self, points=steady)

    def deviation(self, deviation: float) -> Float[np.ndarray, "T 25"]:
        """How far its points may be off, metres; infinite where it has none.

        What is off by so much across the line of sight is off by as much along it; half of that variance counts as the
        detector's.

        Args:
            deviation: standard deviation of points that lie where the detected ones are, metres.
        """
        known = self.there[:, None] & np.isfinite(self.points).all(-1)
        return np.where(known, np.sqrt(deviation**2 + self.off**2 / 2), np.inf)


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
