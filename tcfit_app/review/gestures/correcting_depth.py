"""Correcting depth in one tab: limbs flipped in depth, keypoints pinned, joints locked, and offsets kept from these.

Depths are metres behind the pelvis along the camera's z, as everywhere in edits.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.body.geometry import unit
from fitting_core.body.model import JOINT
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.fit.evidence.sides import unswapped_keypoint
from fitting_core.keypoints import BODY, INDEX, LOCKABLE, KeptOffset, Keypoints
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.space_edits import ClearDepth, Keep, Lock, Pin, Release, Unlock
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.correcting import Correcting, across_sides, swapped_sides
from tcfit_app.review.gestures.keyframing import depth_edit
from tcfit_app.review.tab.tab import Tab

Way = Literal["mirror", "front", "behind"]
"""Mirrored, or on the side nearer to or farther from the camera."""
LimbPoints = tuple[int, int, int]
"""Keypoints of an arm or a leg: its root (shoulder or hip), its elbow or knee, its wrist or ankle."""

_PARTS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}
_LIMBS: tuple[LimbPoints, ...] = tuple(
    (INDEX[f"{side}_{root}"], INDEX[f"{side}_{middle}"], INDEX[f"{side}_{end}"])
    for side in ("left", "right")
    for root, middle, end in _PARTS.values()
)
_ROOT = {middle: root for root, middle, _ in _LIMBS}
_FEET = {
    INDEX[f"{side}_{part}"]: INDEX[f"{side}_ankle"]
    for side in ("left", "right")
    for part in ("big_toe", "small_toe", "heel")
}
_OF_HEAD = tuple(INDEX[name] for name in ("nose", "right_eye", "left_eye", "right_ear", "left_ear"))
_BEYOND: dict[int, tuple[int, ...]] = {INDEX["neck"]: _OF_HEAD, INDEX["nose"]: _OF_HEAD}
"""The keypoints that a joint moves, by the keypoint by which it is locked."""
for _root, _middle, _end in _LIMBS:
    _BEYOND[_end] = tuple(point for point, ankle in _FEET.items() if ankle == _end)
    _BEYOND[_middle] = (_end, *_BEYOND[_end])
    _BEYOND[_root] = (_middle, *_BEYOND[_middle])
_IN_PLANE = 0.05
"""Metres of depth from its root below which a keypoint is on neither side of it: there the fit does not determine the
limb's depth, only its length in the image does."""


class CorrectingDepth:
    """The depth corrections of one tab. Methods raise InputError for what cannot be done, and then change nothing."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting

    def send(self, way: Way) -> None:
        """Put the limbs of the selected keypoints on one side of their shoulders or hips in depth."""
        frames, limbs = self._tab.frames_to_change, limbs_of(self._as_detected(self._correcting.selected()))
        seen = self._seen_body(frames)
        depths = np.concatenate([seen.sent(limb, way) for limb in limbs], 1)
        self._set_depth(frames, tuple(joint for limb in limbs for joint in limb[1:]), depths)

    def _set_depth(self, frames: tuple[int, ...], joints: tuple[int, ...], depths: Float[np.ndarray, "F n"]) -> None:
        self._correcting.refuse_bad(frames, joints)
        self._correcting.make(depth_edit(frames, joints, depths))

    def lock(self) -> None:
        """Lock the joints of the selected keypoints at their rotation in the fit on show, in the chosen frames."""
        self._lock(self._tab.frames_to_change)

    def lock_throughout(self) -> None:
        """Lock them in all frames, as a stiff joint is; or unlock them again."""
        every = tuple(range(self._tab.length))
        if self.locked_throughout:
            self._correcting.make(Unlock(frames=every, joints=self._of_body(self.lockable())))
        else:
            self._lock(every)

    @property
    def locked_throughout(self) -> bool:
        """Whether all selected joints that can be locked are, in all frames."""
        joints, project = self._of_body(self.lockable()), self._tab.session.project
        key = joints, project.keypoints_version
        return self._tab.once("locked", key, lambda: bool(project.corrected[:, list(joints)].locked.all()))

    def _lock(self, frames: tuple[int, ...]) -> None:
        tab, joints, shown = self._tab, self.lockable(), self._tab.look().b
        now = tab.state.frame
        if shown is None or not shown.has(now):
            raise InputError("The rotation is copied from the fit, and this frame has none yet: fit first.")
        of_body = self._of_body(joints)
        pose = shown.params.body_pose[now].view(-1, 3)
        turns = (pose[JOINT[LOCKABLE[joint]] - JOINT["left_hip"]].tolist() for joint in of_body)
        rounded = tuple((round(x, 5), round(y, 5), round(z, 5)) for x, y, z in turns)
        self._correcting.make(Lock(frames=frames, joints=of_body, turn=rounded))

    def _of_body(self, joints: tuple[int, ...]) -> tuple[int, ...]:
        """The body's keypoints that are seen at the selected ones. In 3D keypoints are those of the fit."""
        return joints if self._tab.state.mode == "space" else self._across(joints)

    def _as_detected(self, joints: tuple[int, ...]) -> tuple[int, ...]:
        """The detected keypoints for the selected ones, which edits are about."""
        return self._across(joints) if self._tab.state.mode == "space" else joints

    def _across(self, joints: tuple[int, ...]) -> tuple[int, ...]:
        shown = self._tab.look().b
        return joints if shown is None else across_sides(self._tab, shown, self._tab.state.frame, joints)

    def unlock(self) -> None:
        """Unlock the joints of the selected keypoints."""
        frames, joints = self._tab.frames_to_change, self._of_body(self.lockable())
        if not self._tab.session.project.corrected[np.ix_(frames, joints)].locked.any():
            raise InputError(f"None of the selected joints is locked in {in_words(frames, self._tab.first_frame)}.")
        self._correcting.make(Unlock(frames=frames, joints=joints))

    def lockable(self) -> tuple[int, ...]:
        """The selected joints that can be locked. Raises InputError without any."""
        found = tuple(joint for joint in self._correcting.selected() if joint in LOCKABLE)
        if not found:
            raise InputError("Neck, head (the nose), and joints of arms and legs can be locked: select one of them.")
        return found

    def _seen_body(self, frames: tuple[int, ...]) -> "SeenBody":
        tab = self._tab
        shown, project = tab.look().b, tab.session.project
        if shown is None or not all(map(shown.has, frames)):
            raise InputError("Depth is measured in the fit, and this frame has none yet: fit first.")
        keypoints, params = project.clip.keypoints, shown.params[list(frames)]
        body = tab.session.bodies.of(shown.run.body)
        return SeenBody(
            points=keypoints_in_space(body, params)[0],
            pelvis=joints_in_space(body, params)[:, JOINT["pelvis"], 2],
            keypoints=keypoints[np.array(frames)],
            camera=shown.camera,
            swapped=swapped_sides(project, shown, frames),
        )

    def clear_depth(self) -> None:
        """Clear the depths set for the selected limbs."""
        frames, joints = self._tab.frames_to_change, self._limb_ends()
        if not np.isfinite(self._tab.session.project.corrected.depth[np.ix_(frames, joints)]).any():
            where = in_words(frames, self._tab.first_frame)
            raise InputError(f"No depth is set for the selected limbs in {where}.")
        self._correcting.make(ClearDepth(frames=frames, joints=joints))

    def _limb_ends(self) -> tuple[int, ...]:
        """Elbows and wrists, knees and ankles of the selected limbs."""
        limbs = limbs_of(self._as_detected(self._correcting.selected()))
        return tuple(joint for limb in limbs for joint in limb[1:])

    def pin(self) -> None:
        """Pin the selected keypoints to their current position in the fit, in all selected frames."""
        tab, joints = self._tab, self._correcting.selected()
        frames, now = tab.frames_to_change, tab.state.frame
        if tab.session.project.footage.camera.path is not None:
            raise InputError(
                "The camera of this clip moves, and pinned keypoints stay in one place of the picture. Move them "
                "in single frames instead; the fit itself keeps standing feet in place in the world."
            )
        if tab.state.frames is None:
            raise InputError("First select the frames in which to pin them: [ and ].")
        if beyond := [joint for joint in joints if joint >= BODY.stop]:
            raise InputError(
                f"{len(beyond)} of the selected keypoints are not body keypoints, and only those have a depth."
            )
        seen = self._seen_body(frames)
        points = seen.points[frames.index(now), list(self._of_body(joints))]
        if not np.isfinite(points).all():
            raise InputError("The body model of this fit lacks some of the selected keypoints: select others.")
        xy = points[:, :2] / points[:, 2:] * seen.camera.focal + seen.camera.center
        depths = np.round(points[:, 2] - seen.pelvis[:, None], 4)
        places = tuple((round(float(u), 3), round(float(v), 3)) for u, v in xy)
        detected = self._as_detected(joints)
        self._correcting.make(Pin(frames=frames, joints=detected, xy=places, depth=tuple(map(tuple, depths.tolist()))))

    # --- offsets, which last ---

    @property
    def can_keep(self) -> bool:
        """Whether a depth, a keyframe, a pin or a lock of the selected keypoints can be kept."""
        tab, project, state = self._tab, self._tab.session.project, self._tab.state

        def found() -> bool:
            corrected, joints = project.corrected, [joint for joint in state.selection if joint < BODY.stop]
            if state.frames is not None:
                corrected = corrected[list(tab.chosen_frames)]
            corrected = corrected[:, joints]
            stated = np.isfinite(corrected.told_depth) | _moved_by_key(corrected)
            turning = [bool(_BEYOND.get(joint)) for joint in joints]
            return bool(stated.any() or (corrected.locked & turning).any())

        return tab.once("can keep", (state.selection, state.frames, project.keypoints_version), found)

    @property
    def _lasting(self) -> tuple[int, ...]:
        """The frames in which an offset will hold: the selected ones, or all."""
        return tuple(range(self._tab.length)) if self._tab.state.frames is None else self._tab.frames_to_change

    def keep(self) -> None:
        """Keep depths and keyframes of the selected keypoints as offsets; without any, depths that their locks made."""
        frames, selected = self._lasting, self._of_body(self._correcting.selected())
        joints = tuple(joint for joint in selected if joint < BODY.stop)
        stated = self._stated(frames, joints)
        if not stated:
            joints, stated = self._locked_depths(frames, joints)
        known = [c for c in range(len(joints)) if any(row[c] != _UNSTATED for row in stated.values())]
        depth = tuple(tuple(row[column][0] for column in known) for row in stated.values())
        shift = tuple(tuple(row[column][1] for column in known) for row in stated.values())
        named = tuple(joints[column] for column in known)
        self._correcting.make(Keep(frames=frames, joints=named, at=tuple(stated), depth=depth, shift=shift))

    def _stated(self, frames: tuple[int, ...], joints: tuple[int, ...]) -> "dict[int, tuple[_Stated, ...]]":
        """What a person stated of the body's keypoints, by frame."""
        project, shown = self._tab.session.project, self._tab.look().b
        corrected = project.corrected[list(frames)]
        depth, moved = corrected.told_depth, _moved_by_key(corrected)
        rows = np.flatnonzero((np.isfinite(depth) | moved).any(1))
        among = tuple(frames[row] for row in rows)
        swapped = [()] * len(among) if shown is None else swapped_sides(project, shown, among)
        found: dict[int, tuple[_Stated, ...]] = {}
        for row, frame, pairs in zip(rows, among, swapped, strict=True):
            columns = [unswapped_keypoint(joint, pairs) for joint in joints]
            shift = corrected.shift[row, columns].round(2)
            values = tuple(map(_as_stated, depth[row, columns], np.where(moved[row, columns, None], shift, np.nan)))
            if any(value != _UNSTATED for value in values):
                found[frame] = values
        return found

    def _locked_depths(
        self, frames: tuple[int, ...], joints: tuple[int, ...]
    ) -> "tuple[tuple[int, ...], dict[int, tuple[_Stated, ...]]]":
        """The body's keypoints that the joints locked at these move, and their depths in the fit, by frame."""
        locked = self._tab.session.project.corrected.locked[np.ix_(frames, joints)]
        moving = (joints[column] for column in np.flatnonzero(locked.any(0)))
        beyond = tuple(dict.fromkeys(point for joint in moving for point in _BEYOND.get(joint, ())))
        if not beyond:
            raise InputError(
                "There is nothing to keep: first set a depth of the selected keypoints, move or pin them, or lock a "
                "joint of neck, arm or leg in one frame or several."
            )
        if self._tab.session.edit_follower.lags:
            raise InputError("The fit is still following: try again when it has.")
        at = tuple(frames[row] for row in np.flatnonzero(locked.any(1)))
        seen = self._seen_body(at)
        depths = np.round(seen.points[:, list(beyond), 2] - seen.pelvis[:, None], 4)
        return beyond, {frame: tuple(map(_as_stated, row)) for frame, row in zip(at, depths, strict=True)}

    def kept(self) -> tuple[KeptOffset, ...]:
        """The offsets of the selected keypoints in the frame on show, or in any selected one."""
        tab, every = self._tab, self._tab.session.project.kept
        shown = tab.shown.b
        if not every or shown is None:
            return ()

        def found() -> tuple[KeptOffset, ...]:
            joints, frames = {*self._of_body(tab.state.selection)}, {*tab.chosen_frames}
            return tuple(one for one in every if one.keypoint in joints and not frames.isdisjoint(one.frames))

        state = tab.state
        key = state.selection, tab.chosen_frames, state.mode, shown.run.id, tab.session.project.keypoints_version
        return tab.once("kept", key, found)

    def release(self) -> None:
        """Remove the offsets of the selected keypoints."""
        kept = self.kept()
        if not kept:
            raise InputError("No offset of the selected keypoints is kept here.")
        frames = sorted({frame for one in kept for frame in one.frames})
        self._correcting.make(Release(frames=tuple(frames), joints=tuple({one.keypoint: None for one in kept})))


_Stated = tuple[float | None, tuple[float, float] | None]
"""Depth and shift of a keypoint in one frame, as in `Keep`."""
_UNSTATED: _Stated = (None, None)


def _as_stated(depth: float, shift: Sequence[float] = (np.nan, np.nan)) -> _Stated:
    x, y = map(float, shift)
    return (float(depth) if np.isfinite(depth) else None, (x, y) if np.isfinite(x) else None)


def _moved_by_key(corrected: Corrected) -> Bool[np.ndarray, "F K"]:
    """Keypoints with a keyframe that is not where they were detected."""
    return corrected.key & corrected.present & corrected.shift.any(-1)


# --- limbs flipped in depth about their roots, with the same image: the values of `SetDepth` ---


def limbs_of(joints: Collection[int]) -> tuple[LimbPoints, ...]:
    """The arms and legs with any keypoint but the root among these. Raises InputError without any."""
    chosen = {_FEET.get(joint, joint) for joint in joints}
    found = tuple(limb for limb in _LIMBS if chosen & set(limb[1:]))
    if not found:
        raise InputError("Depth is set for arms and legs: select an elbow, a wrist, a knee, an ankle or a foot first.")
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenBody:
    """A fitted body in some frames, with the keypoints it was fitted to."""

    points: Float[np.ndarray, "F 137 3"]
    """The body's keypoints in camera space, metres."""
    pelvis: Float[np.ndarray, "F"]
    """z of the pelvis in camera space, metres."""
    keypoints: Keypoints
    """As corrected, in the same frames."""
    camera: Camera
    swapped: Sequence[Collection[str]]
    """For each frame the pairs of limbs whose sides the fit unswapped (names of `sides.PAIRED`)."""

    def sent(self, limb: LimbPoints, way: Way) -> Float[np.ndarray, "F 2"]:
        """Depths of elbow and wrist, or of knee and ankle, that keep the length of each bone and the pixels.

        Each bone then has two solutions, nearer or farther. "mirror" takes the other one of both; the other ways take,
        among the poses on the requested side, the one closest to the current distances of elbow and wrist from the
        root; keypoints still on the wrong side are put at the root's depth.
        """
        ends = [[unswapped_keypoint(joint, pairs) for joint in limb[1:]] for pairs in self.swapped]
        roots = np.array([[_ROOT[middle]] for middle, _ in ends])
        every = np.arange(len(ends))[:, None]
        points = self.points[every, np.hstack([roots, ends])]
        off = points[:, 1:, 2] - points[:, :1, 2]
        flat = (abs(off) < _IN_PLANE) & (self.keypoints.confidence[every, limb[1:]] > 0) & (way != "mirror")
        rays = unit(np.where(flat[..., None], self._rays(limb), points[:, 1:]))
        poses, was = _poses(points, rays)
        if way == "mirror":
            return poses[np.arange(len(poses)), 3 - was] - self.pelvis[:, None]
        side = 1 if way == "behind" else -1
        reached = side * (poses - points[:, None, :1, 2])
        longest = np.linalg.norm(np.diff(points, axis=1), axis=-1).cumsum(1)
        missed = abs(reached - np.where(abs(off) < _IN_PLANE, longest, abs(off))[:, None]).sum(2)
        wrong = (reached < -_IN_PLANE).sum(2)
        chosen = np.where(wrong == wrong.min(1, keepdims=True), missed, np.inf).argmin(1)
        # Away from the image's middle both ends of a bone across the view can be nearer than its start.
        found = np.maximum(reached[np.arange(len(poses)), chosen], 0)
        return points[:, :1, 2] + side * found - self.pelvis[:, None]

    def _rays(self, limb: LimbPoints) -> Float[np.ndarray, "F 2 3"]:
        """Viewing rays through the keypoints of elbow and wrist, at z = 1."""
        xy = (self.keypoints.xy[:, limb[1:]] - self.camera.center) / self.camera.focal
        return np.concatenate([xy, np.ones((*xy.shape[:2], 1))], 2)


def _poses(
    points: Float[np.ndarray, "F 3 3"], rays: Float[np.ndarray, "F 2 3"]
) -> tuple[Float[np.ndarray, "F 4 2"], Int[np.ndarray, "F"]]:
    """z of elbow and wrist in the four poses of a limb on two rays, and which of them is the current one.

    The poses by number: 0 both bones nearer, 1 the upper one nearer, 2 the lower one nearer, 3 both farther.
    """
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    poses = []
    for middle in _ends(points[:, 0], lengths[:, 0], rays[:, 0]):
        poses += [np.stack([middle[:, 2], end[:, 2]], 1) for end in _ends(middle, lengths[:, 1], rays[:, 1])]
    farther = (np.diff(points, axis=1) * rays).sum(2) > 0
    return np.stack(poses, 1), farther @ [2, 1]


def _ends(
    start: Float[np.ndarray, "F 3"], length: Float[np.ndarray, "F"], ray: Float[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]:
    """Where bones of given lengths can end on unit rays, nearer and farther; the closest point if out of reach."""
    along = (start * ray).sum(1)
    half = np.sqrt(np.maximum(length**2 - (start**2).sum(1) + along**2, 0))
    return (along - half)[:, None] * ray, (along + half)[:, None] * ray
