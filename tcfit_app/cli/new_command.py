"""`tcfit new`: read a clip and make a project of it."""

import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from fitting_core.clip import Clip
from fitting_core.errors import InputError, printable
from fitting_core.keypoints import Keypoints
from fitting_core.lens import straightened_keypoints
from fitting_core.measure.references.reference import Reference
from fitting_core.video.fingerprint import fingerprint
from tcfit_app.cli.progress import DetectionShown
from tcfit_app.home.found import PROJECT_SUFFIX
from tcfit_app.options.clip_input import all_people_of, clip_of, clip_options, described, notes_of, refusal, with_views
from tcfit_app.options.fit import NewOptions, ReferenceOptions, ReviewOptions, height_of
from tcfit_app.project.new_people import create_people
from tcfit_app.project.project import Project
from tcfit_app.project.storage.accessing import check_free
from tcfit_app.project.storage.clip import read_clip, same_detections
from tcfit_app.project.storage.database import NAME, Database, is_project
from tcfit_app.project.storage.names import name_of_file

_PACKED = f"{PROJECT_SUFFIX}.zip"
"""Of a project that earlier versions packed."""
_FOCAL_OPTIONS = {"--focal-length", "--fov", "--focal-length-35mm", "--camera"}
_CENTER_OPTIONS = {"--center", "--camera"}


def make_project(options: NewOptions | ReviewOptions, *, reopen: bool = False) -> Path:
    """Make the project, and print its folder.

    With `reopen`, an existing project of the same clip is used unchanged.

    Raises:
        InputError: Files or options cannot be used, or the folder contains something else. Nothing is written then.
    """
    if options.video is not None and options.video.name.endswith(_PACKED):
        raise InputError(
            f"{options.video}: unpack it with any archiver into a folder NAME{PROJECT_SUFFIX}, and give that folder to "
            "tcfit review."
        )
    if isinstance(options, NewOptions) and options.people is not None:
        return _made_of_all_people(options)
    height = height_of(options)
    if options.out is not None and not reopen:
        check_free(options.out)  # before the detection, which takes minutes
    with DetectionShown() as tell_progress:
        clip = clip_of(options, tell_progress)
        folder = options.out or _folder_named(clip.name)
        if not (reopen and is_project(folder)):
            clip = with_views(clip, options, tell_progress)
    if reopen and is_project(folder):
        check_same_clip(folder, clip, clip_options(options))
        print(f"Opening the existing project {folder}.", file=sys.stderr, flush=True)
        return folder
    print(printable("\n".join([*described(clip), *notes_of(clip)])), file=sys.stderr, flush=True)
    reference = reference_given(options.truth, clip)
    if reference is not None:
        reference.frames_of(len(clip), clip.first_frame, clip.frame_rate)
    with Project.create(folder, clip, copy_media=options.copy_video) as project:
        if reference is not None:
            project.set_reference(reference)
        if height is not None:
            project.set_height(height)
        print(printable(f"Made the project {folder}: {len(clip)} frames of {clip.name}"))
        if project.media.problem:
            print(project.media.problem, file=sys.stderr)
    return folder


def _made_of_all_people(options: NewOptions) -> Path:
    """Make a folder of projects, one for each person."""
    with DetectionShown() as tell_progress:
        people = all_people_of(options, tell_progress)
    folder = options.out or _folder_named(people[0].name)
    print(printable("\n".join(described(people[0].clip)[1:])), file=sys.stderr)
    for one in people:
        print(printable("\n".join(notes_of(one.clip))), file=sys.stderr, flush=True)
    create_people(folder, people, copy_media=options.copy_video)
    of = ", ".join(f"{one.about.folder} ({len(one.clip)} frames)" for one in people)
    print(f"Made the projects of {len(people)} people in {folder}: {of}")
    return folder


def reference_given(options: ReferenceOptions, clip: Clip) -> Reference | None:
    """The reference of the options, or None. Raises InputError if it cannot be read."""
    if options.reference is None:
        if options.reference_camera is not None:
            raise InputError("--reference-camera is the camera in the reference's world: give --reference too.")
        if options.reference_first_frame is not None:
            raise InputError("--reference-first-frame is where the reference begins: give --reference too.")
        return None
    from fitting_core.measure.references.files import read_reference

    found = read_reference(options.reference, camera=options.reference_camera, seen_by=clip.camera)
    first = options.reference_first_frame
    return found if first is None else found.starting_at(first, clip.frame_rate)


def _folder_named(name: str) -> Path:
    """Default folder of a clip's project: in the current folder, by the clip's name."""
    # The name must not lead to another folder.
    return Path(name_of_file(name).replace("/", "_").replace("\\", "_") + PROJECT_SUFFIX)


def check_same_clip(folder: Path, clip: Clip, given: Sequence[str]) -> None:
    """Refuse a project of another clip.

    `given` are the options of the part of the clip, and of the camera.

    Raises:
        InputError: The project is of another video, or has other keypoints; or the options would have made another one.
    """
    with closing(Database(folder / NAME, read_only=True)) as store:
        made, link = read_clip(folder, store)
    choice = f"Give --out for a new project, or open the existing one: tcfit review {folder}"
    if clip.source and (link is None or link.fingerprint != fingerprint(clip.source)):
        raise InputError(f"{folder}: is the project of another clip than {clip.source}. {choice}")
    if given and _frames_and_camera(made, given) != _frames_and_camera(clip, given):
        raise InputError(f"{folder}: already exists for other frames or another camera. {refusal(given)}")
    # Without --camera, the keypoints are distorted as filmed.
    lens = made.camera.lens if clip.camera.lens is None else None
    if not _detected(clip.keypoints) or same_detections(
        made.keypoints, straightened_keypoints(clip.keypoints, lens)[0]
    ):
        return
    if not _detected(made.keypoints):
        raise InputError(
            f"{folder}: already exists without keypoints. Open it (tcfit review {folder}) and import the keypoints in "
            "the panel Start, or give --out for a new project."
        )
    raise InputError(f"{folder}: already exists with keypoints of another person or other frames. {choice}")


def _frames_and_camera(clip: Clip, given: Sequence[str]) -> tuple[object, ...]:
    """Frames and camera for a comparison: of the camera only what the options set, because a calibration is unknown if
    the clip is named without it."""
    camera = clip.camera
    asked = None if _FOCAL_OPTIONS.isdisjoint(given) else (camera.focal, camera.lens, camera.world, camera.path)
    center = None if _CENTER_OPTIONS.isdisjoint(given) else camera.center
    return clip.first_frame, len(clip), clip.frame_rate, camera.size, asked, center


def _detected(keypoints: Keypoints) -> bool:
    return bool(keypoints.confidence.any())
