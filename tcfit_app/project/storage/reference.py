"""The reference that a project's fits are compared with, in its own file.

No database row refers to it: the file exists completely or not at all, and describes itself.
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
    """Store a reference, or remove it; it is on disk when this returns. Raises InputError if that fails."""
    path = folder / NAME
    with accessing(path):
        if reference is None:
            path.unlink(missing_ok=True)
            sync(folder)
            return
        with replacing(path) as draft:
            write_reference(draft, reference)
