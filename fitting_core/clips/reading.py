"""Read a clip: frames, keypoints and camera combined into the fit's input."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting_core.camera import Camera, FocalFrom, PathScale, focal_from_35mm
from fitting_core.clip import Clip
from fitting_core.clips.camera import CameraGiven
from fitting_core.clips.footage import Footage, check_memory, guessed_size, locate
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.detect.detecting import Detected
from fitting_core.detect.found import Tell, find_keypoints, found_by, found_detections, silhouettes_of
from fitting_core.detect.part import Detector
from fitting_core.detections import Detections, to_pixels
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath
from fitting_core.frame_alignment import Timeline, align, chosen, timeline_of_keypoints
from fitting_core.io import read_detections
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lens import straightened_keypoints
from fitting_core.people.person import choose_person
from fitting_core.video.decoding import told_35mm
from fitting_core.video.images import IMAGE_SUFFIXES, focal_35mm, image_files
from fitting_core.video.sampled import SampledPictures


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A clip before its person is chosen."""

    detections: Detections
    """Of the used frames, in pixels."""
    size: tuple[int, int]
    frames: ClipFrames
    images: Path | None
    name: str
    given: CameraGiven
    notes: tuple[str, ...]
    """About the frames, how keypoints were matched to them, size and rate."""
    found: Detected | None = None
    """A detector's result for it, if no keypoints were given."""
    pictures: SampledPictures | None = None
    """Those that were taken during detection."""

    @property
    def first_frame(self) -> int:
        """Its number."""
        return self.frames.numbers[0]

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return self.frames.frame_rate

    def camera(self, keypoints: Keypoints) -> Camera:
        """The camera, with focal length, vertical and scale estimated if not known otherwise."""
        from fitting_core.ground.from_pictures import camera_from_pictures  # loads torch

        seen = self.given.camera(self.size, self.frames, partial(_path_scale, keypoints, self.frame_rate))
        known = told_by_files(seen, self.images) if self.given.automatic else seen
        straight, _ = straightened_keypoints(keypoints, seen.lens)
        pictures = self.pictures or (self.images and SampledPictures(self.images, self.frames.numbers, seen))
        return camera_from_pictures(known or seen, straight, self.frame_rate, pictures, estimate=known is None)

    def clip(
        self, keypoints: Keypoints, camera: Camera, *, entries: Sequence[int | None], notes: tuple[str, ...]
    ) -> Clip:
        """One person's.

        Args:
            keypoints: Of all frames, as detected.
            camera: Of them.
            entries: Per frame, the person's index in the list of people.
            notes: On the choice of person, and on the keypoints' positions.
        """
        straight, of_lens = straightened_keypoints(keypoints, camera.lens)
        return Clip(
            keypoints=straight,
            camera=camera,
            frame_rate=self.frame_rate,
            name=self.name,
            source=self.images,
            first_frame=self.first_frame,
            detector=self.detections.detector,
            notes=(*self.notes, *notes, *camera.notes, *of_lens),
            silhouettes=None if self.found is None else silhouettes_of(self.found, entries),
            found_by="" if self.found is None else found_by(self.found),
        )


def read_shot(
    video: StrPath | None,
    keypoints: StrPath | None,
    clip: ClipOptions,
    camera: CameraOptions,
    *,
    detector: Detector | None,
    tell: Tell | None,
) -> Shot:
    """A clip except for the choice of person; arguments and errors as in `read_clip`."""
    given = CameraGiven.of(camera)
    video = None if video is None else Path(video)
    images, keypoint_path = locate(video, None if keypoints is None else Path(keypoints))
    if keypoint_path is None:
        assert video is not None and images is not None
        return _searched(_empty_shot(video, images, clip, given), images, detector or clip.detector, tell)
    detections = read_detections(keypoint_path)
    footage = Footage.of(images)
    size = footage.known_size(clip.image_size) or detections.size
    detections, size, size_notes = _in_pixels(_with_contradictions(detections, footage), size, clip.keypoint_scale)
    timeline = footage.timeline or timeline_of_keypoints(detections)
    part = chosen(timeline, clip.first_frame, clip.last_frame)
    rate, rate_notes = footage.known_rate(clip.frame_rate, detections.frame_rate)
    aligned, notes = align(detections, timeline)
    return Shot(
        detections=aligned[part],
        size=size,
        frames=ClipFrames(timeline=timeline, part=part, frame_rate=rate),
        images=images,
        name=_name(video or keypoint_path),
        given=given,
        notes=(*footage.notes, *detections.notes, *notes, *size_notes, *rate_notes),
    )


def _empty_shot(video: Path, images: Path, clip: ClipOptions, given: CameraGiven) -> Shot:
    """A clip before detection, without people."""
    footage = Footage.of(images)
    size = footage.known_size(clip.image_size)
    assert size is not None and footage.timeline is not None
    part = chosen(footage.timeline, clip.first_frame, clip.last_frame)
    rate, rate_notes = footage.known_rate(clip.frame_rate, None)
    frames = ClipFrames(timeline=footage.timeline, part=part, frame_rate=rate)
    check_memory(images, len(frames.numbers))
    nobody = (np.zeros((0, COUNT, 3)),) * len(frames.numbers)
    return Shot(
        detections=Detections(frames=nobody, stems=tuple(map(str, frames.numbers)), source=images),
        size=size,
        frames=frames,
        images=images,
        name=_name(video),
        given=given,
        notes=(*footage.notes, *rate_notes),
    )


def _searched(shot: Shot, images: Path, detector: str | Detector, tell: Tell | None) -> Shot:
    """The same clip with all people that a detector finds."""
    camera = shot.given.camera(shot.size, shot.frames)  # its errors come before minutes of detection
    numbers = shot.frames.numbers
    pictures = SampledPictures(images, numbers, camera)
    found = find_keypoints(images, numbers, detector, tell or (lambda progress: None), on_frame=pictures.take)
    detections = found_detections(found, images)
    return replace(shot, detections=detections, notes=(*shot.notes, *detections.notes), found=found, pictures=pictures)


def read_clip(
    video: StrPath | None,
    keypoints: StrPath | None = None,
    *,
    clip: ClipOptions = ClipOptions(),
    camera: CameraOptions = CameraOptions(),
    detector: Detector | None = None,
    tell: Tell | None = None,
) -> Clip:
    """Read one person's keypoints, the camera and the frame rate of a clip.

    If no keypoints are given, they are detected in the video, which takes about as long as a fit. They are cached for
    the user: the same detector never searches the same frames twice, and an interrupted search continues.

    Frames without keypoints get confidence 0 everywhere. Notes for the user on how the input was read are in
    the clip's notes; the source of the focal length is in its camera.

    Args:
        video: A video file, a folder of images, or a folder in SMPLify-X layout (``images`` and ``keypoints`` inside).
            None to go without: overlays and comparisons with the video are then not possible.
        keypoints: Any format of fitting_core.io.READERS. None for a folder in SMPLify-X layout, or to detect them.
        clip: Which frames and who, how the files are read, and the detector to use if no keypoints are given. By
            default all frames, and the most prominent person, who is followed.
        camera: Focal length or calibration. By default the focal length is the one in the files, or else estimated from
            the clip, as in the commands. If a calibration has lens distortion, the clip is that of undistorted
            pictures; the unit of a moving camera is estimated from the keypoints if not stated.
        detector: An open one, from `find_detector`, instead of the one that `clip` names.
        tell: Called in this thread with the progress of detection; an exception from it ends detection.

    Raises:
        InputError: A file is missing or broken, options contradict each other, nothing was detected, or the detector is
            not on this computer.
    """
    shot = read_shot(video, keypoints, clip, camera, detector=detector, tell=tell)
    found, choice = choose_person(
        shot.detections, person=clip.person, first_frame=shot.first_frame, frame_rate=shot.frame_rate
    )
    notes = (*((choice,) if choice else ()), *check_inside(found.keypoints, shot.size))
    return shot.clip(found.keypoints, shot.camera(found.keypoints), entries=found.entries, notes=notes)


def read_footage(video: Path, *, clip: ClipOptions = ClipOptions(), camera: CameraOptions = CameraOptions()) -> Clip:
    """Read a clip without keypoints: nothing is detected in any frame.

    Args and errors as in `read_clip`; `clip`'s detector, person and keypoint scale are ignored.
    """
    given = CameraGiven.of(camera)
    images = video / "images" if (video / "images").is_dir() else video
    shot = _empty_shot(video, images, clip, given)
    seen = given.camera(shot.size, shot.frames)
    if given.automatic:
        seen = told_by_files(seen, images) or seen
    count = len(shot.detections)
    nothing = Keypoints(xy=np.zeros((count, COUNT, 2)), confidence=np.zeros((count, COUNT)))
    return shot.clip(nothing, seen, entries=(None,) * count, notes=())


def read_keypoints(path: StrPath, clip: Clip) -> tuple[Keypoints, tuple[str, ...], str]:
    """Keypoints for the frames of a known clip, notes on how they were read, and their detector.

    Args:
        path: Any format of fitting_core.io.READERS.
        clip: Its frames and its image size.

    Raises:
        InputError: As of `read_clip`.
    """
    path = Path(path)
    detections = read_detections(path)
    detections, scale_notes = to_pixels(detections, clip.camera.size)
    timeline = Footage.of(clip.source).timeline or _timeline_around(clip, detections)
    part = chosen(timeline, clip.first_frame, clip.first_frame + len(clip) - 1)
    aligned, notes = align(detections, timeline)
    first = timeline.numbers[part.start]
    found, choice = choose_person(aligned[part], first_frame=first, frame_rate=clip.frame_rate)
    of_person = (choice,) if choice else ()
    straight, of_lens = straightened_keypoints(found.keypoints, clip.camera.lens)
    of_places = check_inside(found.keypoints, clip.camera.size)
    said = (*detections.notes, *notes, *of_person, *scale_notes, *of_places, *of_lens)
    return straight, said, detections.detector


def _timeline_around(clip: Clip, detections: Detections) -> Timeline:
    """Without a video: the frames shared by clip and keypoints, or the clip's alone if they share none."""
    own, theirs = range(clip.first_frame, clip.first_frame + len(clip)), timeline_of_keypoints(detections).numbers
    first, stop = min(own.start, theirs.start), max(own.stop, theirs.stop)
    shared = stop - first < len(own) + len(theirs)
    return Timeline(numbers=range(first, stop) if shared else own)


def _in_pixels(
    detections: Detections, known: tuple[int, int] | None, keypoint_scale: str
) -> tuple[Detections, tuple[int, int], tuple[str, ...]]:
    """Detections in pixels, the image size, guessed if not known, and notes on both."""
    detections, scale_notes = to_pixels(detections, known, keypoint_scale=keypoint_scale)
    size, size_notes = (known, ()) if known else guessed_size(detections)
    return detections, size, (*scale_notes, *size_notes)


def _with_contradictions(detections: Detections, footage: Footage) -> Detections:
    """With notes if the keypoint file contradicts the video, which wins."""
    notes = list(detections.notes)
    if detections.frame_rate and footage.frame_rate and abs(detections.frame_rate - footage.frame_rate) > 0.01:
        notes.append(
            f"{detections.source.name} says {detections.frame_rate:g} frames per second; the video's "
            f"{footage.frame_rate:g} are used."
        )
    return replace(detections, notes=tuple(notes))


def check_inside(keypoints: Keypoints, size: tuple[int, int]) -> tuple[str, ...]:
    """A note or an error if the keypoints do not seem to be from these images."""
    points = keypoints.xy[keypoints.confidence > 0]
    outside = ((points < 0) | (points >= np.array(size))).any(1)
    if outside.mean() > 0.5:
        raise InputError(
            f"{outside.mean():.0%} of the keypoints lie outside the image: they reach {points[:, 0].max():.0f} x "
            f"{points[:, 1].max():.0f}, the image is {size[0]} x {size[1]}. They were made on images of another size, "
            "or rotated; use the same images."
        )
    if outside.mean() > 0.05:
        return (f"{outside.mean():.0%} of the keypoints lie outside the image of {size[0]} x {size[1]}.",)
    return ()


def _name(path: Path) -> str:
    path = path.resolve()
    stem = path.name if path.is_dir() else path.stem
    # The folder's name if the file's own is generic.
    inner = stem in ("images", "keypoints", "video") and path.parent.name
    return inner or stem.removesuffix("_keypoints")


_LENSES_MM = (5.0, 2000.0)
"""Plausible 35 mm equivalents in a file; others are mistakes."""


def told_by_files(camera: Camera, images: Path | None) -> Camera | None:
    """The camera with the focal length stored in a clip's photographs or video; None: none, or several."""
    if images is None:
        return None
    if images.is_dir() or images.suffix.lower() in IMAGE_SUFFIXES:
        files, who = image_files(images) or (images,), "stated by the images"
        # The first and the last: a zoom between them, or a folder put together from several cameras, is not one lens.
        lengths = {focal_35mm(file) for file in (files[0], files[-1])}
    else:
        lengths, who = {told_35mm(images)}, "stated by the video"
    millimetres = lengths.pop()
    if lengths or millimetres is None or not _LENSES_MM[0] <= millimetres <= _LENSES_MM[1]:
        return None
    focal = focal_from_35mm(millimetres, camera.size)
    source = f"35 mm equivalent of {millimetres:g} mm, {who}"
    return replace(camera, focal=(focal, focal), focal_from=FocalFrom.PHOTOGRAPHS, source=source)


def _path_scale(keypoints: Keypoints, frame_rate: float, camera: Camera) -> PathScale | None:
    """The scale of a moving camera's path, by the keypoints of the whole clip as filmed, with distortion."""
    from fitting_core.ground.path_scale import estimate_path_scale  # loads torch

    straight, _ = straightened_keypoints(keypoints, camera.lens)
    return estimate_path_scale(straight.xy, straight.confidence, camera, frame_rate)
