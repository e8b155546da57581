"""Gravity, contacts and floor of a clip together, and the vertical in which a standing body is balanced."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.camera import Camera
from fitting_core.ground.contacts import Contacts, contacts_of
from fitting_core.ground.gravity import Gravity, RolledView, gravity_before_fit, told_gravity, with_trunk
from fitting_core.ground.plane import Ground, ground_under
from fitting_core.lifting.clip_lifting import LiftedClip

_STATED = 2.5
"""Degrees: deviation of the direction found, at least."""
_DEAD, _SPREAD, _FAR = 0.02, 0.06, 0.3
"""Metres of the centre of mass beside the feet: what counts as nothing, its standard deviation in fits, and where its
weight has fallen to a quarter (Geman-McClure)."""
_LEAST = 0.3
"""Minimum share of frames in which the person stands: a person who gets up or rolls is not balanced."""
_INDEPENDENT = 4.0
"""Seconds between frames that tell the same twice."""
_MOST = 3.0
"""Frames that a clip counts as, at most: what lasts in a fit's errors lasts over the whole clip."""
_RADIUS, _STEP = 24.0, 1.0
"""Degrees."""
_FRAMES = 150


def with_balance(
    gravity: Gravity,
    centre: Float[np.ndarray, "T 3"],
    feet: Float[np.ndarray, "T 2 4 3"],
    standing: Bool[np.ndarray, "T 2"],
    frame_rate: float,
) -> Gravity:
    """The direction between the one known otherwise and the one in which the centre of mass is above the feet.

    It is the mean over directions up(x) = up + tan(x1) a + tan(x2) b of exp(-E / 2), with
    E = 2 |x|² / s² + n mean rho(d). s is the root mean square error of the direction known otherwise, and d the
    distance of the centre of mass from the segment between the middles of the standing feet, without its part along up.
    Accelerations are ignored: over a clip they add noise only. Still space, metres.

    Args:
        gravity: The direction known otherwise.
        centre: The body's centre of mass.
        feet: Ankle, heel, big and small toe of the left and the right foot.
        standing: Which feet carry the body.
        frame_rate: Frames per second.
    """
    stands = np.asarray(standing.any(1))
    if not len(stands) or stands.mean() < _LEAST:
        return gravity
    frames = np.flatnonzero(stands)
    count = min(1 + len(frames) / frame_rate / _INDEPENDENT, _MOST)
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, _FRAMES).round().astype(int))]
    one, other = _support(feet[frames], standing[frames])
    steps = np.arange(-_RADIUS, _RADIUS + _STEP / 2, _STEP)
    x = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    a = np.cross(gravity.up, [0.0, 0.0, 1.0])
    a /= np.linalg.norm(a)
    ups = gravity.up + np.tan(np.radians(x)) @ np.stack([a, np.cross(gravity.up, a)])
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    off = np.maximum(_beside(ups, centre[frames] - one, other - one) - _DEAD, 0.0) / _SPREAD
    robust = off**2 / (1 + (off * _SPREAD / _FAR) ** 2)
    energy = 2 * (x**2).sum(1) / gravity.deviation**2 + count * robust.mean(1)
    share = np.exp(-0.5 * (energy - energy.min()))
    share /= share.sum()
    up = share @ ups
    up /= np.linalg.norm(up)
    deviation = float(np.sqrt(share @ ((x - share @ x) ** 2).sum(1)))
    return Gravity(up=up, deviation=max(deviation, _STATED))


def _support(
    feet: Float[np.ndarray, "n 2 4 3"], standing: Bool[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Both ends of the segment between the standing feet's middles; the same point twice where one stands."""
    left, right = feet.mean(2).swapaxes(0, 1)
    return np.where(standing[:, :1], left, right), np.where(standing[:, 1:], right, left)


def _beside(
    ups: Float[np.ndarray, "G 3"], centre: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "G n"]:
    """How far a point is from the segment from the origin to `along`, seen along each direction."""

    def dot(v: Float[np.ndarray, "n 3"], w: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "G n"]:
        """Of the parts at right angles to each direction."""
        return (v * w).sum(1) - (ups @ v.T) * (ups @ w.T)

    length = dot(along, along)
    place = np.clip(dot(centre, along) / np.maximum(length, 1e-9), 0, 1)
    return np.sqrt(np.maximum(dot(centre, centre) - 2 * place * dot(centre, along) + place**2 * length, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Grounding:
    """Gravity, contacts and floor of a clip in camera space; for a moving camera, in still space (`CameraPath`)."""

    gravity: Gravity
    contacts: Contacts
    """Of its T frames."""
    ground: Ground | None
    """None if nothing stands in view."""
    missing: str = ""
    """Why there is no ground, in words for the user."""

    def __getitem__(self, frames: slice) -> Self:
        """The same for consecutive frames: gravity and floor are the whole clip's."""
        return replace(self, contacts=self.contacts[frames])

    @property
    def text(self) -> str:
        """One line for the user."""
        tilt = round(self.gravity.tilt)
        way = f"tilted {abs(tilt)}° {'down' if tilt > 0 else 'up'}" if tilt else "level"
        camera = f"camera {way} (± {self.gravity.deviation:.0f}°)"
        gone = self.contacts.let_go_share
        let_go = f"; in {_percent(gone)} one seems to, and goes on in the image" if gone else ""
        if self.ground is None:
            return f"Ground: none, {self.missing}{let_go}; {camera}"
        return f"Ground: seen (feet stand in {_percent(self.contacts.share)} of frames{let_go}), {camera}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def grounding_of(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    camera: Camera,
    frame_rate: float,
    *,
    feet: Float[np.ndarray, "T 2 4 3"],
    soles: Float[np.ndarray, "2 4"],
    trunk: Float[np.ndarray, "T 3"] | None = None,
    centre: Float[np.ndarray, "T 3"] | None = None,
    upright: Bool[np.ndarray, "T 2"] | None = None,
    rolled: Sequence[RolledView] = (),
) -> Grounding:
    """Gravity, contacts and floor from feet in space, such as a fitted body's.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen or is cut off by the image.
        lifted: The lifter's result for them.
        camera: Of the clip.
        frame_rate: Frames per second.
        feet: Still space, metres: ankle, heel, big and small toe of the left and the right foot.
        soles: How high these are above the sole of a flat foot, metres.
        trunk: From pelvis to neck, still space; used if there is no ground.
        centre: The body's centre of mass, still space, metres; with `upright`, a standing person's gives the vertical.
        upright: Whose foot may carry the body, as of `Stance`.
        rolled: Tells the camera's roll; without it, the camera is assumed level.
    """
    told = told_gravity(camera)
    gravity = told or gravity_before_fit(lifted, confidence, camera, rolled)
    contacts = contacts_of(xy, confidence, lifted, gravity, camera, frame_rate, feet)
    if not told and centre is not None and upright is not None:
        gravity = with_balance(gravity, centre, feet, contacts.standing & upright, frame_rate)
        contacts = contacts_of(xy, confidence, lifted, gravity, camera, frame_rate, feet)
    found = ground_under(feet, soles, contacts, gravity, frame_rate)
    if isinstance(found, str):
        gravity = gravity if trunk is None or told else with_trunk(gravity, trunk)
        return Grounding(gravity=gravity, contacts=contacts, ground=None, missing=found)
    return Grounding(gravity=gravity, contacts=contacts, ground=found)
