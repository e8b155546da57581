"""Read a clip: frames, keypoints and camera put together into what is fitted."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting_core.camera import Camera, FocalRule, PathScale, Up
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.camera_options import camera_of, focal_option
from fitting_core.io.camera_rule import estimated, scale_by, told_by_photographs
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.cameras.reading import CameraFile, read_camera
from fitting_core.io.keypoints.alignment import Timeline, align, chosen, timeline_of_keypoints
from fitting_core.io.keypoints.detections import Detections, to_pixels
from fitting_core.io.keypoints.person import choose_person
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lens import straightened_keypoints
from fitting_core.video.frames import FrameSource

DEFAULT_FRAME_RATE = 30.0
_MAX_FRAME_RATE = 2000.0
_SQUARE = 0.01
"""By so much a pixel's width and height may differ: rounded numbers in files do."""

_LANDSCAPE = ((320, 240), (640, 480), (854, 480), (1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (7680, 4320))
_COMMON_SIZES = sorted([*_LANDSCAPE, *((h, w) for w, h in _LANDSCAPE)], key=lambda size: size[0] * size[1])


@dataclass(frozen=True, kw_only=True)
class _Footage:
    """What read_clip needs to know of the frames; without a video, what stands in for it."""

    path: Path | None
    size: tuple[int, int] | None
    frame_rate: float | None
    timeline: Timeline | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Person:
    """Who is followed in the frames that are used."""

    keypoints: Keypoints
    first_frame: int
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class CameraGiven:
    """What a user says of the camera, checked; `read_clip` has the words."""

    file: CameraFile | None
    focal: tuple[str, float] | None
    center: tuple[float, float] | None
    automatic: bool
    """The focal length is told by photographs, or estimated."""

    @classmethod
    def of(
        cls,
        *,
        focal_length: float | FocalRule | None,
        fov: float | None,
        focal_length_35mm: float | None,
        center: tuple[float, float] | None,
        camera: Path | None,
        camera_name: str | None,
        camera_unit: float | None,
        camera_up: Up | None,
    ) -> "CameraGiven":
        """Raises InputError where these contradict each other."""
        focal = focal_option({"focal_length": focal_length, "fov": fov, "focal_length_35mm": focal_length_35mm})
        file = _camera_file(camera, camera_name, camera_unit, camera_up, focal_length or focal or center)
        return cls(file=file, focal=focal, center=center, automatic=focal_length == "auto")


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
        scale_of = scale_by(keypoints, self.frame_rate)
        seen, notes = _camera(self.given.file, self.size, self.frames, self.given.center, self.given.focal, scale_of)
        if self.given.automatic:
            seen = told_by_photographs(seen, self.images) or estimated(seen, keypoints, self.frame_rate)
        return seen, notes

    def clip(self, keypoints: Keypoints, camera: Camera, *notes: tuple[str, ...]) -> Clip:
        """One person's.

        Args:
            keypoints: Of all frames, as detected.
            camera: Of them.
            notes: On the person, on where the keypoints lie, and on the camera.
        """
        of_person, of_places, of_camera = notes
        straight, of_lens = straightened_keypoints(keypoints, camera.lens)
        after = (*self.later_notes, *of_places, *self.rate_notes, *of_camera, *of_lens)
        return Clip(
            keypoints=straight,
            camera=camera,
            frame_rate=self.frame_rate,
            name=self.name,
            source=self.images,
            first_frame=self.first_frame,
            notes=(*self.notes, *of_person, *after),
        )


def read_shot(
    video: Path | None,
    keypoints: Path | None,
    given: CameraGiven,
    *,
    keypoint_scale: str,
    frame_rate: float | None,
    image_size: tuple[int, int] | None,
    first_frame: int | None,
    last_frame: int | None,
) -> Shot:
    """Everything of a clip but who is meant; arguments and errors as of `read_clip`."""
    images, keypoint_path = locate(video, keypoints)
    detections = read_detections(keypoint_path)
    footage = _footage(images)
    size = _known_size(footage, image_size) or detections.size
    detections, size, size_notes = _in_pixels(_with_contradictions(detections, footage), size, keypoint_scale)
    timeline = footage.timeline or timeline_of_keypoints(detections)
    part = chosen(timeline, first_frame, last_frame)
    rate, rate_notes = _frame_rate(frame_rate, footage, detections.frame_rate)
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


def read_clip(
    video: Path | None,
    keypoints: Path | None = None,
    *,
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

    Frames without keypoints get confidence 0 everywhere. Whatever a user should know about how the input was read
    stands in the clip's notes; where the focal length comes from stands in its camera.

    Args:
        video: A video file, a folder of images, or a folder in SMPLify-X layout (``images`` and ``keypoints`` inside).
            None to go without: overlays and comparisons with the video are then not possible.
        keypoints: Any format of fitting_core.io.READERS. None for a folder in SMPLify-X layout.
        focal_length: Pixels; "auto" for what photographs tell, or else an estimate from the clip; or "diagonal".
        fov: Horizontal field of view in degrees.
        focal_length_35mm: Millimetres on 35 mm film, as phones and cameras state it. At most one of these three; the
            default is the image diagonal.
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
        InputError: A file is missing or broken, options contradict each other, or nothing was detected.
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
        keypoint_scale=keypoint_scale,
        frame_rate=frame_rate,
        image_size=image_size,
        first_frame=first_frame,
        last_frame=last_frame,
    )
    choice = choose_person(shot.detections, person=person, first_frame=shot.first_frame)
    inside_notes = check_inside(choice.keypoints, shot.size)
    seen, camera_notes = shot.camera(choice.keypoints)
    of_person = (choice.note,) if choice.note else ()
    return shot.clip(choice.keypoints, seen, of_person, inside_notes, camera_notes)


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
    focal = focal_option({"focal_length": focal_length, "fov": fov, "focal_length_35mm": focal_length_35mm})
    calibrated = _camera_file(camera, camera_name, camera_unit, camera_up, focal_length or focal or center)
    images = video / "images" if (video / "images").is_dir() else video
    footage = _footage(images)
    size = _known_size(footage, image_size)
    assert size is not None and footage.timeline is not None
    part = chosen(footage.timeline, first_frame, last_frame)
    rate, rate_notes = _frame_rate(frame_rate, footage, None)
    looked_at = ClipFrames(timeline=footage.timeline, part=part, frame_rate=rate)
    seen, camera_notes = _camera(calibrated, size, looked_at, center, focal)
    frames = looked_at.numbers
    if focal_length == "auto":
        seen = told_by_photographs(seen, images) or seen
    return Clip(
        keypoints=Keypoints(xy=np.zeros((len(frames), COUNT, 2)), confidence=np.zeros((len(frames), COUNT))),
        camera=seen,
        frame_rate=rate,
        name=_name(video),
        source=images,
        first_frame=frames[0],
        notes=(*footage.notes, *rate_notes, *camera_notes),
    )


def read_keypoints(
    path: Path, clip: Clip, *, person: int | None = None, keypoint_scale: str = "auto"
) -> tuple[Keypoints, tuple[str, ...]]:
    """Keypoints for the frames of a clip that is known, and notes on how they were read.

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
    timeline = _footage(clip.source).timeline or _timeline_around(clip, detections)
    part = chosen(timeline, clip.first_frame, clip.first_frame + len(clip) - 1)
    found = _person(detections, timeline, part, person)
    straight, lens_notes = straightened_keypoints(found.keypoints, clip.camera.lens)
    return straight, (*found.notes, *scale_notes, *check_inside(found.keypoints, clip.camera.size), *lens_notes)


def _camera_file(
    path: Path | None, name: str | None, unit: float | None, up: Up | None, others: object
) -> CameraFile | None:
    """The calibration that a user gave.

    Args:
        path: The file.
        name: Of a camera in it.
        unit: Of its world.
        up: Of its world.
        others: Whatever else was said of the camera.

    Raises:
        InputError: The camera is given twice, or something of a file that is not given.
    """
    if path is None:
        told = {"camera_name": name, "camera_unit": unit, "camera_up": up}
        if given := [option for option, value in told.items() if value is not None]:
            raise InputError(f"{given[0]} is given without a camera file. Give the file, or leave it out.")
        return None
    if others:
        raise InputError(
            f"The camera is given twice: by {path}, and by a focal length or a principal point. Give one of them only."
        )
    return CameraFile(path=path, name=name, unit=unit, up=up)


def _camera(
    calibrated: CameraFile | None,
    size: tuple[int, int],
    frames: ClipFrames,
    center: tuple[float, float] | None,
    focal: tuple[str, float] | None,
    scale_of: Callable[[Camera], PathScale | None] | None = None,
) -> tuple[Camera, tuple[str, ...]]:
    """The camera, by its calibration or by what a user says of it, and notes."""
    if calibrated is None:
        return camera_of(size, center, focal), ()
    return read_camera(calibrated, size, frames, scale_of=scale_of)


def _person(detections: Detections, timeline: Timeline, part: slice, person: int | None) -> _Person:
    """Who is followed in a part of the timeline."""
    aligned, notes = align(detections, timeline)
    first = timeline.numbers[part.start]
    choice = choose_person(aligned[part], person=person, first_frame=first)
    notes = (*detections.notes, *notes, *([choice.note] if choice.note else []))
    return _Person(keypoints=choice.keypoints, first_frame=first, notes=notes)


def _timeline_around(clip: Clip, detections: Detections) -> Timeline:
    """Where there is no video: the frames of the clip and of the keypoints, or of the clip alone if they share none."""
    own, theirs = range(clip.first_frame, clip.first_frame + len(clip)), timeline_of_keypoints(detections).numbers
    first, stop = min(own.start, theirs.start), max(own.stop, theirs.stop)
    shared = stop - first < len(own) + len(theirs)
    return Timeline(numbers=range(first, stop) if shared else own)


def locate(video: Path | None, keypoints: Path | None) -> tuple[Path | None, Path]:
    """Where the frames and the keypoints are, given what the user pointed at.

    Raises:
        InputError: Neither names keypoints.
    """
    inside = video if video is not None and (video / "images").is_dir() else None
    images = inside / "images" if inside else video
    if keypoints is not None:
        return images, keypoints
    if video is None:
        raise InputError("Neither a video nor keypoints were given; expected at least the keypoints.")
    found = video / "keypoints"
    if found.is_dir() and inside:
        return images, found
    missing = "keypoints" if inside else "images"
    hint = f"; as a folder in SMPLify-X layout it lacks {missing}/" if video.is_dir() else ""
    raise InputError(f"No keypoints given for {video}{hint}. Name the folder or file of the keypoints.")


def _footage(path: Path | None) -> _Footage:
    if path is None:
        return _Footage(path=None, size=None, frame_rate=None, timeline=None)
    with FrameSource(path) as frames:
        notes = []
        if frames.count < frames.declared_count:
            notes.append(
                f"{path.name} is truncated: it says it has {frames.declared_count} frames, but only {frames.count} can "
                "be decoded; these are used."
            )
        if frames.uneven:
            says = f" (its header says {frames.declared_frame_rate:.4g})" if frames.declared_frame_rate else ""
            notes.append(
                f"The frames of {path.name} are not evenly spaced in time, but are taken as if they were: "
                f"{frames.frame_rate:.4g} per second on average{says}. Re-encode it at a constant frame rate if motion "
                "looks jerky, and detect the keypoints on the result."
            )
        if abs(frames.pixel_aspect - 1) > _SQUARE:
            notes.append(_pixel_note(path, frames.pixel_aspect))
        timeline = Timeline(numbers=range(frames.count), stems=frames.stems, source=path)
        return _Footage(
            path=path, size=frames.size, frame_rate=frames.frame_rate, timeline=timeline, notes=tuple(notes)
        )


def _pixel_note(path: Path, aspect: float) -> str:
    come_out = "thin" if aspect > 1 else "wide"
    made = f"{shlex.quote(path.name)} -vf scale=iw*sar:ih,setsar=1 {shlex.quote(path.stem)}-square.mp4"
    return (
        f"The pixels of {path.name} are {aspect:.3g} times as wide as high, but are taken for square, so that a person "
        f"comes out too {come_out}. Convert it (ffmpeg -i {made}), and detect the keypoints on the result."
    )


def _known_size(footage: _Footage, option: tuple[int, int] | None) -> tuple[int, int] | None:
    if option is None:
        return footage.size
    if not all(1 <= side <= 100_000 and side == int(side) for side in option):
        raise InputError(f"image_size is {option[0]} x {option[1]}; expected width and height in whole pixels.")
    if footage.size and footage.size != tuple(option):
        raise InputError(
            f"image_size is {option[0]} x {option[1]}, but {footage.path} is {footage.size[0]} x {footage.size[1]} "
            "pixels. Leave the option out."
        )
    return (int(option[0]), int(option[1]))


def _guess_size(detections: Detections) -> tuple[tuple[int, int], tuple[str, ...]]:
    """The smallest common image size that holds all keypoints."""
    points = detections.detected_points()
    width, height = np.ceil(points.max(0)).astype(int) + 1 if len(points) else (1, 1)
    fitting = [size for size in _COMMON_SIZES if width <= size[0] and height <= size[1]]
    size = fitting[0] if fitting else (int(width), int(height))
    note = (
        f"The image size is not known; {size[0]} x {size[1]} is assumed, the smallest common size that holds all "
        f"keypoints (they reach {width} x {height}). Give image_size for a right camera."
    )
    return size, (note,)


def _in_pixels(
    detections: Detections, known: tuple[int, int] | None, keypoint_scale: str
) -> tuple[Detections, tuple[int, int], tuple[str, ...]]:
    """Detections in pixels, the image size, which is guessed where it is not known, and notes on both."""
    detections, scale_notes = to_pixels(detections, known, keypoint_scale=keypoint_scale)
    size, size_notes = (known, ()) if known else _guess_size(detections)
    return detections, size, (*scale_notes, *size_notes)


def _with_contradictions(detections: Detections, footage: _Footage) -> Detections:
    """With notes where the keypoint file says something else than the video, which is believed."""
    notes = list(detections.notes)
    if detections.size and footage.size and detections.size != footage.size:
        notes.append(
            f"{detections.source.name} says that the image is {detections.size[0]} x {detections.size[1]} pixels; the "
            f"video's {footage.size[0]} x {footage.size[1]} are used."
        )
    if detections.frame_rate and footage.frame_rate and abs(detections.frame_rate - footage.frame_rate) > 0.01:
        notes.append(
            f"{detections.source.name} says {detections.frame_rate:g} frames per second; the video's "
            f"{footage.frame_rate:g} are used."
        )
    return replace(detections, notes=tuple(notes))


def _frame_rate(option: float | None, footage: _Footage, told: float | None) -> tuple[float, tuple[str, ...]]:
    if option is not None and not 0 < option <= _MAX_FRAME_RATE:
        raise InputError(
            f"frame_rate is {option:g}; expected frames per second, above 0 and up to {_MAX_FRAME_RATE:g}."
        )
    known = footage.frame_rate or told
    if option is None and known is None:
        note = f"The frame rate is not known; {DEFAULT_FRAME_RATE:g} frames per second are assumed. Give frame_rate."
        return DEFAULT_FRAME_RATE, (note,)
    if option is None:
        return known or DEFAULT_FRAME_RATE, ()
    if known and abs(option - known) > 0.01:
        says = "the video" if footage.frame_rate else "the keypoint file"
        return option, (f"The frame rate is {option:g} as given; {says} says {known:g}.",)
    return option, ()


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
    # A generic name says nothing; the folder around it does.
    inner = stem in ("images", "keypoints", "video") and path.parent.name
    return inner or stem.removesuffix("_keypoints")
