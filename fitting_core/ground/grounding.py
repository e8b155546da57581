"""Gravity, contacts and floor of a clip together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.camera import Camera
from fitting_core.ground.balance import with_balance
from fitting_core.ground.contacts import Contacts, contacts_of
from fitting_core.ground.gravity import Gravity, RolledView, gravity_before_fit, told_gravity, with_trunk
from fitting_core.ground.plane import Ground, ground_under
from fitting_core.lifting.clip_lifting import LiftedClip


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
