"""The clip of a command line, and its description for the user."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fitting_core.camera import FocalFrom, World
from fitting_core.clip import Clip
from fitting_core.clips.footage import locate
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.people import PersonInClip, read_people
from fitting_core.clips.reading import read_clip, read_footage
from fitting_core.detect.found import Tell
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from tcfit_app.options.fit import (
    FOUND,
    HINTS,
    NO_KEYPOINTS,
    FitOptions,
    NewOptions,
    ReviewOptions,
    ViewOptions,
    camera_for,
)


def clip_of(options: FitOptions | NewOptions | ReviewOptions, tell: Tell | None = None) -> Clip:
    """Read the clip. Raises InputError, with the options as they are named on the command line, if files or options
    cannot be used.

    With --keypoints none, or for a review without other views, nothing is detected here. `with_views` adds those.

    Args:
        options: The command line.
        tell: Receives the progress of the detection.
    """
    _check_views(options)
    try:
        clip = _read(options, tell)
    except InputError as error:
        raise InputError(_translated(str(error))) from error
    return dataclasses.replace(clip, notes=tuple(map(_translated, clip.notes)))


def with_views(
    clip: Clip,
    options: FitOptions | NewOptions | ReviewOptions,
    tell: Tell | None = None,
    *,
    detector: Detector | None = None,
) -> Clip:
    """The clip with the other views of the options. Raises InputError as `clip_of`, or if one does not show the same
    person at the same time.

    Args:
        clip: That of the options.
        options: The command line.
        tell: Receives the progress of the detection.
        detector: An open one, instead of the one that the options name.
    """
    if not options.views.other_view:
        return clip
    from fitting_core.clips.other_views import read_view  # loads torch

    found = list(clip.views)
    for video, keypoints, focal, person, first in zip(*_check_views(options), strict=True):
        part = ClipOptions(detector=options.clip.detector, person=person, first_frame=first)
        camera = camera_for(
            CameraOptions(focal_length=focal), options.method if isinstance(options, FitOptions) else None
        )
        try:
            first = dataclasses.replace(clip, views=tuple(found))
            found.append(read_view(first, video, keypoints, clip=part, camera=camera, detector=detector, tell=tell))
        except InputError as error:
            raise InputError(f"--other-view {video}: {_of_view(str(error))}") from error
    return dataclasses.replace(clip, views=tuple(found))


def _check_views(options: FitOptions | NewOptions | ReviewOptions) -> list[Sequence[Any]]:
    """Each option of other views, by view; None where it was not given. Raises InputError if one is given more or less
    often than there are views, or a file is missing: before minutes of detection."""
    given = options.views
    count, found = len(given.other_view), list[Sequence[Any]]()
    for field in dataclasses.fields(ViewOptions):
        values = getattr(given, field.name)
        if len(values) not in (0, count):
            name = f"--{field.name.replace('_', '-')}"
            raise InputError(
                f"{name} is given {_times(len(values))}, but --other-view {_times(count)}. Give {name} once for each "
                f"view, in their order, or not at all; {FOUND} leaves one out."
            )
        found.append([None if str(value) == FOUND else value for value in values] or [None] * count)
    for path in (*found[0], *found[1]):
        if path is not None and not path.exists():
            raise InputError(f"--other-view: {path} does not exist; expected a video, or its keypoints.")
    if count and options.keypoints == NO_KEYPOINTS:
        raise InputError(f"--other-view cannot be combined with --keypoints {NO_KEYPOINTS}: both need keypoints.")
    return found


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def all_people_of(options: FitOptions | NewOptions, tell: Tell | None = None) -> list[PersonInClip]:
    """Read the clip of each person. Arguments as of `clip_of`. Raises InputError if files or options cannot be used, or
    an option is for one person."""
    ones: dict[str, object] = {"--person": options.clip.person, "--other-view": options.views.other_view or None}
    if isinstance(options, FitOptions):
        ones |= {"--shape": options.shape, "--height": options.method.height}
        ones |= {"--start-person": options.begin.start_person}
    else:
        ones |= {"--reference": options.truth.reference, "--height": options.height}
    if given := [name for name, value in ones.items() if value is not None]:
        raise InputError(
            f"--people {options.people} cannot be combined with {' and '.join(given)}, which is for one person."
        )
    if options.keypoints == NO_KEYPOINTS:
        raise InputError(
            f"--people {options.people} cannot be combined with --keypoints {NO_KEYPOINTS}: people are found by their "
            "keypoints."
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
"""The library's options, in backquotes: paths and keys of files may have the same names."""


def _translated(text: str) -> str:
    """A message with the names of options as on the command line."""
    return _NAMES.sub(lambda name: f"--{name[1].replace('_', '-')}", text)


_OF_VIEWS = {field.name.removeprefix("other_") for field in dataclasses.fields(ViewOptions)}


def _of_view(text: str) -> str:
    """The same for another view; options that views lack are plain words."""

    def named(name: re.Match[str]) -> str:
        return f"--other-{name[1].replace('_', '-')}" if name[1] in _OF_VIEWS else name[1].replace("_", " ")

    return _NAMES.sub(named, text)


def _read(options: FitOptions | NewOptions | ReviewOptions, tell: Tell | None) -> Clip:
    video, keypoints = options.video, options.keypoints
    alone = keypoints == NO_KEYPOINTS
    if alone and isinstance(options, FitOptions):
        raise InputError(
            f"--keypoints {NO_KEYPOINTS}: a fit needs keypoints. Leave the option out to detect them in the video, or "
            "give a file."
        )
    later = isinstance(options, ReviewOptions) and not options.views.other_view
    if later and video is not None and keypoints is None and video.exists():
        alone = locate(video, None)[1] is None
    if not alone:
        return read_clip(video, keypoints, clip=options.clip, camera=_camera(options), tell=tell)
    if video is None:
        raise InputError(f"--keypoints {NO_KEYPOINTS} needs a video. Give the video of the new project.")
    # The review's panel Start takes detector and person.
    unused = ("keypoint_scale",) if isinstance(options, ReviewOptions) else ("detector", "person", "keypoint_scale")
    plain = ClipOptions()
    for name in unused:
        if getattr(options.clip, name) != getattr(plain, name):
            named = f"--{name.replace('_', '-')}"
            raise InputError(f"{named} needs keypoints, and {video} has none yet. Leave it out.")
    return read_footage(video, clip=options.clip, camera=_camera(options))


def clip_options(options: NewOptions | ReviewOptions) -> list[str]:
    """The given options of clip and camera, as on the command line."""
    pairs = ((options.camera, CameraOptions()), (options.clip, ClipOptions()))
    return [
        f"--{field.name.replace('_', '-')}"
        for values, plain in pairs
        for field in dataclasses.fields(plain)
        if getattr(values, field.name) != getattr(plain, field.name)
    ]


def refusal(given: Sequence[str]) -> str:
    """The message if options of clip and camera are given for an existing project."""
    return (
        f"{', '.join(given)} can only be given for a new project: name the clip and --out. In the review, set the "
        "focal length in the panel Fit, and import keypoints in the panel Start."
    )


def check_not_new(project: Path, options: NewOptions | ReviewOptions, *, allowed: str = "") -> None:
    """Raise InputError if options that only a new project takes are given for an existing one."""
    given = ["--keypoints"] * (options.keypoints is not None) + ["--copy-video"] * options.copy_video
    if given := [option for option in given + clip_options(options) if option != allowed]:
        raise InputError(f"{project}: is already a project. {refusal(given)}")


def described(clip: Clip) -> list[str]:
    """Length, keypoints and camera, as lines for the user."""
    camera = clip.camera
    frames = f"frames {clip.first_frame}–{clip.first_frame + len(clip) - 1}, {clip.frame_rate:g} fps"
    focal = f"{camera.focal[0]:.1f} px: {camera.source}"
    if camera.focal_from is FocalFrom.DIAGONAL and not (clip.keypoints.confidence > 0).any():
        focal = "estimated once there are keypoints"
    return [
        f"Clip {clip.name}: {frames}, {camera.size[0]} x {camera.size[1]} pixels",
        *_keypoints(clip),
        f"Focal length {focal}",
        *([] if camera.vertical is None else [str(camera.vertical).capitalize()]),
        *([] if camera.lens is None else ["Lens distortion is removed from keypoints and pictures"]),
        *([] if camera.world is None else [_place(camera.world, moves=camera.path is not None)]),
        *(
            []
            if camera.focal_from in (FocalFrom.GIVEN, FocalFrom.FILE)
            else ["  (set it by --focal-length, --fov or --focal-length-35mm)"]
        ),
        *(view.sentence() for view in clip.views),
    ]


def _keypoints(clip: Clip) -> list[str]:
    seen = (clip.keypoints.confidence > 0).any(1)
    if not seen.any():
        return ["No keypoints yet: the review finds or imports them"]
    name = clip.found_by.rpartition(" (version ")[0]
    return [f"Keypoints: {name}, in {seen.sum()} of {len(clip)} frames"] if name else []


def _place(world: World, *, moves: bool) -> str:
    up = "the up direction is unknown" if world.up is None else f"{world.up} is up"
    stands = "moves. It starts" if moves else "is"
    return f"The camera {stands} at ({', '.join(f'{at:.2f}' for at in world.place)}) m in a world where {up}"


def notes_of(clip: Clip) -> list[str]:
    """Notes on how the clip was read, as lines for the user."""
    others = [f"{view.clip.name}: {note}" for view in clip.views for note in view.clip.notes]
    return [f"Note: {note}" for note in (*clip.notes, *others)]
