"""What a review needs first, read while torch is being loaded, which keeps one core busy for two seconds."""

import gc
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.project.storage.database import NAME, Database
from tcfit_app.project.storage.runs import newest_body


def body_ahead(project: Path) -> Future[BodyModel | None]:
    """The body of a project's newest run, read by a thread; None if there is none, or if it cannot be read.

    Whoever needs it then reads it again, and is told why that fails.
    """
    pool = ThreadPoolExecutor(1, "tcfit reads ahead")
    try:
        return pool.submit(_newest_body, project)
    finally:
        pool.shutdown(wait=False)


def load_app() -> None:
    """Import all that serves a project.

    No garbage is looked for meanwhile, and what there is now is left out of it for good: 220,000 objects, torch's most
    of all, which stay (0.3 s of a start, and 0.17 s of each full collection, for which a frame would wait).
    """
    gc.disable()
    try:
        for name in ("torch", "tcfit_app.project.project", "tcfit_app.review.app"):
            import_module(name)
    finally:
        gc.freeze()
        gc.enable()


def _newest_body(project: Path) -> BodyModel | None:
    try:
        database = Database(project / NAME, read_only=True)
        try:
            source = newest_body(database)
        finally:
            database.close()
        return load_body(Path(source)) if source else None
    except InputError:
        return None
