"""The reference of a project: what its fits are compared with, in a file of its own.

No row in the database tells of it: the file is there as a whole or not at all, and says itself what it is.
"""

from pathlib import Path

from fitting_core.files.atomic import replacing, sync
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference, write_reference
from tcfit_app.project.storage.accessing import accessing

NAME = "reference.npz"


def stored_reference(folder: Path) -> Reference | None:
    """The project's reference, None if it has none. Raises InputError if its file is damaged."""
    path = folder / NAME
    return read_reference(path) if path.is_file() else None


def store_reference(folder: Path, reference: Reference | None) -> None:
    """Keep a reference, or none any more; when this returns, that is on the disk.

    Raises:
        InputError: The folder cannot be written.
    """
    path = folder / NAME
    with accessing(path):
        if reference is None:
            path.unlink(missing_ok=True)
            sync(folder)
            return
        with replacing(path) as draft:
            write_reference(draft, reference)
