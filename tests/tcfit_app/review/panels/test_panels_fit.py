"""The panel Fit: what is entered gets into the run, what is wrong is told and fits nothing, and what is drawn."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import viser

from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera, FocalFrom, Vertical
from fitting_core.config.schema import PRESETS
from fitting_core.config.settings import changed
from fitting_core.config.toml import as_toml
from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.gestures.fitting import camera_of
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.panels.fit.fit_settings import PRESET_LINES, ROWS, differences, nearest_preset
from tcfit_app.review.tab.state import FitSettings
from tests.drivers.lone_page import LonePage, tiny_page
from tests.samples.sessions import QUICK


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[LonePage]:
    with tiny_page(panel_server, tmp_path / "p", tiny_body, FitPanel) as made:
        yield made


def test_what_is_entered_is_in_the_run(tested: LonePage):
    page = tested.page
    tested.enter("Smoothness (w_T)", "42.5")
    tested.enter("Mode", "sliding window")
    tested.enter("Window", "3")
    tested.enter("Focal length", "1000")
    tested.click("Fit everything")
    (job,) = page.tab.session.jobs.values()
    assert job.run is not None
    tested.until(lambda: not page.tab.session.jobs)
    run = page.tab.session.project.runs.get(job.run)
    assert run.state == "finished"
    assert run.config == changed(
        QUICK, {"temporal.weight": 42.5, "temporal.mode": "sliding_window", "temporal.window_size": 3}, origin=""
    )
    clip, camera = page.tab.session.project.clip.camera, page.tab.session.fits.fit(run).camera
    assert camera.focal == (1000.0, pytest.approx(1000 * clip.focal[1] / clip.focal[0]))
    assert camera.center == clip.center and "review" in camera.source
    assert page.tab.look().b.camera == camera  # pyright: ignore
    page.tab.set(frames=range(2, 4))
    jobs, submit = [], page.tab.session.worker.submit
    page.tab.session.worker.submit = lambda job: jobs.append(job) or submit(job)  # pyright: ignore
    tested.click("Fit frames 2–3")
    assert jobs[0].job.clip.camera == camera, "it is fitted again as its own camera sees it"
    tested.until(lambda: not page.tab.session.jobs)
    rerun = page.tab.session.fits.runs[-1]
    assert (rerun.kind, rerun.frames, rerun.parent) == ("frames", range(2, 4), run.id)
    assert page.tab.session.fits.fit(rerun).camera == camera


def test_the_focal_length_is_that_of_the_clips_camera_now(tested: LonePage):
    """Detection and camera files change it."""
    project = tested.page.tab.session.project
    project.set_camera(replace(project.clip.camera, focal=(777.0, 777.0)))
    tested.draw()
    assert tested.field("Focal length").value == "777"


@pytest.mark.parametrize(
    ("label", "value", "said"),
    [
        ("Window", "1", "Window is 1; expected a whole number, 2 to "),
        ("Window", "500", "Window is 500; expected a whole number, 2 to {frames} (the clip has {frames} frames)."),
        ("Window", "2.5", "Window is 2.5; expected a whole number"),
        ("Smoothness (w_T)", "1e9", "Smoothness (w_T) is 1e9; expected a number, 0 to 100,000."),
        ("Smoothness (w_T)", "-1", "Smoothness (w_T) is -1; expected a number, 0 to 100,000."),
        ("Smoothness (w_T)", "nan", "Smoothness (w_T) is nan; expected"),
        ("Smoothness (w_T)", " ", "Smoothness (w_T) is empty; expected"),
        ("Frames for body shape", "0", "Frames for body shape is 0; expected a whole number, 1 to {frames}"),
        ("Focal length", "0", "Focal length is 0; expected a number, 1 to 1,000,000 (pixels)."),
        ("Gender", "male", "no male smplx body. Put &lt;SMPLX&gt;.npz there."),
        ("Height (cm)", "17", "Height (cm) is 17; expected a number, 50 to 250 (leave it empty if unknown)."),
        ("Height (cm)", "tall", "Height (cm) is tall; expected a number, 50 to 250"),
    ],
)
def test_a_wrong_value_is_told_and_fits_nothing(tested: LonePage, label: str, value: object, said: str):
    said = said.format(frames=tested.page.tab.length)
    tested.enter(label, value)
    assert said in tested.html()
    assert tested.field(label).value == value, "it stays, to be put right"
    assert tested.button("Fit everything").disabled
    tested.page.tab.do(lambda: tested.press("action", "fit"))  # by its key
    assert tested.notices and tested.notices[-1].kind == "error"
    assert not tested.page.tab.session.jobs and not tested.page.tab.session.fits.runs
    tested.enter("Preset", "tcfit")
    assert said not in tested.html()
    if label != "Gender":
        assert tested.field(label).value != value
    assert not tested.page.tab.state.settings.problems


def test_the_height_is_the_projects_and_fits_have_it(tested: LonePage):
    tab, session = tested.page.tab, tested.page.tab.session
    tested.enter("Height (cm)", "172")
    tested.enter("Preset", "smplifyx")
    tested.draw()
    assert tested.field("Height (cm)").value == "172" and session.project.height == 172
    assert "Back to the preset" not in tested.html(), "it is the person's, and no change of the method"
    tab.set(settings=replace(tab.state.settings, config=replace(QUICK, height=172.0), preset="paper"))
    tested.click("Fit everything")
    tested.until(lambda: session.fits.runs and not session.jobs)
    (run,) = session.fits.runs
    mean, by_betas = session.bodies.of(run.body).height
    betas = session.fits.fit(run).last.params.betas[0].numpy()
    assert run.config.height == 172 and mean + by_betas @ betas == pytest.approx(1.72, abs=0.03)
    with Project.open(session.project.folder, read_only=True) as project:
        assert project.height == 172
    tested.enter("Height (cm)", "")
    assert tab.state.settings.config.height is None and session.project.height is None


def test_a_fit_starts_from_a_run_and_has_its_shape(tested: LonePage):
    tab, session, first = tested.page.tab, tested.page.tab.session, tested.fit()
    tested.draw()
    tested.enter("Start from", first.name)
    tested.enter("Held near (m)", "0.05")
    tested.enter("Same person as", first.name)
    said = f"The next fit starts from {first.name}, held within about 5 cm of it and uses the shape of {first.name}."
    assert said in tested.html()
    tested.click("Fit everything")
    tested.until(lambda: len(session.fits.runs) == 2 and not session.jobs)
    run = session.fits.runs[-1]
    fit, before = session.fits.fit(run), session.fits.fit(first)
    assert run.given == tab.state.settings.given and run.config.start_deviation == 0.05
    assert fit.start is not None and fit.start.about.source == first.name
    assert torch.equal(fit.last.params.betas, before.last.params.betas)
    assert f"shape as given from {first.name}" in fit.warnings
    tested.enter("Start from", "nothing: only the clip")
    tested.enter("Held near (m)", "")
    assert tab.state.settings.config.start_deviation is None
    tab.set(b=FitChoice(run=first.id))
    tested.press("action", "rerun_shape")
    tested.until(lambda: len(session.fits.runs) == 3 and not session.jobs)
    again = session.fits.runs[-1]
    assert (again.kind, again.given) == ("shape", Given(shape=Source(run=first.id)))
    assert torch.equal(session.fits.fit(again).last.params.betas, before.last.params.betas)


def test_a_shape_from_a_file_is_told_and_its_problems(tested: LonePage, tmp_path: Path):
    tab, session = tested.page.tab, tested.page.tab.session
    tested.enter("Same person as", "a file …")
    assert "Path of the shape is empty; expected" in tested.html() and tested.button("Fit everything").disabled
    assert tested.field("Path of the shape").visible
    tested.enter("Path of the shape", str(tmp_path / "nothing.npz"))
    assert "does not exist" in tested.html()
    wrong = tmp_path / "wrong.npz"
    np.savez(wrong, numbers=np.zeros(3))
    tested.enter("Path of the shape", str(wrong))
    assert not tested.button("Fit everything").disabled
    assert tab.state.settings.given == Given(shape=Source(path=str(wrong)))
    tested.click("Fit everything")
    tested.settle()
    assert not session.fits.runs and "wrong.npz" in tested.notices[-1].text and tested.notices[-1].kind == "error"


def test_a_start_from_a_file_that_a_run_had_is_shown(tested: LonePage):
    tab = tested.page.tab
    tab.set(settings=replace(tab.state.settings, given=Given(start=Source(path="theirs.npz"))))
    tested.draw()
    assert tested.field("Start from").value == "theirs.npz"
    tested.enter("Start from", "nothing: only the clip")
    assert tab.state.settings.given == Given()


def test_a_calibration_becomes_the_projects_camera(tested: LonePage, tmp_path: Path):
    session, before = tested.page.tab.session, tested.page.tab.session.project.clip
    path = tmp_path / "scene.toml"
    matrix = [[1111.0, 0.0, before.camera.size[0] / 2], [0.0, 1112.0, before.camera.size[1] / 2], [0.0, 0.0, 1.0]]
    sections = [
        f'[{name}]\nname = "{name}"\nsize = {[float(side) for side in before.camera.size]}\nmatrix = {matrix}\n'
        f"distortions = [{bent}, 0.0, 0.0, 0.0]\nrotation = [1.2, 0.0, 0.0]\ntranslation = [0.0, 500.0, 3000.0]\n"
        "fisheye = false\n"
        for name, bent in (("straight", 0.0), ("bent", -0.1))
    ]
    path.write_text("\n".join(sections))

    def use(**fields: str) -> str:
        for label, value in fields.items():
            tested.enter(label.replace("_", " "), value)
        tested.click("Use this camera")
        tested.settle()
        return tested.notices[-1].text

    assert "Type where the camera file is" in use()
    assert "has 2 cameras (straight, bent)" in use(Camera_file=str(path))
    assert "Unit is ten" in use(Unit="ten")
    assert "camera file scene.toml, camera straight" in use(Camera_name="straight", Unit="0.001")
    camera = session.project.clip.camera
    assert camera.focal == (1111.0, 1112.0) and camera.world is not None and camera.world.translation == (0.0, 0.5, 3.0)
    html = tested.html()
    assert "1111.0 px, camera file scene.toml, camera straight" in html and "z is up" in html
    use(Camera_name="bent")
    bent = session.project.clip
    assert bent.camera.lens is not None and not np.array_equal(bent.keypoints.xy, before.keypoints.xy)
    tested.fit()
    assert "This camera's lens differs from the project" in use(Camera_name="straight")
    assert session.project.clip.camera == bent.camera


def test_a_preset_sets_everything_and_changes_are_named(tested: LonePage):
    tested.enter("Preset", "tcfit")
    assert tested.page.tab.state.settings.config == PRESETS["tcfit"] and "Back to the preset" not in tested.html()
    tested.enter("Smoothness (w_T)", "5")
    tested.enter("Frames for body shape", "3")
    assert "Changed from the preset: frames for body shape, smoothness (w_T)" in tested.html()
    tested.click("Back to the preset")
    tested.draw()
    assert tested.page.tab.state.settings.config == PRESETS["tcfit"]
    assert tested.field("Smoothness (w_T)").value == "100" and tested.field("Frames for body shape").value == "15"


def test_all_settings_as_a_text(tested: LonePage):
    text = tested.field("TOML").value
    assert text == as_toml(QUICK, preset_name="paper")
    tested.enter("TOML", text.replace("hand_components = 12", "hand_components = 6"))
    tested.click("Use these settings")
    assert tested.page.tab.state.settings.config == replace(QUICK, hand_components=6)
    tested.draw()
    tested.enter("TOML", "hand_components = 99")
    tested.click("Use these settings")
    assert "hand_components is 99" in tested.notices[-1].text
    tested.enter("TOML", "[weights\n")
    tested.click("Use these settings")
    assert "is not TOML" in tested.notices[-1].text
    assert tested.page.tab.state.settings.config == replace(QUICK, hand_components=6)


def test_typing_on_is_not_overwritten(tested: LonePage):
    """Two values come in before the drawing thread takes the first."""
    waiting: list = []
    tested.page.tab._do = waiting.append
    tested.enter("Smoothness (w_T)", "1")
    tested.enter("Smoothness (w_T)", "12")
    waiting.pop(0)()
    tested.draw()
    assert tested.field("Smoothness (w_T)").value == "12"
    waiting.pop(0)()
    tested.draw()
    assert (
        tested.field("Smoothness (w_T)").value == "12" and tested.page.tab.state.settings.config.temporal.weight == 12.0
    )


def test_a_number_that_is_being_typed_stays_as_it_is(tested: LonePage):
    for typed, value in (("5.", 5.0), ("1e2", 100.0), ("0.50", 0.5)):
        tested.enter("Smoothness (w_T)", typed)
        tested.draw()
        assert (
            tested.field("Smoothness (w_T)").value == typed
            and tested.page.tab.state.settings.config.temporal.weight == value
        )


def test_every_field_has_a_hint_and_numbers_their_range(tested: LonePage):
    for name in (
        "Preset",
        *(row.label for row in ROWS.values()),
        "Body model",
        "Gender",
        "Focal length",
    ):
        assert tested.field(name).hint, name
    for name in ("Smoothness (w_T)", "Window", "Frames for body shape", "Focal length"):
        assert " to " in tested.field(name).hint, name


def test_cancel_and_what_remains_to_be_seen(tested: LonePage):
    session = tested.page.tab.session
    tested.enter("TOML", as_toml(replace(QUICK, settings=replace(QUICK.settings, iterations=500)), preset_name="paper"))
    tested.click("Use these settings")
    tested.click("Fit everything")
    tested.click("Fit everything")
    tested.until(lambda: next(iter(session.jobs.values())).progress)
    assert "first pass" in tested.html() and "waiting" in tested.html()
    tested.click("Cancel all 2")
    tested.until(lambda: not session.jobs)
    assert [run.state for run in session.fits.runs] == ["cancelled"] * 2
    shown = tested.html()
    assert "cancelled" in shown and "fit.cancel" not in shown


def test_a_failure_is_told_and_its_row_says_why(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object, **__: object) -> None:
        raise MemoryError("no <b>memory</b>")

    with monkeypatch.context() as broken:
        broken.setattr("tcfit_app.fitting.jobs.fit_events", fail)
        tested.click("Fit everything")
        tested.until(lambda: not tested.page.tab.session.jobs)
    assert "MemoryError: no <b>memory</b>" in tested.notices[-1].text
    tested.press("fits.show", f"{tested.page.tab.session.fits.runs[-1].id}")
    assert "MemoryError: no &lt;b&gt;memory&lt;/b&gt;" in tested.html()


def test_b_goes_over_to_the_corrections_of_the_run_that_it_was_set_to(tested: LonePage):
    page, run = tested.page, tested.fit()
    other = tested.fit()
    page.tab.set(b=FitChoice(run=run.id), selection=(4,))
    page.gestures.correcting.toggle_bad()
    page.tab.look()
    assert page.tab.state.b.run == run.id, "not before they are fitted"
    assert "Fit is following the edit" in [chip.text for chip in page.header.status.messages(0.0, "")]
    tested.until(lambda: page.tab.look() and page.tab.state.b.run != run.id)
    corrections = page.tab.session.fits.run(page.tab.state.b.run)  # pyright: ignore[reportArgumentType]
    assert corrections is not None and (corrections.kind, corrections.parent) == ("corrections", run.id)
    page.tab.set(b=FitChoice(run=other.id))
    page.tab.look()
    assert page.tab.state.b.run == other.id, "what was chosen since stays"


def test_the_main_button_follows_the_selected_frames(tested: LonePage):
    tab = tested.page.tab
    shown = lambda label: tested.draw() is not None and tested.field(label).visible  # noqa: E731
    assert "Fit the body to them." in tested.html() and shown("Height (cm)")
    assert tested.html().count('data-value="fit"') == 1
    tab.set(frames=range(2, 4))
    assert "Fit everything" in tested.html(), "there is nothing to fit again"
    tested.fit()
    assert "Fit frames 2–3" in tested.html() and "Fit everything</span>" not in tested.html()
    assert not shown("Height (cm)") and not shown("Frames for body shape"), "a part keeps the shape"
    tab.set(frames=None)
    assert "Fit everything" in tested.html() and shown("Height (cm)") and shown("Frames for body shape")


def test_presets_are_told_apart():
    assert PRESET_LINES.keys() == PRESETS.keys()
    for name, config in PRESETS.items():
        assert nearest_preset(config) == name and not differences(config, name)
    assert FitSettings().preset == nearest_preset(FitSettings().config)


def test_a_right_pair_of_body_and_gender_settles_what_a_wrong_one_blocked(
    tested: LonePage, monkeypatch: pytest.MonkeyPatch
):
    session = tested.page.tab.session
    known = {("smplx", "neutral"), ("smpl", "female")}

    def check(*, kind: str, gender: str) -> None:
        if (kind, gender) not in known:
            raise InputError(f"there is no {gender} {kind}")

    monkeypatch.setattr(type(session.bodies), "check", lambda self, **pair: check(**pair))
    for kind, gender in (("smpl", "female"), ("smplx", "neutral")):
        tested.enter("Body model", kind)
        assert tested.page.tab.state.settings.problems, "the pair is wrong meanwhile"
        with pytest.raises(InputError, match="there is no"):
            tested.page.gestures.fitting.refuse_wrong_settings()
        tested.enter("Gender", gender)
        assert tested.page.tab.state.settings.problems == ()
        tested.page.gestures.fitting.refuse_wrong_settings()


def test_another_problem_stays_while_the_body_is_put_right(tested: LonePage):
    tested.enter("Window", "-3")
    tested.enter("Gender", "female")
    tested.enter("Gender", "neutral")
    assert [name for name, _ in tested.page.tab.state.settings.problems] == ["temporal.window_size"]


def test_a_height_given_in_one_tab_is_that_of_the_others(tested: LonePage):
    tab = tested.page.tab
    tab.session.project.set_height(183.0)  # as another tab does
    tested.draw()
    assert tab.state.settings.config.height == 183.0
    tested.draw()
    assert tested.field("Height (cm)").value == "183"
    tab.session.project.set_height(None)
    tested.draw()
    assert tab.state.settings.config.height is None


def test_settings_without_effect_cannot_be_changed_and_are_not_told(tested: LonePage):
    tested.enter("Mode", "all frames at once")
    tested.draw()
    assert not tested.field("Window").visible and not tested.field("Smoothness (w_T)").disabled
    tested.enter("Mode", "sliding window")
    tested.draw()
    assert tested.field("Window").visible
    config = changed(PRESETS["tcfit"], {"temporal.mode": "global", "temporal.window_size": 21}, origin="")
    assert "temporal.window_size" not in differences(config, "paper")
    config = changed(config, {"temporal.mode": "sliding_window"}, origin="")
    assert "temporal.window_size" in differences(config, "paper")
    sample = {"shape_sample.size": 3, "shape_sample.seed": 9}
    config = changed(config, {**sample, "shape_sample.strategy": "random"}, origin="")
    assert {"shape_sample.size", "shape_sample.seed"} <= {*differences(config, "paper")}
    assert not {"shape_sample.size", "shape_sample.seed"} & {*differences(config, "paper", frames=1)}


def test_a_vertical_is_of_its_focal_length():
    """A focal length that the user types keeps it only if it is nearly the estimated one."""
    seen = Camera(
        focal=(1469.0, 1469.0),
        center=(640.0, 360.0),
        size=(1280, 720),
        focal_from=FocalFrom.ESTIMATED,
        focal_deviation=0.06,
        vertical=Vertical(up=(0.0, -1.0, 0.0), deviation=1.2),
    )
    for focal, kept in ((1500.0, True), (900.0, False)):
        given = camera_of(FitSettings(focal=focal), seen)
        assert (given.focal[0], given.focal_deviation, given.calibrated) == (focal, None, True)
        assert (given.vertical is not None) == kept
