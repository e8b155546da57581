"""A body's motion as read from another program's file, and its conversion to a clip's space, hands and frames."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.model import N_EXPRESSION, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, FocalFrom
from fitting_core.errors import InputError
from fitting_core.motion import rest_joints
from fitting_core.shipped import FREE_FOLDER
from fitting_core.video.frame_names import among_images, frames_for_one

_NEAREST = 0.5
"""Metres: a body with a part nearer than this to the camera is not in front of it."""
_SAME_SHAPE = 0.01
"""Allowed relative difference of the aspect ratios of two images that show the same."""
_IN_VIEW = 1.2
"""For a body at an unknown place: metres above and below the pelvis that must be in view."""


@dataclass(frozen=True, kw_only=True)
class PersonTrack:
    """One of the people in a file."""

    number: int
    """As in the file."""
    numbers: tuple[int, ...]
    """Frames with this person, ascending."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImportedMotion:
    """T frames of a body, with what the file states about them."""

    source: Path
    format: str
    """Name of the format, in words."""
    kind: str
    """"smplx" or "smplh": the kind of its body."""
    gender: str
    """"neutral", "male", "female" or "child"."""
    body_hash: str = ""
    """SHA-256 of the body's file, if stated."""
    params: BodyParams
    """In the file's own space, but for `camera_translation`, which is added after `turn`."""
    points: Float[np.ndarray, "T 137 3"] | None = None
    """Keypoints of any body in camera space, metres, instead of a pose; NaN where missing, the same in all frames.
    `params` are zero until `starts.posing` has posed a body."""
    whole_hands: bool
    """Whether hands are axis-angle of 15 joints including the mean pose; otherwise they are relative to that mean."""
    turn: Float[Tensor, "T 3 3"]
    """Rotation of the file's space into camera space (x right, y down, z away)."""
    placed: bool = True
    """Whether a camera saw the motion; otherwise it is placed where the clip's camera sees it."""
    numbers: tuple[int, ...]
    """Of the frames, ascending."""
    numbered: bool
    """Whether the file states these numbers; otherwise they count from 0."""
    stems: tuple[str, ...] = ()
    """Of the frames' images, if the file names them."""
    frame_rate: float | None = None
    """Frames per second."""
    camera: Camera | None = None
    focal: tuple[float, str] | None = None
    """If no camera is stated: the focal length in pixels that the program assumes, and its description."""
    focal_rule: tuple[Callable[[tuple[int, int]], float], str] | None = None
    """Instead of `focal`, if the program computes it from the image's width and height."""
    people: tuple[PersonTrack, ...] = ()
    """In the file, if it distinguishes them; the person in most frames first."""
    notes: tuple[str, ...] = field(default=())
    """Notes for the user on how it was read."""

    def __post_init__(self) -> None:
        assert len(self.numbers) == len(self.params) == len(self.turn)

    def __len__(self) -> int:
        return len(self.params)

    def focal_for(self, size: tuple[int, int]) -> tuple[float, str] | None:
        """The focal length that the program assumes for images of this width and height, and its description."""
        return self.focal if self.focal_rule is None else (self.focal_rule[0](size), self.focal_rule[1])

    def camera_for(self, camera: Camera, focal_length: float | None = None) -> Camera:
        """The camera that the motion was found with, for a clip's images; it stands or moves as the clip's does. Raises
        InputError if the focal length is invalid, or the motion was found on images of another shape.

        Args:
            camera: The clip's, used if the file states none.
            focal_length: In pixels, if the file states no camera.
        """
        own = self._own_camera(camera, focal_length)
        return replace(own, lens=camera.lens, world=camera.world, path=camera.path)

    def _own_camera(self, camera: Camera, focal_length: float | None) -> Camera:
        if self.camera is not None:
            return self._resized(self.camera, camera.size)
        focal, origin = self.focal_for(camera.size), FocalFrom.PROGRAM
        if focal_length is not None:
            if not (np.isfinite(focal_length) and focal_length > 0):
                raise InputError(f"The focal length is {focal_length:g}; expected pixels, above 0.")
            focal, origin = (focal_length, "as given when it was imported"), FocalFrom.GIVEN
        if focal is None:
            return camera
        middle = (camera.size[0] / 2, camera.size[1] / 2)
        return Camera(focal=(focal[0], focal[0]), center=middle, size=camera.size, focal_from=origin, source=focal[1])

    def _resized(self, camera: Camera, size: tuple[int, int]) -> Camera:
        x, y = size[0] / camera.size[0], size[1] / camera.size[1]
        if abs(x / y - 1) > _SAME_SHAPE:
            raise InputError(
                f"{self.source}: was found on images of {camera.size[0]} x {camera.size[1]} pixels, and the clip has "
                f"{size[0]} x {size[1]}; expected the result of this clip."
            )
        return camera.resized(size)

    def for_body(self, body: BodyModel) -> "ImportedMotion":
        """Without the numbers that mean nothing for this body, with a note about it.

        Betas, expressions and hand components are numbers of one body model; joint angles are not.
        """
        assert self.points is None
        free = body.source is not None and FREE_FOLDER in body.source.parents
        if body.hash == self.body_hash or (not free and body.kind == self.kind and not self.body_hash):
            return self
        params, lost = self.params, "shape and expression"
        empty = {name: torch.zeros_like(getattr(params, name)) for name in ("betas", "expression")}
        if not self.whole_hands and params.left_hand_pose.shape[1] < 45:
            hands = ("left_hand_pose", "right_hand_pose")
            empty |= {name: torch.zeros_like(getattr(params, name)) for name in hands}
            lost = "shape, expression and hands (components)"
        whose = "tcfit's free body" if free else f"the {body.kind} body {body.source}"
        note = f"It is posed on {whose}, for which its {lost} mean nothing: these are left out, joint angles are kept."
        return replace(self, params=replace(params, **empty), notes=(*self.notes, note))

    def on(self, body: BodyModel, camera: Camera) -> BodyParams:
        """The parameters in camera space, for this body.

        The root turns about the pelvis, which lies off the body's origin: t' = t + R p - p with p the pelvis at rest.

        Args:
            body: Of the motion's kind; its mean hand is subtracted from whole hands.
            camera: Sees the motion; only used if not `placed`.
        """
        assert self.points is None
        params = self._as_body_params(body)
        if (self.turn != torch.eye(3, dtype=self.turn.dtype)).any():
            params = _turned(body, params, self.turn)
        return params if self.placed else _in_view(body, params, camera)

    def in_own_space(self, body: BodyModel) -> BodyParams:
        """The parameters in the file's own space, for this body."""
        params = self._as_body_params(body)
        return replace(params, camera_translation=(params.camera_translation[:, None] @ self.turn)[:, 0])

    def pelvis(self, body: BodyModel) -> Float[Tensor, "T 3"]:
        """The root joint at rest."""
        return rest_joints(body, self.params)[:, 0]

    def _as_body_params(self, body: BodyModel) -> BodyParams:
        """Hands and translation in the form of BodyParams."""
        params = self.params
        if not self.whole_hands:
            return params
        left, right = (torch.as_tensor(mean).to(params.body_pose) for mean in body.hand_mean)
        return replace(
            params, left_hand_pose=params.left_hand_pose - left, right_hand_pose=params.right_hand_pose - right
        )


def from_still(body: BodyModel, params: BodyParams, camera: Camera) -> BodyParams:
    """A body moving in still space (see `CameraPath`), in the camera space of each frame.

    Args:
        body: Whose root turns about its pelvis.
        params: T frames.
        camera: Of these frames.
    """
    if camera.path is None:
        return params
    off = params.camera_translation - torch.as_tensor(camera.path.places).to(params.camera_translation)
    turn = torch.as_tensor(camera.path.to_still).mT.to(off)
    there = replace(params, camera_translation=(turn @ off[..., None])[..., 0])
    return _turned(body, there, turn)


def _turned(body: BodyModel, params: BodyParams, turn: Float[Tensor, "T 3 3"]) -> BodyParams:
    pelvis = rest_joints(body, params)[:, 0]
    orient = rotations.log(turn @ rotations.exp(params.global_orient))
    moved = (turn @ pelvis[..., None])[..., 0] - pelvis
    return replace(params, global_orient=orient, camera_translation=params.camera_translation + moved)


def _in_view(body: BodyModel, params: BodyParams, camera: Camera) -> BodyParams:
    """The motion moved as a whole: its middle in front of the camera, far enough away to see a standing body."""
    at = rest_joints(body, params)[:, 0] + params.camera_translation
    reach = at.amax(0) - at.amin(0)
    half = (torch.as_tensor(camera.size, dtype=at.dtype) / 2 / torch.as_tensor(camera.focal, dtype=at.dtype)).tolist()
    depth = max((float(reach[0]) / 2 + _IN_VIEW) / half[0], (float(reach[1]) / 2 + _IN_VIEW) / half[1])
    middle = (at.amax(0) + at.amin(0)) / 2
    target = at.new_tensor([0.0, 0.0, depth + _NEAREST + float(reach[2]) / 2])
    return replace(params, camera_translation=params.camera_translation + target - middle)


@dataclass(frozen=True, kw_only=True, eq=False)
class CoveredFrames:
    """Which of a motion's frames match the frames of a clip."""

    places: Int[np.ndarray, "T"]
    """Of each frame of the clip, the motion's."""
    there: Bool[np.ndarray, "T"]
    """Whether the motion has exactly this frame; otherwise it is the nearest."""
    notes: tuple[str, ...]

    @property
    def missing(self) -> list[int]:
        """Indices of the clip's frames that the motion lacks."""
        return np.flatnonzero(~self.there).tolist()


def cover(
    motion: ImportedMotion,
    frames: int,
    *,
    clip_first: int,
    clip_rate: float,
    images: Sequence[str] = (),
    first_frame: int | None = None,
    partly: bool = False,
) -> CoveredFrames:
    """Find a motion's frame for each frame of a clip. Raises InputError if the motion has no frame of the clip, or
    fewer than it with nothing to say which; the message gives the frames found and expected.

    If the file names the clip's images, they decide. Otherwise a motion with as many frames as the clip matches them in
    order. Otherwise frame numbers decide: those in the images' names before indices, or `first_frame`; and time, if the
    file states another frame rate. Frames without a result take the nearest, and are not `there`.

    Args:
        motion: Any.
        frames: Of the clip.
        clip_first: Number of the clip's first frame in its video.
        clip_rate: Frames per second of the clip.
        images: Names without suffix of the images that the clip is part of, in order.
        first_frame: Number in the video of the motion's first frame.
        partly: Whether a part of the clip is enough, even if nothing says which part.
    """
    named = set(motion.stems) <= set(images) and bool(motion.stems) and first_frame is None
    whole = motion.numbers[-1] - motion.numbers[0] + 1 == len(motion)
    if first_frame is None and len(motion) == frames and whole and not named:
        return CoveredFrames(places=np.arange(frames), there=np.ones(frames, bool), notes=())
    ratio = 1.0 if named else frames_for_one(motion.frame_rate or clip_rate, clip_rate)
    numbers = (_places(motion, images) if first_frame is None else np.array(motion.numbers, float)) / ratio
    first, last = numbers[np.isfinite(numbers)][[0, -1]]
    start = float(first_frame) if first_frame is not None else first if motion.numbered else float(clip_first)
    numbers, last = numbers + (start - first), last + (start - first)
    wanted = clip_first + np.arange(frames)
    inside = (wanted >= start - 0.5) & (wanted <= last + 0.5)
    said = partly or named or motion.numbered or first_frame is not None
    if not (inside.any() if said else inside.all()):
        raise InputError(_not_covered(motion, frames, clip_first, clip_rate, int(start), last))
    numbers[np.isnan(numbers)] = np.inf
    places = np.abs(numbers[None] - wanted[:, None]).argmin(1)
    there = np.abs(numbers[places] - wanted) <= 0.5 + 1e-9
    notes = []
    if ratio != 1:
        notes.append(
            f"{motion.source.name} has {motion.frame_rate:g} frames per second and the clip {clip_rate:g}: each frame "
            "of the clip shows the nearest of its frames."
        )
    return CoveredFrames(places=places, there=there, notes=tuple(notes))


def _places(motion: ImportedMotion, images: Sequence[str]) -> Float[np.ndarray, "n"]:
    """Indices among the images of the motion's frames, by name or by the numbers in the names, NaN if there is no such
    image; otherwise its own numbers."""
    pairs = among_images(motion.stems, motion.numbers if motion.numbered else None, images) if motion.stems else None
    if pairs is None:
        return np.array(motion.numbers, float)
    return np.array([pairs[0].get(k, np.nan) for k in range(len(motion))])


def _not_covered(
    motion: ImportedMotion, frames: int, clip_first: int, clip_rate: float, start: int, last: float
) -> str:
    rate = f" at {motion.frame_rate:g} per second" if motion.frame_rate else ""
    said = motion.numbered or motion.stems
    return (
        f"{motion.source}: has {len(motion)} frames{rate}, for the video's frames {start} to {int(last)}; expected "
        f"{'some' if said else 'all'} of the clip's {frames} frames, {clip_first} to {clip_first + frames - 1} at "
        f"{clip_rate:g} per second. Give --first-frame, the video frame of its first one"
        f"{'' if said else ' (it may cover part of the clip)'}, or import the result of this clip."
    )


def body_params(arrays: dict[str, np.ndarray], hands: int) -> BodyParams:
    """BodyParams from arrays under its names; missing ones (expression, eyes, jaw) are zero."""
    frames = len(next(iter(arrays.values())))
    neutral = vars(BodyParams.neutral(frames, hand_components=hands))
    assert arrays.keys() <= neutral.keys() and neutral["expression"].shape[1] == N_EXPRESSION
    found = {name: torch.as_tensor(np.array(array, dtype=np.float64)) for name, array in arrays.items()}
    assert all(found[name].shape == neutral[name].shape for name in found)
    return BodyParams(**{**neutral, **found})
