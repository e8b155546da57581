"""The clip that a command line asks for, and what to tell its user: most that goes wrong goes wrong here."""

import dataclasses
import re
from collections.abc import Callable, Sequence
from typing import Any

from fitting_core.camera import World
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.io.clip_reader import read_clip, read_footage
from fitting_core.io.people_reader import PersonInClip, read_people
from tcfit_app.options.fit import CameraOptions, ClipOptions, FitOptions, NewOptions, ReviewOptions, camera_for


def clip_of(options: FitOptions | NewOptions | ReviewOptions) -> Clip:
    """Read the clip; what the library calls `frame_rate` its messages call --frame-rate here.

    A project can be made of a video alone: nothing is detected then.

    Raises:
        InputError: Files or options cannot be used.
    """
    details, translated = _details(options)
    try:
        clip = _read(options, details)
    except InputError as error:
        raise InputError(translated(str(error))) from error
    return dataclasses.replace(clip, notes=tuple(map(translated, clip.notes)))


def everybody_of(options: FitOptions | NewOptions) -> list[PersonInClip]:
    """Read everybody in the clip, each as a clip; words as of `clip_of`.

    Raises:
        InputError: Files or options cannot be used, or are of one person.
    """
    if options.clip.person is not None:
        raise InputError(f"--people {options.people} and --person {options.clip.person}: give one of them.")
    details, translated = _details(options)
    del details["person"]
    try:
        people = read_people(options.video, options.keypoints, **details)
    except InputError as error:
        raise InputError(translated(str(error))) from error
    return [
        dataclasses.replace(one, clip=dataclasses.replace(one.clip, notes=tuple(map(translated, one.clip.notes))))
        for one in people
    ]


def _details(options: FitOptions | NewOptions | ReviewOptions) -> tuple[dict[str, Any], Callable[[str], str]]:
    """What the library is asked for, and what turns its words for them into the command line's."""
    camera = camera_for(options.camera, options.method if isinstance(options, FitOptions) else None)
    details = dataclasses.asdict(camera) | dataclasses.asdict(options.clip)
    names = re.compile(r"\b(" + "|".join(name for name in details if "_" in name) + r")\b")

    def translated(text: str) -> str:
        return names.sub(lambda name: "--" + name[0].replace("_", "-"), text)

    return details, translated


def _read(options: FitOptions | NewOptions | ReviewOptions, details: dict[str, Any]) -> Clip:
    video = options.video
    if isinstance(options, FitOptions) or video is None or options.keypoints is not None or not video.exists():
        return read_clip(video, options.keypoints, **details)
    if (video / "images").is_dir() and (video / "keypoints").is_dir():
        return read_clip(video, **details)
    plain = ClipOptions()
    for name in ("person", "keypoint_scale"):
        if details.pop(name) != getattr(plain, name):
            named = f"--{name.replace('_', '-')}"
            raise InputError(f"{named} is of no use without keypoints: {video} has none yet. Leave it out.")
    return read_footage(video, **details)


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
    """Length and camera, as lines for the user."""
    camera = clip.camera
    frames = f"{len(clip)} frames from {clip.first_frame} on at {clip.frame_rate:g} per second"
    none = "No keypoints yet: the review (tcfit review) imports or detects them, in its panel Start"
    return [
        f"Clip {clip.name}: {frames}, {camera.size[0]} x {camera.size[1]} pixels",
        f"Focal length {camera.focal[0]:.1f} px: {camera.source}",
        *([] if camera.lens is None else ["Lens distortion is taken away from keypoints and pictures"]),
        *([] if camera.world is None else [_place(camera.world, moves=camera.path is not None)]),
        *([] if clip.keypoints.confidence.any() else [none]),
        *([] if camera.source.endswith("as given") else ["  (set it by --focal-length, --fov or --focal-length-35mm)"]),
    ]


def _place(world: World, *, moves: bool) -> str:
    up = "up is not known" if world.up is None else f"{world.up} is up"
    stands = "moves; it begins" if moves else "stands"
    return f"The camera {stands} at ({', '.join(f'{at:.2f}' for at in world.place)}) m in a world where {up}"


def notes_of(clip: Clip) -> list[str]:
    """How the clip was read, as lines for the user."""
    return [f"Note: {note}" for note in clip.notes]
