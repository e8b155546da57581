"""The clip that a command line asks for, and what to tell its user about it."""

import dataclasses
import re
from collections.abc import Sequence

from fitting_core.camera import FocalFrom, World
from fitting_core.clip import Clip
from fitting_core.clips.footage import locate
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.people import PersonInClip, read_people
from fitting_core.clips.reading import read_clip, read_footage
from fitting_core.detect.found import Tell
from fitting_core.errors import InputError
from tcfit_app.options.fit import HINTS, NO_KEYPOINTS, FitOptions, NewOptions, ReviewOptions, camera_for


def clip_of(options: FitOptions | NewOptions | ReviewOptions, tell: Tell | None = None) -> Clip:
    """Read the clip; what the library calls `frame_rate` its messages call --frame-rate here. Raises InputError if
    files or options cannot be used.

    A project can be made of a video alone, with --keypoints none: nothing is detected then. A review finds nothing
    itself either: the app does, while it is looked at.

    Args:
        options: The command line.
        tell: Is told how far keypoints are found, if none are given.
    """
    try:
        clip = _read(options, tell)
    except InputError as error:
        raise InputError(_translated(str(error))) from error
    return dataclasses.replace(clip, notes=tuple(map(_translated, clip.notes)))


def everybody_of(options: FitOptions | NewOptions, tell: Tell | None = None) -> list[PersonInClip]:
    """Read everybody in the clip, each as a clip; words and arguments as of `clip_of`. Raises InputError if files or
    options cannot be used, or are of one person."""
    if options.clip.person is not None:
        raise InputError(f"--people {options.people} and --person {options.clip.person}: give one of them.")
    if options.keypoints == NO_KEYPOINTS:
        raise InputError(
            f"--people {options.people} and --keypoints {NO_KEYPOINTS}: without keypoints nobody is known. Leave one "
            "of them out."
        )
    try:
        people = read_people(options.video, options.keypoints, clip=options.clip, camera=_camera(options), tell=tell)
    except InputError as error:
        raise InputError(_translated(str(error))) from error
    return [
        dataclasses.replace(one, clip=dataclasses.replace(one.clip, notes=tuple(map(_translated, one.clip.notes))))
        for one in people
    ]


def _camera(options: FitOptions | NewOptions | ReviewOptions) -> CameraOptions:
    return camera_for(options.camera, options.method if isinstance(options, FitOptions) else None)


_NAMES = re.compile(f"`({'|'.join(f.name for kind in HINTS for f in dataclasses.fields(kind))})`")
"""The library's options in its own words: paths and keys of files may have the same names."""


def _translated(text: str) -> str:
    """The library's words in the command line's."""
    return _NAMES.sub(lambda name: "--" + name[1].replace("_", "-"), text)


def _read(options: FitOptions | NewOptions | ReviewOptions, tell: Tell | None) -> Clip:
    video, keypoints = options.video, options.keypoints
    alone = keypoints == NO_KEYPOINTS
    if alone and isinstance(options, FitOptions):
        raise InputError(
            f"--keypoints {NO_KEYPOINTS}: a fit needs keypoints. Leave the option out to have them found in the video, "
            "or give those that you have."
        )
    if isinstance(options, ReviewOptions) and video is not None and keypoints is None and video.exists():
        alone = locate(video, None)[1] is None
    if not alone:
        return read_clip(video, keypoints, clip=options.clip, camera=_camera(options), tell=tell)
    if video is None:
        raise InputError(f"--keypoints {NO_KEYPOINTS}, and no video: give one of which a project is to be made.")
    # The review's panel Start takes detector and person.
    unused = ("keypoint_scale",) if isinstance(options, ReviewOptions) else ("detector", "person", "keypoint_scale")
    plain = ClipOptions()
    for name in unused:
        if getattr(options.clip, name) != getattr(plain, name):
            named = f"--{name.replace('_', '-')}"
            raise InputError(f"{named} is of no use without keypoints: {video} has none yet. Leave it out.")
    return read_footage(video, clip=options.clip, camera=_camera(options))


def clip_options(options: NewOptions | ReviewOptions) -> list[str]:
    """The options of clip and camera on the command line, as their user typed them."""
    pairs = ((options.camera, CameraOptions()), (options.clip, ClipOptions()))
    return [
        f"--{field.name.replace('_', '-')}"
        for values, plain in pairs
        for field in dataclasses.fields(plain)
        if getattr(values, field.name) != getattr(plain, field.name)
    ]


def refusal(given: Sequence[str]) -> str:
    """What to tell who gave options of clip and camera for a project that is there already."""
    counts = "counts" if len(given) == 1 else "count"
    return (
        f"{', '.join(given)} {counts} for a new project: give the clip itself, and --out. The focal length of a fit is "
        "set in the panel Fit."
    )


def described(clip: Clip) -> list[str]:
    """Length, keypoints and camera, as lines for the user."""
    camera = clip.camera
    frames = f"{len(clip)} frames from {clip.first_frame} on at {clip.frame_rate:g} per second"
    return [
        f"Clip {clip.name}: {frames}, {camera.size[0]} x {camera.size[1]} pixels",
        *_keypoints(clip),
        f"Focal length {camera.focal[0]:.1f} px: {camera.source}",
        *([] if camera.lens is None else ["Lens distortion is taken away from keypoints and pictures"]),
        *([] if camera.world is None else [_place(camera.world, moves=camera.path is not None)]),
        *(
            []
            if camera.focal_from in (FocalFrom.GIVEN, FocalFrom.FILE)
            else ["  (set it by --focal-length, --fov or --focal-length-35mm)"]
        ),
    ]


def _keypoints(clip: Clip) -> list[str]:
    seen = (clip.keypoints.confidence > 0).any(1)
    if not seen.any():
        return ["No keypoints yet: the review finds or imports them"]
    name = clip.found_by.rpartition(" (version ")[0]
    return [f"Keypoints: found by {name} in {seen.sum()} of {len(clip)} frames"] if name else []


def _place(world: World, *, moves: bool) -> str:
    up = "up is not known" if world.up is None else f"{world.up} is up"
    stands = "moves; it begins" if moves else "stands"
    return f"The camera {stands} at ({', '.join(f'{at:.2f}' for at in world.place)}) m in a world where {up}"


def notes_of(clip: Clip) -> list[str]:
    """How the clip was read, as lines for the user."""
    return [f"Note: {note}" for note in clip.notes]
