"""Another system's result as the start of a fit: its person, frames, camera and body converted to ours."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.geometry import shortest_rotation
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import body_keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath
from fitting_core.fit.evidence.given_start import (
    FOLLOWS,
    Placed,
    from_pelvis,
    given_start,
    place_by_keypoints,
    steadied,
    with_whole_hands,
)
from fitting_core.image_border import seen_confidence
from fitting_core.io import read_motion
from fitting_core.io.motion.imported_motion import CoveredFrames, ImportedMotion, cover, from_still
from fitting_core.keypoints import SEEN
from fitting_core.metrics import heights_in_image
from fitting_core.motion import rest_joints
from fitting_core.results.given_start import GivenStart, StartRecord
from fitting_core.starts.posing import posed_on
from fitting_core.video.images import image_files

if TYPE_CHECKING:
    from fitting_core.io.motion.smplifyx import Decode

_CANDIDATES = 12
"""Maximum number of people of a file compared with the keypoints: those in most frames."""
_NEAREST = 0.1
"""Minimum distance in metres from the camera of a visible point."""
_TURNS = np.arange(0.0, 360.0, 15.0)
"""Degrees about the camera's vertical that are tried for a motion without a camera."""
FindBody = Callable[[str, str], BodyModel | None]
"""From a kind and a gender to a body model, if available."""


def read_start(
    path: StrPath,
    clip: Clip,
    body: BodyModel,
    *,
    person: int | None = None,
    first_frame: int | None = None,
    find_body: FindBody = lambda kind, gender: None,
    decode: "Decode | None" = None,
) -> GivenStart:
    """Read a result to start phase 1 with.

    Joint angles are kept. Depth goes with the focal length, and a body turns as its line of sight does; then it is
    placed where the keypoints are. Where its body is another one than the fitted one, keypoints lie where the result's
    own body has them, if that is here. A motion without a camera is turned about the vertical, as a whole, until it
    looks like the keypoints.

    Args:
        path: What `read_motion` reads.
        clip: What is fitted.
        body: The fitted body.
        person: Of several people in the result, the number; None: the one who follows the keypoints. Of SMPLify-X the
            number of the pickle, by default 0: its numbers are not tracks.
        first_frame: Number in the video of the result's first frame; None: as it says, or the clip's first.
        find_body: Where the result's own body comes from.
        decode: For SMPLify-X results, see `read_motion`.

    Raises:
        InputError: It cannot be read, has nothing for this clip, or no person in it matches the keypoints.
    """
    path = Path(path)
    motion = _posed(read_motion(path, person=person, decode=decode), body)
    numbers = [one.number for one in motion.people[:_CANDIDATES]] if person is None else []
    if len(numbers) < 2:
        return _Candidate.of(motion, clip, body, first_frame).start(clip, body, person, find_body)
    found: dict[int, _Candidate] = {}
    refused: list[InputError] = []
    for number in numbers:
        try:
            motion = _posed(read_motion(path, person=number, decode=decode), body)
            found[number] = _Candidate.of(motion, clip, body, first_frame)
        except InputError as error:  # A person in another part of the video.
            refused.append(error)
    if not found:
        raise refused[0]
    chosen = max(found, key=lambda number: found[number].follows(clip, body))
    return found[chosen].start(clip, body, chosen, find_body)


def start_from_fit(
    params: BodyParams,
    own: BodyModel,
    camera: Camera,
    clip: Clip,
    body: BodyModel,
    *,
    name: str,
    format: str,
    there: Bool[np.ndarray, "T"] | None = None,
    placed: bool = True,
) -> GivenStart:
    """A fit of this clip, or a motion that was brought into it, as a start. Raises InputError if it has no frame, or
    does not follow the keypoints.

    Args:
        params: All frames of the clip, in the space of `camera`.
        own: Their body.
        camera: That they were found with.
        clip: What is fitted.
        body: The fitted body.
        name: The user's name for it.
        format: What it is, in words.
        there: Frames that it covers; None: all.
        placed: Whether a camera saw it; else it may be turned about the vertical.
    """
    frames = np.arange(len(clip)) if there is None else np.flatnonzero(there)
    if not len(frames):
        raise InputError(f"{name}: has no frame of this clip. Choose another start.")
    whole = with_whole_hands(own, params.to(dtype=torch.float64))[torch.as_tensor(frames)]
    left, right = (torch.as_tensor(mean).to(whole.body_pose) for mean in own.hand_mean)
    motion = ImportedMotion(
        source=Path(name.replace("/", " ")),
        format=format,
        kind=own.kind,
        gender=own.gender,
        body_hash=own.hash,
        params=replace(
            whole, left_hand_pose=whole.left_hand_pose + left, right_hand_pose=whole.right_hand_pose + right
        ),
        whole_hands=True,
        turn=torch.eye(3, dtype=torch.float64).expand(len(frames), 3, 3),
        placed=placed,
        numbers=tuple((clip.first_frame + frames).tolist()),
        numbered=True,
        camera=replace(camera, path=None),  # they are in camera space already
    )
    # The clip's images are not asked for: frames are counted as the clip counts them.
    counted = replace(clip, source=None)
    return _Candidate.of(motion, counted, body, None).start(counted, body, None, lambda kind, gender: own)


def _posed(motion: ImportedMotion, body: BodyModel) -> ImportedMotion:
    """With a pose of the fitted body if it has only keypoints."""
    return motion if motion.points is None else posed_on(motion, body)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Candidate:
    """One of the people in a result, with a pose for each frame of the clip."""

    motion: ImportedMotion
    posed: ImportedMotion
    """Without the numbers that mean nothing for the fitted body."""
    covered: CoveredFrames
    camera: Camera
    """The motion's own."""
    params: BodyParams
    """Of the fitted body, before that camera."""

    @staticmethod
    def of(motion: ImportedMotion, clip: Clip, body: BodyModel, first_frame: int | None) -> "_Candidate":
        """Raises InputError if the motion has no frame of the clip."""
        covered = cover(
            motion,
            len(clip),
            clip_first=clip.first_frame,
            clip_rate=clip.frame_rate,
            images=[image.stem for image in image_files(clip.source)],
            first_frame=first_frame,
            partly=True,
        )
        posed, camera = motion.for_body(body), motion.camera_for(clip.camera)
        params = posed.on(body, camera)[torch.as_tensor(covered.places)]
        if not motion.placed:
            params = from_still(body, params, camera)
        return _Candidate(motion=motion, posed=posed, covered=covered, camera=camera, params=params)

    def follows(self, clip: Clip, body: BodyModel) -> float:
        """How well its keypoints match the detected ones: 0 (nowhere) to 1 (exactly, in every frame)."""
        seen = seen_confidence(clip.keypoints, clip.camera)[:, kp.BODY] > SEEN
        points = body_keypoints_in_space(body, self.params)
        before = points[..., 2] > _NEAREST
        with np.errstate(invalid="ignore", divide="ignore"):
            pixels = points[..., :2] / points[..., 2:] * self.camera.focal + self.camera.center
        xy = clip.keypoints.xy[:, kp.BODY]
        height = heights_in_image(xy, seen)[:, None]
        off = np.where(before, np.linalg.norm(pixels - xy, axis=-1) / height, 1.0)
        counted = seen & np.isfinite(off)
        nearness = np.where(counted, 1 - np.minimum(off, 1.0), 0.0).sum(1) / counted.sum(1).clip(1)
        return float(np.where(self.covered.there, nearness, 0.0)[seen.any(1)].mean()) if seen.any() else 0.0

    def start(self, clip: Clip, body: BodyModel, person: int | None, find_body: FindBody) -> GivenStart:
        """The start, placed before the clip's camera."""
        motion, own = self.motion, self._own_points(body, find_body)
        params, points = _seen_by(body, self.params, self.camera, clip.camera), own
        if not motion.placed:
            params = _turned_to_follow(body, params, clip)
        if points is not None:
            points = _turned_as(points, self.params, params)
        found = given_start(
            params, self.covered.there, clip.keypoints, clip.camera, body,
            points=points,
            about=StartRecord(
                source=motion.source.name,
                format=motion.format,
                person=person,
                frames=0,
                clip_frames=len(clip),
                focal=self.camera.focal,
                focal_source=self.camera.source if motion.placed else "the clip's: the motion has no camera",
                off=float("nan"),
                notes=(*self.posed.notes, *self.covered.notes),
            ),
        )  # fmt: skip
        if not found.there.any():
            far = place_by_keypoints(found.points, clip.keypoints, clip.camera).median_off[self.covered.there]
            raise InputError(_follows_nobody(motion, far, person))
        return steadied(found, clip.frame_rate)

    def _own_points(self, body: BodyModel, find_body: FindBody) -> Float[np.ndarray, "T 25 3"] | None:
        """Keypoints from the pelvis on the motion's own body; None where that is the fitted one, or is not here."""
        own = None if self.motion.kind == body.kind else find_body(self.motion.kind, self.motion.gender)
        if own is None:
            return None
        params = self.motion.for_body(own).on(own, self.camera)[torch.as_tensor(self.covered.places)]
        return from_pelvis(own, params)


def _seen_by(body: BodyModel, params: BodyParams, theirs: Camera, ours: Camera) -> BodyParams:
    """The motion as it looks the same to another camera: the depth goes with the focal length, and the body turns with
    its line of sight."""
    rest = rest_joints(body, params)[:, 0].numpy()
    pelvis = rest + params.camera_translation.double().numpy()
    pixels = pelvis[:, :2] / pelvis[:, 2:] * theirs.focal + theirs.center
    depth = pelvis[:, 2:] * np.mean(ours.focal) / np.mean(theirs.focal)
    moved = np.concatenate([(pixels - ours.center) / ours.focal * depth, depth], 1)
    turn = torch.as_tensor(shortest_rotation(pelvis, moved))
    orient = rotations.log(turn @ rotations.exp(params.global_orient.double()))
    return replace(params, global_orient=orient, camera_translation=torch.as_tensor(moved - rest))


def _turned_as(points: Float[np.ndarray, "T 25 3"], before: BodyParams, after: BodyParams) -> np.ndarray:
    """Points about the pelvis, rotated with the root."""
    turn = rotations.exp(after.global_orient.double()) @ rotations.exp(before.global_orient.double()).transpose(1, 2)
    return np.einsum("tij,tkj->tki", turn.numpy(), points)


def _turned_to_follow(body: BodyModel, params: BodyParams, clip: Clip) -> BodyParams:
    """A motion that no camera saw, turned as a whole about the vertical until it looks most like the keypoints."""
    points, like = from_pelvis(body, params), params.global_orient.double()
    turns = [_about_one_axis(rotations.yaw(float(degrees), like), clip.camera) for degrees in _TURNS]
    found = [place_by_keypoints(points @ turn.mT.numpy(), clip.keypoints, clip.camera) for turn in turns]
    best = turns[int(np.argmin([_total_off(one) for one in found]))]
    return replace(params, global_orient=rotations.log(best @ rotations.exp(like)))


def _about_one_axis(turn: Float[Tensor, "3 3"], camera: Camera) -> Float[Tensor, "*T 3 3"]:
    """A rotation of still space (see `CameraPath`) in the camera space of each frame."""
    if camera.path is None:
        return turn
    to_still = torch.as_tensor(camera.path.to_still).to(turn)
    return to_still.mT @ turn @ to_still


def _total_off(found: Placed) -> float:
    return float(np.minimum(found.median_off, 1.0).sum())


def _follows_nobody(motion: ImportedMotion, off: Float[np.ndarray, "n"], person: int | None) -> str:
    seen = off[np.isfinite(off)]
    which = "" if person is None else f" of person {person}"
    how = f"lie {100 * np.median(seen):.0f} cm off the detected ones (median)" if len(seen) else "cannot be compared"
    unsaid = motion.source.suffix == ".npz" and not motion.placed
    axes = " It is taken to have z up; the key axes = 'camera' says that an npz is in camera space." * unsaid
    return (
        f"{motion.source}: the keypoints{which} {how}; expected the result of this clip and of this person, less than "
        f"{100 * FOLLOWS:.0f} cm off. Choose another of its people, or say which frame of the video its first one "
        f"is.{axes}"
    )
