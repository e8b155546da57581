"""`tcfit new`: read a clip and make a project of it."""

import sys
from pathlib import Path

from tcfit_app.clip_input import clip_of, described, notes_of
from tcfit_app.options import NewOptions
from tcfit_app.project import Project
from tcfit_app.storage.names import name_of_file

SUFFIX = ".tcfit"


def make_project(options: NewOptions) -> Path:
    """Make the project that the options ask for, and say on the standard output where it is.

    Raises:
        InputError: Files or options cannot be used, or the folder holds something; nothing has been written then.
    """
    clip = clip_of(options)
    print("\n".join([*described(clip), *notes_of(clip)]), file=sys.stderr, flush=True)
    # A name becomes a folder here only, in the working folder: not one part of it may lead elsewhere.
    folder = options.out or Path(name_of_file(clip.name).replace("/", "_").replace("\\", "_") + SUFFIX)
    with Project.create(folder, clip, copy_media=options.copy_video) as project:
        print(f"Made the project {folder}: {len(clip)} frames of {clip.name}")
        if project.media.problem:
            print(project.media.problem, file=sys.stderr)
    return folder
