"""Giving hands a shape in one tab: a named one, one of the user's own, that of another frame or of the other hand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.handshapes import HANDSHAPES, finger_angles, in_hand
from fitting_core.body.model import POSE_JOINTS
from fitting_core.body.params import full_pose
from fitting_core.errors import InputError
from fitting_core.keypoints import FINGER_JOINTS, INDEX, LEFT_HAND, RIGHT_HAND, Side
from tcfit_app.fitting.fits import Shown
from tcfit_app.project.edits.kinds import Shape, ShapeHand
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.correcting import Correcting, across_sides
from tcfit_app.review.shared.own_handshapes import keep_handshape, own_handshapes
from tcfit_app.review.tab.tab import Tab

OTHER: dict[Side, Side] = {"left": "right", "right": "left"}
HAND_POINTS: dict[Side, slice] = {"left": LEFT_HAND, "right": RIGHT_HAND}
MOST_BLEND = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class HandPose:
    """The shape of a hand, with a name for people."""

    name: str
    angles: Float[np.ndarray, "15 3"]
    """Axis-angle in radians of the finger joints, as a left hand's."""


class ShapingHands:
    """Hands given a shape in one tab. Methods raise InputError for what cannot be done, and then change nothing."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self.blend = 4
        """Frames before and after the chosen ones in which a hand goes over into its shape and out of it."""
        self.copied: HandPose | None = None
        self.last: HandPose | None = None
        """The one given last."""

    def side(self) -> Side:
        """The hand of the selected keypoints, as the picture shows them. Raises InputError if it is not one hand."""
        chosen = self._tab.state.selection
        sides: list[Side] = [
            side
            for side, points in HAND_POINTS.items()
            if any(points.start <= joint < points.stop or joint == INDEX[f"{side}_wrist"] for joint in chosen)
        ]
        if len(sides) != 1:
            raise InputError("Select a hand first: one of its keypoints, or its wrist.")
        return sides[0]

    def give_named(self, name: str) -> None:
        """Give the selected hand one of HANDSHAPES in the chosen frames."""
        self.give(HandPose(name=name, angles=finger_angles(HANDSHAPES[name], "left")))

    def give_own(self, name: str) -> None:
        """Give it one of the user's own shapes."""
        if name not in (own := own_handshapes()):
            raise InputError(f"Your shape {name!r} is no longer there.")
        self.give(HandPose(name=name, angles=own[name]))

    def give_copied(self) -> None:
        """Give it the shape copied before."""
        if self.copied is None:
            raise InputError("Copy the shape of a hand first.")
        self.give(self.copied)

    def give_other(self) -> None:
        """Give it the shape that the other hand has in the frame on show, mirrored."""
        self.give(self._on_show(OTHER[self._of_body()]))

    def give_last(self) -> None:
        """Give it the shape given last."""
        if self.last is None:
            raise InputError("Give a hand a shape first, in the panel Keypoints.")
        self.give(self.last)

    def copy(self) -> None:
        """Copy the selected hand's shape in the frame on show."""
        self.copied = self._on_show(self._of_body())

    def save(self, name: str) -> None:
        """Keep the selected hand's shape in the frame on show as one of the user's own."""
        keep_handshape(name, self._on_show(self._of_body()).angles)

    def give(self, pose: HandPose) -> None:
        """Give the selected hand a shape in the chosen frames, with frames around them that lead to it and from it."""
        tab, shown, side = self._tab, self._shown(), self._of_body()
        chosen = tab.frames_to_change
        before, after = chosen[0] - self.blend - 1, chosen[-1] + self.blend + 1
        before, after = max(before, 0), min(after, tab.length - 1)
        leads = [(max(chosen[0] - before - 1, 0), before), (max(after - chosen[-1] - 1, 0), after)]
        leads = [(count if shown.has(frame) else 0, frame) for count, frame in leads]
        (count_in, _), (count_out, _) = leads
        edit = ShapeHand(
            frames=tuple(range(chosen[0] - count_in, chosen[-1] + count_out + 1)),
            joints=FINGER_JOINTS[side],
            name=pose.name,
            shape=_rounded(in_hand(pose.angles, side)),
            blend=(count_in, count_out),
            before=_rounded(self._angles(shown, side, before)) if count_in else None,
            after=_rounded(self._angles(shown, side, after)) if count_out else None,
        )
        self._correcting.make(edit)
        self.last = pose

    def free(self) -> None:
        """Remove the selected hand's shape in the selected frames, so that its keypoints count again."""
        tab, joints = self._tab, FINGER_JOINTS[self._of_body()]
        frames = tab.frames_to_change
        if not tab.session.project.corrected[np.ix_(frames, joints)].locked.any():
            where = in_words(frames, tab.first_frame)
            raise InputError(f"No hand shape is set in {where}.")
        self._correcting.make(ShapeHand(frames=frames, joints=joints, name="", shape=None))

    def _of_body(self) -> Side:
        """The body's hand that the selected keypoints are of in the fit on show, which swaps sides back."""
        side = self.side()
        if self._tab.state.mode == "space":
            return side
        wrist = (INDEX[f"{side}_wrist"],)
        return side if across_sides(self._tab, self._shown(), self._tab.state.frame, wrist) == wrist else OTHER[side]

    def _on_show(self, side: Side) -> HandPose:
        frame = self._tab.state.frame
        angles = in_hand(self._angles(self._shown(), side, frame), side)
        return HandPose(name=f"{side} hand of frame {frame + self._tab.first_frame}", angles=angles)

    def _shown(self) -> Shown:
        shown = self._tab.look().b
        if shown is None or not shown.has(self._tab.state.frame):
            raise InputError("Hand shapes are copied from the fit. There is no fit in this frame yet.")
        return shown

    def _angles(self, shown: Shown, side: Side, frame: int) -> Float[np.ndarray, "15 3"]:
        body = self._tab.session.bodies.of(shown.run.body)
        return full_pose(body, shown.params[[frame]])[0, POSE_JOINTS[f"{side}_hand_pose"]].numpy()


def _rounded(angles: Float[np.ndarray, "15 3"]) -> Shape:
    return tuple((x, y, z) for x, y, z in np.round(angles, 5).tolist())
