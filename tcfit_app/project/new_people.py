"""New projects for the people of a clip: a folder with people.json, one copy of the video, and a project for each."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from fitting_core.clips.people import PersonInClip, people_of
from fitting_core.io.people_file import write_people_file
from tcfit_app.project.storage import media
from tcfit_app.project.storage.accessing import creating
from tcfit_app.project.storage.clip import write_clip


def create_people(folder: Path, people: Sequence[PersonInClip], *, copy_media: bool = False) -> None:
    """Create the folder, completely or not at all; `opened_people` opens it. Raises InputError if the folder is not
    empty or cannot be written, or the source cannot be read.

    Args:
        folder: Must not exist, or be empty.
        people: Of one clip, at least one.
        copy_media: Copy the clip's source into the folder, once; otherwise it is linked.
    """
    folder, source = folder.resolve(), people[0].clip.source
    with creating(folder) as draft:
        copied = media.copy(source, draft) if source is not None and copy_media else None
        for one in people:
            own, link = one.about.folder, None
            if copied is not None:
                link = msgspec.structs.replace(copied, relative=f"../{copied.relative}")
            elif source is not None:
                link = media.link(source, folder / own)
            (draft / own).mkdir()
            write_clip(draft / own, one.clip, link=link)
        write_people_file(draft, people_of(people))
