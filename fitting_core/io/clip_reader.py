"""Read a clip: frames, keypoints and camera put together into what is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting_core.camera import Camera, FocalRule, Up
from fitting_core.clip import Clip
from fitting_core.detect.detecting import Detected
from fitting_core.detect.detectors import DEFAULT
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.camera_options import CameraGiven
from fitting_core.io.camera_rule import estimated, scale_by, told_by_files
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.footage import Footage, guessed_size, locate
from fitting_core.io.keypoints.alignment import Timeline, align, chosen, timeline_of_keypoints
from fitting_core.io.keypoints.detections import Detections, to_pixels
from fitting_core.io.keypoints.found import Tell, find_keypoints, found_by, found_detections, silhouettes_of
from fitting_core.io.keypoints.person import choose_person
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lens import straightened_keypoints


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A clip of which it is not yet said who in it is meant."""

    detections: Detections
    """Of the frames that are used, in pixels."""
    size: tuple[int, int]
    frames: ClipFrames
    images: Path | None
    name: str
    given: CameraGiven
    notes: tuple[str, ...]
    """On the frames, and on how keypoints were put to them."""
    later_notes: tuple[str, ...]
    """On the image size."""
    rate_notes: tuple[str, ...]
    found: Detected | None = None
    """What a detector found in it, if no keypoints were given."""

    @property
    def first_frame(self) -> int:
        """Its number."""
        return self.frames.numbers[0]

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return self.frames.frame_rate

    def camera(self, keypoints: Keypoints) -> tuple[Camera, tuple[str, ...]]:
        """The camera, with the focal length and the scale that these keypoints tell if no other is known, and notes."""
        seen, notes = self.given.camera(self.size, self.frames, scale_by(keypoints, self.frame_rate))
        if self.given.automatic:
            seen = told_by_files(seen, self.images) or estimated(seen, keypoints, self.frame_rate)
        return seen, notes

    def clip(
        self,
        keypoints: Keypoints,
        camera: Camera,
        *,
        entries: Sequence[int | None],
        of_person: tuple[str, ...],
        of_places: tuple[str, ...],
        of_camera: tuple[str, ...],
    ) -> Clip:
        """One person's.

        Args:
            keypoints: Of all frames, as detected.
            camera: Of them.
            entries: Per frame, the person's place in the list of people.
            of_person: Notes on who it is.
            of_places: Notes on where the keypoints lie.
            of_camera: Notes on the camera.
        """
        straight, of_lens = straightened_keypoints(keypoints, camera.lens)
        after = (*self.later_notes, *of_places, *self.rate_notes, *of_camera, *of_lens)
        return Clip(
            keypoints=straight,
            camera=replace(camera, notes=of_camera),
            frame_rate=self.frame_rate,
            name=self.name,
            source=self.images,
            first_frame=self.first_frame,
            detector=self.detections.detector,
            notes=(*self.notes, *of_person, *after),
            silhouettes=None if self.found is None else silhouettes_of(self.found, entries),
            found_by="" if self.found is None else found_by(self.found),
        )


def read_shot(
    video: Path | None,
    keypoints: Path | None,
    given: CameraGiven,
    *,
    detector: str | Detector,
    tell: Tell | None,
    keypoint_scale: str,
    frame_rate: float | None,
    image_size: tuple[int, int] | None,
    first_frame: int | None,
    last_frame: int | None,
) -> Shot:
    """Everything of a clip but who is meant; arguments and errors as of `read_clip`."""
    images, keypoint_path = locate(video, keypoints)
    if keypoint_path is None:
        assert video is not None and images is not None
        empty = _empty_shot(
            images,
            given,
            name=_name(video),
            frame_rate=frame_rate,
            image_size=image_size,
            first_frame=first_frame,
            last_frame=last_frame,
        )
        return _searched(empty, images, detector, tell)
    detections = read_detections(keypoint_path)
    footage = Footage.of(images)
    size = footage.known_size(image_size) or detections.size
    detections, size, size_notes = _in_pixels(_with_contradictions(detections, footage), size, keypoint_scale)
    timeline = footage.timeline or timeline_of_keypoints(detections)
    part = chosen(timeline, first_frame, last_frame)
    rate, rate_notes = footage.known_rate(frame_rate, detections.frame_rate)
    aligned, notes = align(detections, timeline)
    return Shot(
        detections=aligned[part],
        size=size,
        frames=ClipFrames(timeline=timeline, part=part, frame_rate=rate),
        images=images,
        name=_name(video or keypoint_path),
        given=given,
        notes=(*footage.notes, *detections.notes, *notes),
        later_notes=size_notes,
        rate_notes=rate_notes,
    )


def _empty_shot(
    images: Path,
    given: CameraGiven,
    *,
    name: str,
    frame_rate: float | None,
    image_size: tuple[int, int] | None,
    first_frame: int | None,
    last_frame: int | None,
) -> Shot:
    """A clip whose keypoints are yet to come, with nobody in any frame; arguments and errors as of `read_clip`."""
    footage = Footage.of(images)
    size = footage.known_size(image_size)
    assert size is not None and footage.timeline is not None
    part = chosen(footage.timeline, first_frame, last_frame)
    rate, rate_notes = footage.known_rate(frame_rate, None)
    frames = ClipFrames(timeline=footage.timeline, part=part, frame_rate=rate)
    nobody = (np.zeros((0, COUNT, 3)),) * len(frames.numbers)
    return Shot(
        detections=Detections(frames=nobody, stems=tuple(map(str, frames.numbers)), source=images),
        size=size,
        frames=frames,
        images=images,
        name=name,
        given=given,
        notes=footage.notes,
        later_notes=(),
        rate_notes=rate_notes,
    )


def _searched(shot: Shot, images: Path, detector: str | Detector, tell: Tell | None) -> Shot:
    """The same clip with everybody whom a detector finds."""
    shot.given.camera(shot.size, shot.frames)  # what is wrong with it is not told after minutes of detection
    numbers = shot.frames.numbers
    found = find_keypoints(images, numbers, detector, tell or (lambda progress: None))
    detections = found_detections(found, images)
    return replace(shot, detections=detections, notes=(*shot.notes, *detections.notes), found=found)


def read_clip(
    video: Path | None,
    keypoints: Path | None = None,
    *,
    detector: str | Detector = DEFAULT,
    tell: Tell | None = None,
    focal_length: float | FocalRule | None = None,
    fov: float | None = None,
    focal_length_35mm: float | None = None,
    center: tuple[float, float] | None = None,
    camera: Path | None = None,
    camera_name: str | None = None,
    camera_unit: float | None = None,
    camera_up: Up | None = None,
    person: int | None = None,
    keypoint_scale: str = "auto",
    frame_rate: float | None = None,
    image_size: tuple[int, int] | None = None,
    first_frame: int | None = None,
    last_frame: int | None = None,
) -> Clip:
    """Read one person's keypoints, the camera and the frame rate of a clip.

    Where no keypoints are given, they are found in the video, which takes about as long as a fit. They are kept in the
    user's cache: the same frames are not searched twice by the same detector, and a search that was ended goes on.

    Frames without keypoints get confidence 0 everywhere. Whatever a user should know about how the input was read
    stands in the clip's notes; where the focal length comes from stands in its camera.

    Args:
        video: A video file, a folder of images, or a folder in SMPLify-X layout (``images`` and ``keypoints`` inside).
            None to go without: overlays and comparisons with the video are then not possible.
        keypoints: Any format of fitting_core.io.READERS. None for a folder in SMPLify-X layout, or to have them found.
        detector: What finds them: a name in DETECTORS, the path of an ONNX model of the RTMPose family, or what
            `find_detector` opened.
        tell: Is told how far finding them is, in this thread; what it raises ends it.
        focal_length: Pixels; "auto" for what the files tell, or else an estimate from the clip; or "diagonal", the
            image's.
        fov: Horizontal field of view in degrees.
        focal_length_35mm: Millimetres on 35 mm film, as phones and cameras state it. At most one of these three; the
            default is "auto", as that of the commands.
        center: Principal point in pixels; the image's centre by default.
        camera: A calibration file, in place of the four before: any form of fitting_core.io.cameras.reading. Where it
            knows the lens's distortion, the clip is that of straightened pictures.
        camera_name: Which of its cameras, if it has several.
        camera_unit: Metres that one unit of its world is long. If nobody says it, it is estimated from the keypoints
            for a camera that moves, and else 1.
        camera_up: The axis of its world that points against gravity, where it is not as the file has it.
        person: Whoever has this place, from 0, in the first frame whose list of people has it; by default, the most
            prominent person is followed.
        keypoint_scale: "auto", "pixels", "0..1" or "-1..1".
        frame_rate: Frames per second; by default the video's.
        image_size: Width and height in pixels, where there is no video; by default guessed from the keypoints.
        first_frame: Number of the first frame to use, counted from 0 (as the files are numbered, if there is no video).
        last_frame: Number of the last frame to use.

    Raises:
        InputError: A file is missing or broken, options contradict each other, nothing was detected, or the detector is
            not on this computer.
    """
    given = CameraGiven.of(
        focal_length=focal_length,
        fov=fov,
        focal_length_35mm=focal_length_35mm,
        center=center,
        camera=camera,
        camera_name=camera_name,
        camera_unit=camera_unit,
        camera_up=camera_up,
    )
    shot = read_shot(
        video,
        keypoints,
        given,
        detector=detector,
        tell=tell,
        keypoint_scale=keypoint_scale,
        frame_rate=frame_rate,
        image_size=image_size,
        first_frame=first_frame,
        last_frame=last_frame,
    )
    choice = choose_person(shot.detections, person=person, first_frame=shot.first_frame, frame_rate=shot.frame_rate)
    of_places = check_inside(choice.keypoints, shot.size)
    seen, of_camera = shot.camera(choice.keypoints)
    of_person = (choice.note,) if choice.note else ()
    return shot.clip(
        choice.keypoints,
        seen,
        entries=choice.entries,
        of_person=of_person,
        of_places=of_places,
        of_camera=of_camera,
    )


def read_footage(
    video: Path,
    *,
    focal_length: float | FocalRule | None = None,
    fov: float | None = None,
    focal_length_35mm: float | None = None,
    center: tuple[float, float] | None = None,
    camera: Path | None = None,
    camera_name: str | None = None,
    camera_unit: float | None = None,
    camera_up: Up | None = None,
    frame_rate: float | None = None,
    image_size: tuple[int, int] | None = None,
    first_frame: int | None = None,
    last_frame: int | None = None,
) -> Clip:
    """Read a clip whose keypoints are yet to come: nothing is detected in any frame.

    Args and errors as of `read_clip`.
    """
    given = CameraGiven.of(
        focal_length=focal_length,
        fov=fov,
        focal_length_35mm=focal_length_35mm,
        center=center,
        camera=camera,
        camera_name=camera_name,
        camera_unit=camera_unit,
        camera_up=camera_up,
    )
    images = video / "images" if (video / "images").is_dir() else video
    shot = _empty_shot(
        images,
        given,
        name=_name(video),
        frame_rate=frame_rate,
        image_size=image_size,
        first_frame=first_frame,
        last_frame=last_frame,
    )
    seen, of_camera = given.camera(shot.size, shot.frames)
    if given.automatic:
        seen = told_by_files(seen, images) or seen
    count = len(shot.detections)
    nothing = Keypoints(xy=np.zeros((count, COUNT, 2)), confidence=np.zeros((count, COUNT)))
    return shot.clip(nothing, seen, entries=(None,) * count, of_person=(), of_places=(), of_camera=of_camera)


def read_keypoints(
    path: Path, clip: Clip, *, person: int | None = None, keypoint_scale: str = "auto"
) -> tuple[Keypoints, tuple[str, ...], str]:
    """Keypoints for the frames of a clip that is known, notes on how they were read, and who detected them.

    Args:
        path: Any format of fitting_core.io.READERS.
        clip: Its frames and its image size.
        person: As of `read_clip`.
        keypoint_scale: As of `read_clip`.

    Raises:
        InputError: As of `read_clip`.
    """
    detections = read_detections(path)
    detections, scale_notes = to_pixels(detections, clip.camera.size, keypoint_scale=keypoint_scale)
    timeline = Footage.of(clip.source).timeline or _timeline_around(clip, detections)
    part = chosen(timeline, clip.first_frame, clip.first_frame + len(clip) - 1)
    aligned, notes = align(detections, timeline)
    first = timeline.numbers[part.start]
    found = choose_person(aligned[part], person=person, first_frame=first, frame_rate=clip.frame_rate)
    of_person = (found.note,) if found.note else ()
    straight, of_lens = straightened_keypoints(found.keypoints, clip.camera.lens)
    of_places = check_inside(found.keypoints, clip.camera.size)
    said = (*detections.notes, *notes, *of_person, *scale_notes, *of_places, *of_lens)
    return straight, said, detections.detector


def _timeline_around(clip: Clip, detections: Detections) -> Timeline:
    """Where there is no video: the frames of the clip and of the keypoints, or of the clip alone if they share none."""
    own, theirs = range(clip.first_frame, clip.first_frame + len(clip)), timeline_of_keypoints(detections).numbers
    first, stop = min(own.start, theirs.start), max(own.stop, theirs.stop)
    shared = stop - first < len(own) + len(theirs)
    return Timeline(numbers=range(first, stop) if shared else own)


def _in_pixels(
    detections: Detections, known: tuple[int, int] | None, keypoint_scale: str
) -> tuple[Detections, tuple[int, int], tuple[str, ...]]:
    """Detections in pixels, the image size, which is guessed where it is not known, and notes on both."""
    detections, scale_notes = to_pixels(detections, known, keypoint_scale=keypoint_scale)
    size, size_notes = (known, ()) if known else guessed_size(detections)
    return detections, size, (*scale_notes, *size_notes)


def _with_contradictions(detections: Detections, footage: Footage) -> Detections:
    """With notes where the keypoint file says something else than the video, which is believed."""
    notes = list(detections.notes)
    if detections.frame_rate and footage.frame_rate and abs(detections.frame_rate - footage.frame_rate) > 0.01:
        notes.append(
            f"{detections.source.name} says {detections.frame_rate:g} frames per second; the video's "
            f"{footage.frame_rate:g} are used."
        )
    return replace(detections, notes=tuple(notes))


def check_inside(keypoints: Keypoints, size: tuple[int, int]) -> tuple[str, ...]:
    """A note, or an error, where the keypoints do not look as if made on these images."""
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
    # The folder's name where the file's own is generic.
    inner = stem in ("images", "keypoints", "video") and path.parent.name
    return inner or stem.removesuffix("_keypoints")
