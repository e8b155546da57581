"""Body models, found by a run's record and each read once."""

import threading
from concurrent.futures import Future
from pathlib import Path

from fitting_core.body.files.former import former_body
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.measure.references.bodies import body_of
from fitting_core.measure.references.reference import Reference
from tcfit_app.project.storage.run_record import BodyRecord


def record_of(body: BodyModel) -> BodyRecord:
    """A body model's record for runs."""
    return BodyRecord(kind=body.kind, gender=body.gender, hash=body.hash, source=str(body.source or ""))


class Bodies:
    """Reads body models on first use. Thread-safe.

    Args:
        search: The only model file or folder to search; None: everywhere (`registry.search_folders`).
        ahead: A body already being read, or None.
    """

    def __init__(self, search: Path | None = None, ahead: Future[BodyModel | None] | None = None) -> None:
        self._search, self._ahead = search, ahead
        self._by_path: dict[Path, BodyModel] = {}
        self._lock = threading.Lock()

    def find(self, *, kind: str = "smplx", gender: str = "neutral") -> BodyModel:
        """The body for a new fit. Raises InputError if it is missing; the message says which file to put where."""
        return self._read(find_body(model=kind, gender=gender, search=self._search))

    def check(self, *, kind: str, gender: str) -> None:
        """Raise InputError saying which file to put where, if there is no such body."""
        find_body(model=kind, gender=gender, search=self._search)

    def of(self, record: BodyRecord) -> BodyModel:
        """The body that a run was fitted with. Raises InputError if it is missing or was replaced, so the run cannot be
        shown."""
        if (known := self._known(record.hash) or former_body(record.hash)) is not None:
            return known
        path = Path(record.source)
        body = self._read(path) if record.source and path.is_file() else None
        if body is None or record.hash not in ("", body.hash):
            body = self.find(kind=record.kind, gender=record.gender)
        if record.hash not in ("", body.hash):
            raise InputError(
                f"The {record.gender} {record.kind} body of this run is missing (found another one at "
                f"{body.source}). Put {record.source or 'the file'} back, or run the fit again."
            )
        return body

    def of_reference(self, reference: Reference) -> BodyModel | None:
        """The body that a reference poses, None if it only has points. Raises InputError as `of`."""
        if reference.body is None:
            return None
        record = reference.body
        return self._known(record.hash) or body_of(record, search=self._search)

    def _known(self, digest: str) -> BodyModel | None:
        with self._lock:
            body = None if self._ahead is None else self._ahead.result()
            if body is not None and body.source is not None:
                self._by_path[body.source.resolve()] = body
            self._ahead = None
            return next((b for b in self._by_path.values() if b.hash == digest), None)

    def _read(self, path: Path) -> BodyModel:
        path = path.resolve()
        with self._lock:
            if path not in self._by_path:
                self._by_path[path] = load_body(path)
            return self._by_path[path]
