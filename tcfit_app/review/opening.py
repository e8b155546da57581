"""What every review needs before it begins, whether of one project or of many."""

import gc
import logging
import threading
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from tcfit_app.project.storage.lock import ProjectLocked
from tcfit_app.server.serving import tell

if TYPE_CHECKING:
    from tcfit_app.project.project import Project


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


def prepare_fits() -> None:
    """Let fits of this process leave room for the drawing, and have their kernels compiled beside it."""
    import torch

    from fitting_core.fit.fused import ready

    torch.set_num_threads(1)  # the fits, in threads of their own, need the other cores
    # Until then they are computed in torch.
    threading.Thread(target=ready.prepare, args=(tell,), daemon=True).start()


def log_warnings() -> None:
    """Warnings and errors of all loggers to the terminal, at any level of their own."""
    handler = logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    logging.basicConfig(format="tcfit: %(message)s", handlers=[handler])


def open_project(folder: Path, *, read_only: bool = False) -> "Project":
    """Open a project, read-only with a message if another process has it. Raises InputError as `Project.open`."""
    from tcfit_app.project.project import Project

    try:
        return Project.open(folder, read_only=read_only)
    except ProjectLocked as error:
        tell(f"{error} It opens read-only here: nothing can be changed.")
        return Project.open(folder, read_only=True)
