"""`tcfit review`: open a project, or make one of a clip, and show it in the browser."""

import logging
import sys
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.app import ReviewApp
from tcfit_app.bodies import Bodies
from tcfit_app.new_command import make_project, project_folder
from tcfit_app.options import ReviewOptions
from tcfit_app.project import Project
from tcfit_app.server import review_server, tell
from tcfit_app.session import Session
from tcfit_app.storage import database
from tcfit_app.storage.lock import ProjectLocked


def run_review(options: ReviewOptions) -> None:
    """Serve the review until Ctrl-C.

    Raises:
        InputError: There is no such project, it cannot be made, or nothing can listen at the address.
        KeyboardInterrupt: The user ended it; everything done is on the disk.
    """
    with opened(options) as project:
        review(project, options)


def review(project: Project, options: ReviewOptions, *, fit: bool = False) -> None:
    """Serve the review of an open project until Ctrl-C.

    Args:
        project: stays open.
        options: address, browser and body models.
        fit: start a fit if the project has none.
    """
    logging.basicConfig(level=logging.WARNING, format="tcfit: %(message)s")
    session = Session(project, Bodies(options.models))
    title = f"tcfit: {project.clip.name}"
    server = review_server(title, host=options.host, port=options.port, open_browser=options.browser)
    with server as running:
        app = ReviewApp(session, running.viser)
        try:
            if fit and not session.fits.runs:
                app.fit_by_default()
            app.run()
        finally:
            app.close()


def opened(options: ReviewOptions) -> Project:
    """The project that the options name: opened, made of a clip, or read-only if somebody else has it."""
    folder = options.video if options.video is not None and is_project(options.video) else None
    if folder is not None and options.keypoints is not None:
        raise InputError(f"{folder} is a project, which has its keypoints: leave out --keypoints.")
    if folder is None:
        made = project_folder(options)
        folder = made if options.video is None or is_project(made) else make_project(options)
    try:
        return Project.open(folder, read_only=options.read_only)
    except ProjectLocked as error:
        tell(f"{error} It opens read-only here: nothing can be changed.")
        return Project.open(folder, read_only=True)


def is_project(path: Path) -> bool:
    """Whether a path is a project's folder."""
    return (path / database.NAME).is_file()
