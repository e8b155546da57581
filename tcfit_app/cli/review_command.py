"""`tcfit review`: open a project, or make one of a clip, and show it in the browser.

What the page's server can do without is imported while the browser loads the page: torch takes two seconds.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from fitting_core.clips.options import ClipOptions
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.detect.detectors import DETECTORS
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from tcfit_app.options.fit import NO_KEYPOINTS, ReferenceOptions, ReviewOptions, ServerOptions, height_of
from tcfit_app.project.storage.database import NAME, Database, is_project
from tcfit_app.project.storage.run_record import newest_body
from tcfit_app.review.browser.channel import web_files
from tcfit_app.review.opening import load_app, log_warnings, open_project, prepare_fits
from tcfit_app.server.gate import Entry
from tcfit_app.server.gated_viser import TalkingSite
from tcfit_app.server.serving import ReviewServer, review_server, tell

if TYPE_CHECKING:
    from fitting_core.body.model import BodyModel
    from fitting_core.clip import OtherView
    from tcfit_app.project.people import OpenPeople
    from tcfit_app.project.project import Project
    from tcfit_app.review.early_tabs import EarlyTabs
    from tcfit_app.review.session.session import Session


def run_review(options: ReviewOptions) -> None:
    """Serve the review until Ctrl-C. Raises InputError if there is no such project, it cannot be made, or nothing can
    listen at the address."""
    check_folders(options.server, models=options.models)
    entry_of(options.server)  # report errors before a project is made
    if options.video is None and options.keypoints is None:
        raise InputError("Nothing to review; expected a project, a video, keypoints or a folder of clips.")
    fit = PRESETS[DEFAULT_PRESET] if options.fit else None
    find = None if options.keypoints == NO_KEYPOINTS else options.clip
    if options.video is not None and is_project(options.video):
        _review_project(options, options.video, fit, find)
        return
    from fitting_core.io.people_file import holds_people, read_people_file
    from tcfit_app.home.found import PROJECT_SUFFIX

    if options.video is not None and options.video.suffix == PROJECT_SUFFIX and not options.video.exists():
        raise InputError(f"{options.video} does not exist; expected a project's folder.")
    if (made := _of_result(options.video)) is not None:
        _review_project(options, made, fit, find)
        return
    if options.video is not None and is_list(options):
        _review_many(options)
        return
    if options.video is not None and holds_people(options.video):
        with _served(read_people_file(options.video).name, options.server) as server:
            load_app()
            with _people(options) as people:
                project = people.chosen(options.clip.person)
                _review(project, server, options.server, models=options.models, fit=fit, people=people)
        return
    with opened(options) as project:
        _take(project, options)
        review(project, options.server, models=options.models, fit=fit, find=find)


def _review_project(options: ReviewOptions, folder: Path, fit: FitConfig | None, find: ClipOptions | None) -> None:
    options = replace(options, video=folder)
    with _served(folder.stem, options.server) as server:
        from tcfit_app.review.early_tabs import EarlyTabs

        early, body = EarlyTabs(server.viser, folder), body_ahead(folder)
        load_app()
        with opened(options) as project:
            _take(project, options)
            _review(project, server, options.server, models=options.models, fit=fit, body=body, find=find, early=early)


def _of_result(path: Path | None) -> Path | None:
    """The project of a result's folder, which is made beside it if missing; None for anything else."""
    from tcfit_app.home.catalogue import project_beside
    from tcfit_app.home.found import as_result

    clip = None if path is None else as_result(path.resolve())
    if clip is None:
        return None
    if (known := project_beside(clip)) is None:
        from tcfit_app.home.fitting import make_project

        known = make_project(clip)
        tell(f"Made the project {known} from the result {path}")
    return known


def review(
    project: "Project",
    options: ServerOptions,
    *,
    models: Path | None = None,
    fit: FitConfig | None = None,
    find: ClipOptions | None = None,
    plays: bool = False,
) -> None:
    """Serve the review of an open project until Ctrl-C.

    If it has no fit, `fit` is begun; if it has no keypoints either, they are found as `find` says (None: neither).
    With `plays`, pages open with the clip playing.
    """
    with _served(project.clip.name, options) as server:
        _review(project, server, options, models=models, fit=fit, find=find, plays=plays)


def check_folders(options: ServerOptions, *, models: Path | None = None) -> None:
    """Raise InputError for paths that are not folders, before anything is made or fitted. Arguments as of `review`."""
    if options.files is not None and not options.files.is_dir():
        raise InputError(f"--files {options.files}: is not a folder.")
    if models is not None and not models.is_dir():
        raise InputError(f"--models {models}: is not a folder.")


def is_list(options: ReviewOptions) -> bool:
    """Whether the path is a folder of clips, or an empty one for clips, and not a clip itself."""
    from fitting_core.io.people_file import holds_people
    from fitting_core.video.images import image_files
    from tcfit_app.home.found import find

    folder = options.video
    if folder is None or options.keypoints is not None or not folder.is_dir():
        return False
    if is_project(folder) or holds_people(folder) or (folder / "images").is_dir() or (folder / "keypoints").is_dir():
        return False
    return not any(folder.iterdir()) or (not image_files(folder) and bool(find(folder.resolve())))


def _review_many(options: ReviewOptions) -> None:
    """Serve the list of a folder's clips until Ctrl-C."""
    from tcfit_app.home.home import Home
    from tcfit_app.options.clip_input import clip_options

    root = options.video
    assert root is not None
    plain = ReviewOptions()
    ones = {"--out": options.out, "--height": options.height, "--read-only": options.read_only, "--fit": options.fit}
    given = [name for name, value in ones.items() if value] + clip_options(options)
    given += ["--reference"] * (options.truth != plain.truth) + ["--copy-video"] * options.copy_video
    given += ["--other-view"] * bool(options.views.other_view)
    if given:
        raise InputError(
            f"{root} contains many clips, and {', '.join(given)} is for one: leave it out, or name one clip."
        )
    home = Home(root, files=options.server.files, models=options.models)
    try:
        with _served(home.catalogue.root.name, options.server, home) as server:
            log_warnings()
            home.run(server, _load_all)
    except KeyboardInterrupt:
        tell("Closing the review ...")
    finally:
        home.close()
    tell(f"Review closed. Everything is saved in {home.catalogue.root}")


def _load_all() -> None:
    """Import the app after the list is shown, because both at once would take twice as long."""
    load_app()
    prepare_fits()


def _served(name: str, options: ServerOptions, site: TalkingSite | None = None) -> AbstractContextManager[ReviewServer]:
    return review_server(
        name,
        host=options.host,
        port=options.port,
        open_browser=options.browser,
        scripts=web_files(),
        entry=entry_of(options),
        site=site,
    )


def entry_of(options: ServerOptions) -> Entry:
    """Access for browsers on other computers. Raises InputError if the password cannot be read or is too short, or the
    public address is invalid."""
    public = (options.public or "").rstrip("/").lower()
    parts = urlsplit(public)
    if public and (
        parts.scheme not in ("http", "https") or not parts.netloc or public != f"{parts.scheme}://{parts.netloc}"
    ):
        raise InputError(
            f"--public {options.public}: expected an address such as https://fits.example.org, without a path."
        )
    if options.password_file is None:
        return Entry(public=public)
    try:
        text = regular_file(options.password_file).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"--password-file {options.password_file}: cannot be read ({error}).") from error
    password = next(iter(text.splitlines()), "")
    if len(password) < _SHORTEST:
        raise InputError(
            f"--password-file {options.password_file}: its first line has {len(password)} characters; expected "
            f"{_SHORTEST} or more."
        )
    return Entry(password=password, public=public)


_SHORTEST = 12
"""Minimum number of characters of a password."""


def _review(
    project: "Project",
    server: ReviewServer,
    options: ServerOptions,
    *,
    models: Path | None,
    fit: FitConfig | None,
    body: "Future[BodyModel | None] | None" = None,
    people: "OpenPeople | None" = None,
    find: ClipOptions | None = None,
    plays: bool = False,
    early: "EarlyTabs | None" = None,
) -> None:
    load_app()
    from tcfit_app.fitting.bodies import Bodies
    from tcfit_app.review.app import ReviewApp
    from tcfit_app.review.session.session import Session

    prepare_fits()
    log_warnings()
    bodies = Bodies(models, body)
    sessions = [Session(one, bodies) for one in ([project] if people is None else [one for _, one in people.projects])]
    session = next(one for one in sessions if one.project is project)
    app = ReviewApp(
        session, server.viser, files=options.files, people=people, sessions=sessions, plays=plays, early=early
    )
    try:
        for one in sessions:
            if fit is not None and (why_not := _begun(one, fit, find)):
                tell(f"--fit: no fit was started, because {one.project.folder.name} {why_not}.")
        app.run()
    except KeyboardInterrupt:
        tell("Closing the review ...")
    finally:
        app.close()
    folder = project.folder if people is None else people.folder
    tell("Review closed." + ("" if project.read_only else f" Everything is saved in {folder}"))


def _begun(session: "Session", fit: FitConfig, find: ClipOptions | None) -> str:
    """Begin a first fit. Returns the reason if that is impossible, as the end of a sentence."""
    if session.project.read_only:
        return "is open read-only"
    if session.fits.showable():  # one that was cancelled early has nothing to show
        return "has fits already"
    if fit.height is None:
        fit = replace(fit, height=session.project.height)
    if session.project.has_detections:
        session.fit_everything(fit, kind="smplx", gender="neutral")
    elif find is None:
        return "has no keypoints. Detect them in the panel Start"
    elif (known := DETECTORS.get(find.detector)) is not None and not known.is_here():
        return "has no keypoints, and the detector is not installed. Download it in the panel Start"
    else:
        session.find_and_fit(find.detector, fit, person=find.person)
    return ""


def _take(project: "Project", options: ReviewOptions) -> None:
    """Store the given height, reference and other views in the project."""
    from tcfit_app.cli.new_command import reference_given

    height, reference = height_of(options), reference_given(options.truth, project.clip)
    views = _new_views(project, options)
    if height is not None:
        project.set_height(height)
    if reference is not None:
        project.set_reference(reference)
    for view in views:
        tell(view.sentence())
        project.add_view(view, copy_media=options.copy_video)


def _new_views(project: "Project", options: ReviewOptions) -> "list[OtherView]":
    """The given other views that the project does not have."""
    from fitting_core.video.fingerprint import fingerprint
    from tcfit_app.cli.progress import DetectionShown
    from tcfit_app.options.clip_input import with_views

    there = {fingerprint(view.media.path) for view in project.views if view.media.path is not None}
    if all(fingerprint(video) in there for video in options.views.other_view):
        return []
    project.refuse_read_only()
    with DetectionShown() as tell_progress:
        views = with_views(replace(project.clip, views=()), options, tell_progress).views
    return [view for view in views if view.clip.source is None or fingerprint(view.clip.source) not in there]


def opened(options: ReviewOptions) -> "Project":
    """Open the project, make it of a clip first, or open it read-only if another process has it open."""
    from tcfit_app.options.clip_input import check_not_new

    if options.video is not None and is_project(options.video):
        folder = options.video
        check_not_new(folder, options)
    else:
        from tcfit_app.cli.new_command import make_project

        folder = make_project(options, reopen=True)
    return open_project(folder, read_only=options.read_only)


def _people(options: ReviewOptions) -> AbstractContextManager["OpenPeople"]:
    """The projects in a folder of several people, opened."""
    from tcfit_app.options.clip_input import check_not_new
    from tcfit_app.project.people import opened_people

    folder = options.video
    assert folder is not None
    check_not_new(folder, options, allowed="--person")
    ones = {
        "a reference": options.truth != ReferenceOptions(),
        "a height": options.height is not None,
        "another view": bool(options.views.other_view),
    }
    if what := next((name for name, given in ones.items() if given), None):
        raise InputError(
            f"{folder} contains several people, and {what} is for one: open that person's project with it."
        )
    return opened_people(folder, lambda one: open_project(one, read_only=options.read_only), tell)


# --- reading ahead while torch is loaded, which keeps one core busy for two seconds ---


def body_ahead(project: Path) -> "Future[BodyModel | None]":
    """The body of a project's newest run, read by a thread; None if it is missing or cannot be read.

    Its user then reads it again and reports the error.
    """
    pool = ThreadPoolExecutor(1, "tcfit reads ahead")
    try:
        return pool.submit(_newest_body, project)
    finally:
        pool.shutdown(wait=False)


def _newest_body(project: Path) -> "BodyModel | None":
    from fitting_core.body.files.reading import load_body

    try:
        with closing(Database(project / NAME, read_only=True)) as database:
            source = newest_body(database)
        return load_body(Path(source)) if source else None
    except InputError:
        return None
