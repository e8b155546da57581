"""`tcfit review`: open a project, or make one of a clip, and show it in the browser."""

import logging
from pathlib import Path

import torch

from fitting_core.config import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.errors import InputError
from tcfit_app.app import ReviewApp
from tcfit_app.bodies import Bodies
from tcfit_app.new_command import is_project, make_project
from tcfit_app.options import ReviewOptions, ServerOptions
from tcfit_app.project import Project
from tcfit_app.server import review_server, tell
from tcfit_app.session import Session
from tcfit_app.storage.lock import ProjectLocked


def run_review(options: ReviewOptions) -> None:
    """Serve the review until Ctrl-C.

    Raises:
        InputError: There is no such project, it cannot be made, or nothing can listen at the address.
    """
    with opened(options) as project:
        review(project, options.server, models=options.models, fit=PRESETS[DEFAULT_PRESET] if options.fit else None)


def review(
    project: Project, options: ServerOptions, *, models: Path | None = None, fit: FitConfig | None = None
) -> None:
    """Serve the review of an open project until Ctrl-C.

    Args:
        project: stays open.
        options: address and browser.
        models: folder with body models that alone is searched.
        fit: what to start with if the project has no fit; None: nothing.
    """
    torch.set_num_threads(1)  # the fits, in a thread of their own, need the other cores
    _log_warnings()
    session = Session(project, Bodies(models))
    title = f"tcfit: {project.clip.name}"
    server = review_server(title, host=options.host, port=options.port, open_browser=options.browser)
    with server as running:
        app = ReviewApp(session, running.viser)
        try:
            if fit is not None and not session.fits.runs and not project.read_only:
                session.fit_everything(fit, kind="smplx", gender="neutral")
            app.run()
        except KeyboardInterrupt:
            tell("Ending the review ...")
        finally:
            app.close()
    tell(f"The review has ended. Everything is saved in {project.folder}")


def _log_warnings() -> None:
    """Warnings and errors to the terminal, of all loggers, whatever their own level."""
    handler = logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    logging.basicConfig(format="tcfit: %(message)s", handlers=[handler])


def opened(options: ReviewOptions) -> Project:
    """The project that the options name: opened, made of a clip, or read-only if somebody else has it."""
    if options.video is not None and is_project(options.video):
        folder = options.video
        if options.keypoints is not None:
            raise InputError(f"{folder} is a project, which has its keypoints: leave out --keypoints.")
    else:
        folder = make_project(options, reopen=True)
    return open_project(folder, read_only=options.read_only)


def open_project(folder: Path, *, read_only: bool = False) -> Project:
    """Open a project, read-only if somebody else has it, and say so. Raises InputError as `Project.open`."""
    try:
        return Project.open(folder, read_only=read_only)
    except ProjectLocked as error:
        tell(f"{error} It opens read-only here: nothing can be changed.")
        return Project.open(folder, read_only=True)
