"""Pictures of the review app in every mode, panel and state, from a real browser, to be looked at.

A copy of a fitted project is opened in Debian's Chromium, with WebGL in software. Each scene is a function that brings
the app into states and yields a name for each; the picture is taken then.
"""

import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, progress, start
from evaluation.synthetic.demo_clip import make_demo
from evaluation.synthetic.studio.studio import CAMERA, VIEW
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.other_views import read_view
from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX, Keypoints
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.imports.keypoint_jobs import ImportFiles
from tcfit_app.project.edits.remarks import WriteNote
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.panels import PANELS
from tcfit_app.review.session.session import Session
from tests.drivers.browser import chromium
from tests.drivers.review_page import Reviewing, reviewing, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Theme = Literal["dark", "light"]
TITLE = "tcfit: demo"
REST_MS = 1500
"""For what has no sign of its own that it is drawn."""
QUALITY = 85
"""Of the JPEGs."""
KEYPOINT = "right_elbow"
"""That is dragged."""
DRAWN = "() => { try { return Boolean(tcfit.place(0, 0)); } catch { return false; } }"
"""Whether the page has posters."""


@dataclass(frozen=True, kw_only=True)
class Screenshots:
    """What to open, and what to take pictures of."""

    project: Path
    """A project with a finished fit and its video; it is copied."""
    out: Path
    """Folder for the pictures: WIDTHxHEIGHT-THEME/NAME.jpg."""
    windows: tuple[tuple[int, int], ...] = ((1440, 900), (1920, 1080))
    scenes: tuple[str, ...] = ()
    """Only these."""
    themes: tuple[Theme, ...] = ("dark", "light")
    """As the system may have it."""
    frame: int = 30
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def settle(review: Reviewing, *, busy: bool = False) -> None:
    """Wait until everything is drawn; `busy`: a fit is running and will not come to an end."""
    review.tab.wait_for_timeout(REST_MS)
    if not busy:
        until(lambda: not review.session.jobs and not review.session.edit_follower.busy, "the fits")
    if review.page.tab.state.mode != "space":
        until(lambda: review.tab.evaluate(DRAWN), "the picture")
    review.tab.wait_for_timeout(REST_MS)


def show(review: Reviewing, **state: Any) -> None:
    """Bring the tab to a state."""
    review.app.post(lambda: review.page.tab.set(**state))
    settle(review, busy=bool(review.session.jobs))


def open_panel(review: Reviewing, title: str) -> None:
    """Bring a panel to the front."""
    review.tab.get_by_role("tab", name=re.compile(rf"^\s*{title}\s*$")).click()
    settle(review, busy=bool(review.session.jobs))


def fitted(review: Reviewing) -> Shown:
    """The fit of the project."""
    shown = review.session.fits.show(FitChoice())
    if shown is None:
        raise InputError("This project has no fit: fit it first, by `tcfit review PROJECT --fit`.")
    return shown


def void(result: object) -> None:
    """Forget a result."""


# --- scenes ---


def modes(review: Reviewing) -> Iterator[str]:
    """Edit, Compare and 3D; colours by distance; the window of keys; a lost connection."""
    yield "edit"
    x, y = review.place(KEYPOINT)
    review.tab.mouse.move(x, y)
    settle(review)
    yield "edit-hover"
    review.tab.mouse.move(5, 500)
    show(review, selection=(INDEX[KEYPOINT],))
    review.tab.keyboard.press("z")
    settle(review)
    yield "edit-zoomed"
    review.tab.keyboard.press("f")
    settle(review)
    show(review, selection=(), mode="ab")
    yield "ab"
    show(review, difference=True)
    yield "ab-distance"
    show(review, mode="space", difference=False)
    yield "space"
    review.tab.keyboard.press("f")
    settle(review)
    yield "space-whole"
    show(review, ghost=True)
    yield "space-ghost"
    show(review, mode="edit", ghost=False)
    review.tab.keyboard.press("h")
    settle(review)
    yield "keys"
    review.tab.keyboard.press("Escape")
    until(lambda: not review.tab.locator("[role=dialog]").count(), "the end of the window of keys")
    review.tab.evaluate("() => tcfit.receive('lost', true)")
    settle(review)
    yield "lost"
    review.tab.evaluate("() => tcfit.receive('lost', null)")


def compared(review: Reviewing) -> Iterator[str]:
    """The other ways to see two fits, and what shows the evidence."""
    show(review, mode="ab", wipe=True)
    yield "wipe"
    show(review, wipe=False)
    review.press("e", lambda: review.page.tab.state.close_up == "right_hand")
    settle(review)
    yield "close-up"
    review.press("f", lambda: review.page.tab.state.close_up is None)
    show(review, mode="edit", outline=True)
    yield "outline"
    show(review, outline=False)


def depth(review: Reviewing) -> Iterator[str]:
    """The side view from all sides with a line of sight, and a drag in it."""
    wrist = INDEX["right_wrist"]
    for side in ("left", "top", "right"):
        show(review, selection=(wrist,), side_from=side)
        yield side
    x, y = until(lambda: review.tab.evaluate("(joint) => tcfit.placeOfFit(joint, 1)", wrist), "the wrist")
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x - 30, y, steps=8)
    until(lambda: review.session.edit_follower.live is not None, "the live correction")
    settle(review, busy=True)
    yield "dragged"
    review.tab.keyboard.press("Escape")
    review.tab.mouse.up()
    show(review, selection=())


def timeline(review: Reviewing) -> Iterator[str]:
    """A difference and hand phases; menus; notes and flags in their lanes."""
    show(review, plots=("reprojection", "between_runs", "hand_phases"))
    yield "rows"
    session, author = review.session, review.page.tab.author
    review.app.post(lambda: session.project.marks.set(range(40, 52), "flag", author=author))
    note = WriteNote(frames=tuple(range(20, 34)), text="The left hand is hidden here")
    review.app.post(lambda: session.project.append(note, author=author))
    show(review, frames=range(60, 81), frame=70)
    yield "marked"
    box = review.tab.locator(".tcfit-strip").bounding_box()
    assert box is not None
    review.tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + 36, button="right")
    settle(review)
    yield "menu"
    review.tab.keyboard.press("Escape")
    x, y = review.place("nose")
    review.tab.mouse.click(x, y, button="right")
    settle(review)
    yield "keypoint-menu"
    review.tab.keyboard.press("Escape")
    show(review, frames=None, selection=(), plots=("reprojection", "jitter"))


def correcting(review: Reviewing) -> Iterator[str]:
    """A keypoint under the pointer, with the body following; what the panel says afterwards."""
    open_panel(review, "Correct")
    yield "correct-none"
    x, y = review.place(KEYPOINT)
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x + 14, y + 30, steps=8)
    until(lambda: review.session.edit_follower.live is not None, "the live correction")
    settle(review, busy=True)
    yield "edit-dragged"
    review.tab.mouse.up()
    settle(review)
    yield "keypoints"
    review.press("x", lambda: review.session.project.corrected.bad[review.frame].any())
    show(review, frames=range(review.frame - 6, review.frame + 9))
    review.tab.keyboard.press("t")
    settle(review)
    yield "keypoints-bad"
    open_panel(review, "Correct")
    show(review, frames=None, selection=())
    yield "corrected"


def panels(review: Reviewing) -> Iterator[str]:
    """Every panel of a fitted project."""
    for panel in PANELS:
        open_panel(review, panel.title)
        if panel.title == "Review":
            until(lambda: review.page.gestures.reviewing.suspects is not None, "the review queue")
            settle(review)
        yield f"panel-{panel.title.lower()}"


def given(review: Reviewing) -> Iterator[str]:
    """What a fit starts from, whose shape it has, the camera file; and a run that began so."""
    shown, tab = fitted(review).run, review.page.tab
    told = Given(start=Source(run=shown.id), shape=Source(run=shown.id))
    open_panel(review, "Fit")
    review.tab.get_by_text("▸ All settings").click()
    show(review, settings=replace(tab.state.settings, given=told))
    review.tab.get_by_text("Start from").scroll_into_view_if_needed()
    settle(review)
    yield "start"
    wrong = (("shape", "Path of the shape is empty; expected the path of a file or folder."),)
    show(review, settings=replace(tab.state.settings, given=Given(shape=Source()), problems=wrong))
    yield "shape-file"
    show(review, settings=replace(tab.state.settings, given=Given(), problems=()))
    use = review.tab.get_by_role("button", name="Use this camera")
    if not use.is_visible():
        review.tab.get_by_text("▸ Camera").click()
    use.scroll_into_view_if_needed()
    settle(review)
    yield "camera"


def fitting(review: Reviewing) -> Iterator[str]:
    """A whole fit, frames that are fitted again by a sliding window, and one that fails."""
    session, app = review.session, review.app
    shown = fitted(review)
    open_panel(review, "Fit")
    app.post(lambda: void(session.fit_everything(PRESETS["tcfit"], kind="smplx", gender="neutral")))
    until(lambda: any(job.progress and job.progress.fraction > 0.05 for job in session.jobs.values()), "the fit")
    settle(review, busy=True)
    yield "fitting"
    app.post(session.cancel)
    until(lambda: not session.jobs, "the end of the fit")
    sliding = replace(shown.run.config, temporal=PRESETS["paper"].temporal)
    frames = range(review.frame - 20, review.frame + 40)
    app.post(lambda: void(session.rerun_frames(shown, sliding, (frames,))))
    until(lambda: any(job.windows for job in session.jobs.values()), "the first windows")
    settle(review, busy=True)
    yield "fitting-frames"
    app.post(session.cancel)
    until(lambda: not session.jobs, "the end of the fit")
    # The next run's result cannot be written where a folder lies.
    (session.project.folder / "runs" / f"{max(run.id for run in session.fits.runs) + 1:06d}.npz").mkdir()
    few = (range(review.frame, review.frame + 4),)
    app.post(lambda: void(session.rerun_frames(shown, shown.run.config, few)))
    until(lambda: not session.jobs, "the failure")
    review.tab.wait_for_timeout(REST_MS)
    yield "failed"


def errors_of_body(review: Reviewing) -> list[float]:
    """The body's reprojection errors in the timeline, pixels."""
    return review.tab.evaluate("() => tcfit.state('rows').rows[0].curves[0].values")


def documentation(review: Reviewing) -> Iterator[str]:
    """Those of the documentation's pages, in the order of the first correction."""
    yield "opened"
    x, y = review.place(KEYPOINT)
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x + 14, y + 30, steps=8)
    until(lambda: review.session.edit_follower.live is not None, "the live correction")
    review.tab.mouse.up()
    open_panel(review, "Correct")
    yield "edit"
    review.press("Control+z", lambda: not review.session.project.corrected.edited.any())
    open_panel(review, "Review")
    suspects = until(lambda: review.page.gestures.reviewing.suspects, "the review queue")
    (swapped,) = (s for s in suspects if "arms" in s.reason.lower())
    review.app.post(lambda: review.page.gestures.reviewing.show(swapped))
    settle(review)
    yield "suspicious"
    show(review, frames=range(58, 65))
    review.press("i", lambda: review.session.project.corrected.edited[58:65].any())
    settle(review)
    until(lambda: errors_of_body(review)[60] < 6, "the curve of the corrected fit")
    until(lambda: review.page.tab.data.queue(cast(Shown, review.page.tab.shown.b)), "that fit's queue")
    settle(review)
    yield "corrected"
    review.press("Control+z", lambda: not review.session.project.corrected.edited.any())
    settle(review)
    open_panel(review, "Fit")
    show(review, frames=None, selection=(), mode="ab", difference=True, frame=112)
    yield "compare"
    show(review, mode="space", difference=False)
    yield "space"


def first_look(review: Reviewing) -> Iterator[str]:
    """The project as it opens, and its panels."""
    settle(review)
    yield "correct"
    for panel in PANELS[1:]:
        open_panel(review, panel.title)
        yield panel.title.lower()


def two_views(review: Reviewing) -> Iterator[str]:
    """The clip from a second side, with the body over it, and a keypoint that is selected there."""
    (view,) = review.session.project.views
    open_panel(review, "Fit")
    show(review, side_from=view.id, frame=40)
    yield "fit"
    open_panel(review, "Correct")
    show(review, selection=(INDEX["right_wrist"],), in_view=True)
    yield "selected"


def starting(review: Reviewing) -> Iterator[str]:
    """A project without keypoints: what it offers, with its groups open, and an import that fails."""
    settle(review)
    yield "start"
    for group in ("Camera", "Import keypoints"):
        review.tab.get_by_role("button", name=group).click()
    settle(review)
    yield "groups"
    review.tab.get_by_role("button", name="Detector").click()
    settle(review)
    yield "detectors"
    review.app.post(lambda: review.session.source.begin(ImportFiles(path=Path("no/such/folder"))))
    until(lambda: not review.session.source.busy, "the failure")
    settle(review)
    yield "failed"
    for title in ("Correct", "Fit"):
        open_panel(review, title)
        yield title.lower()


# --- projects ---


def as_it_is(project: Path, folder: Path) -> Path:
    """A copy."""
    return Path(shutil.copytree(project, folder / "demo.tcfit"))


def without_fit(project: Path, folder: Path) -> Path:
    """The clip alone."""
    with Project.open(project, read_only=True) as source:
        Project.create(folder / "demo.tcfit", source.clip).close()
    return folder / "demo.tcfit"


def without_keypoints(project: Path, folder: Path) -> Path:
    """The video alone."""
    with Project.open(project, read_only=True) as source:
        shape = source.clip.keypoints.xy.shape
        nothing = Keypoints(xy=np.zeros(shape), confidence=np.zeros(shape[:2]))
        Project.create(folder / "demo.tcfit", replace(source.clip, keypoints=nothing)).close()
    return folder / "demo.tcfit"


def with_second_view(project: Path, folder: Path) -> Path:
    """The demo project, fitted together with a video of the same person from another side at another frame rate."""
    wide = replace(CAMERA, focal=(1000.0, 1000.0), center=(270.0, 270.0), size=(540, 540))
    second = make_demo(
        folder, frame_rate=30.0, camera=wide, view=replace(VIEW, azimuth=-48.0, distance=3.9, height=1.4)
    )
    with Project.open(as_it_is(project, folder)) as made:
        view = read_view(made.clip, second.video, second.keypoints, camera=CameraOptions(focal_length=wide.focal[0]))
        made.add_view(replace(view, clip=replace(view.clip, name="second phone")), copy_media=True)
        session = Session(made, Bodies())
        session.fit_everything(PRESETS["tcfit"], kind="smplx", gender="neutral")
        while session.jobs:
            session.take_news()
            time.sleep(0.1)
        session.close()
    return folder / "demo.tcfit"


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A project, and what is done with it."""

    shots: Callable[[Reviewing], Iterator[str]]
    make: Callable[[Path, Path], Path] = as_it_is
    """Makes the project, given the user's and a new folder."""
    read_only: bool = False


SCENES = {
    "modes": Scene(shots=modes),
    "compared": Scene(shots=compared),
    "depth": Scene(shots=depth),
    "timeline": Scene(shots=timeline),
    "correcting": Scene(shots=correcting),
    "panels": Scene(shots=panels),
    "given": Scene(shots=given),
    "fitting": Scene(shots=fitting),
    "docs": Scene(shots=documentation),
    "read-only": Scene(shots=first_look, read_only=True),
    "two-views": Scene(shots=two_views, make=with_second_view),
    "no-fit": Scene(shots=first_look, make=without_fit),
    "no-keypoints": Scene(shots=starting, make=without_keypoints),
}
"""By what their pictures' names begin with."""


def take(options: Screenshots, name: str, window: tuple[int, int], theme: Theme, browser: "Browser") -> None:
    """Take the pictures of one scene."""
    out = options.out / f"{window[0]}x{window[1]}-{theme}"
    out.mkdir(parents=True, exist_ok=True)
    scene = SCENES[name]
    with tempfile.TemporaryDirectory() as folder:
        project = scene.make(options.project, Path(folder))
        with reviewing(project, browser, read_only=scene.read_only, title=TITLE) as review:
            review.tab.emulate_media(color_scheme=theme)
            review.tab.set_viewport_size({"width": window[0], "height": window[1]})
            show(review, frame=options.frame)
            for shot in scene.shots(review):
                review.tab.screenshot(path=out / f"{name}-{shot}.jpg", type="jpeg", quality=QUALITY)
                progress(f"{out.name}/{name}-{shot}.jpg")
            for complaint in review.complaints:
                progress(f"{name}: the browser's console says: {complaint}")


def run(options: Screenshots) -> None:
    """Takes all pictures."""
    if unknown := set(options.scenes) - set(SCENES):
        raise InputError(f"--scenes {' '.join(sorted(unknown))}: expected some of {', '.join(SCENES)}.")
    with chromium() as browser:
        for window in options.windows:
            for theme in options.themes:
                for name in options.scenes or SCENES:
                    take(options, name, window, theme, browser)


if __name__ == "__main__":
    start(Screenshots, run)
