"""The people of a clip without a browser: opening, leaving out, locks, and who can be seen by whom."""

import itertools
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import msgspec
import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.io.people_file import read_people_file, write_people_file
from tcfit_app.cli.main import main
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.edits.kinds import MarkBad, MoveKeypoint, Reset, SetDepth, TakeOver, check
from tcfit_app.project.edits.packed_points import packed
from tcfit_app.project.people import opened_people
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.lock import ProjectLocked
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.browser.page_events import GoToPerson, Hello, OpenLink, Press
from tcfit_app.review.browser.page_states import StepsRead
from tcfit_app.review.drawing.rows import MOST_ROWS, PLOTS
from tcfit_app.review.opening import open_project
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.session.session import Session
from tcfit_app.review.tab.people import ReviewedPerson
from tests.samples.people_projects import FRAMES, LATE, open_two, two_people


@pytest.fixture(scope="module")
def talk(free_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return two_people(tmp_path_factory.mktemp("people") / "talk", free_body)


@pytest.fixture
def folder(talk: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(talk, tmp_path / "talk"))


@contextmanager
def reviewed(folder: Path, server: viser.ViserServer) -> Iterator[ReviewApp]:
    """An app with one client, which nobody is connected to."""
    with open_two(folder) as people:
        bodies = Bodies()
        sessions = [Session(project, bodies) for _, project in people.projects]
        app = ReviewApp(sessions[0], MagicMock(), people=people, sessions=sessions)
        client = MagicMock()
        client.gui, client.scene, client.client_id = server.gui, server.scene, 1
        client.camera.image_width, client.camera.image_height = 1000, 700
        try:
            app._open(client)
            app._obey(0.0)
            yield app
        finally:
            app.close()
            server.gui.reset()


@pytest.fixture
def app(folder: Path, panel_server: viser.ViserServer) -> Iterator[ReviewApp]:
    with reviewed(folder, panel_server) as made:
        yield made


def hello(app: ReviewApp, tab: str) -> None:
    app._receive(1, Hello(tab=tab, width=1000, height=700))
    app._obey(0.0)


def test_each_person_counts_frames_from_the_own_first(app: ReviewApp):
    one, other = app.people
    assert one.all_people == other.all_people == (one, other)
    assert [one.frame_of(n) for n in (-1, 0, FRAMES - 1, FRAMES)] == [None, 0, FRAMES - 1, None]
    assert [other.frame_of(n) for n in (LATE - 1, LATE)] == [None, 0]


def test_going_to_somebody_keeps_the_moment_and_the_looks_and_not_what_is_the_other_s(app: ReviewApp):
    hello(app, "mine")
    first = app.pages[1]
    first.tab.set(frame=7, frames=range(6, 9), selection=(4,), opacity=0.3, plots=("depth",), playing=True)
    first.receive(GoToPerson(1))
    second = app.pages[1]
    assert second is not first and second.tab.someone.name == "person 2"
    state = second.tab.state
    assert (state.frame, state.opacity, state.plots) == (7 - LATE, 0.3, ("depth",))
    assert (state.frames, state.selection, state.playing, first.tab.state.playing) == (None, (), False, False)
    second.tab.set(selection=(7,), opacity=0.5)
    second.receive(GoToPerson(0))
    assert app.pages[1] is first, "what was begun there goes on"
    assert (first.tab.state.selection, first.tab.state.opacity) == ((4,), 0.5)
    first.tab.seek(1)
    first.receive(GoToPerson(1))
    assert app.pages[1].tab.state.frame == 0, "as near as the other is there"


def test_rows_that_a_browser_remembers_are_those_that_there_are(app: ReviewApp):
    usual = app.pages[1].tab.state.plots
    app.pages[1].receive(Hello(tab="a", width=1000, height=700, plots=("depth", "gone", "depth", "reprojection")))
    assert app.pages[1].tab.state.plots == ("depth", "reprojection")
    app.pages[1].receive(Hello(tab="b", width=1000, height=700, plots=(*PLOTS,)))
    assert app.pages[1].tab.state.plots == (*PLOTS,)[:MOST_ROWS] != usual


def test_what_to_do_first_is_told_until_it_was_read_whoever_is_shown(app: ReviewApp):
    told = MagicMock()
    app.pages[1].tab.channel.ask = told
    app.pages[1].receive(Hello(tab="mine", width=1000, height=700, hinted=False))
    app.pages[1].receive(GoToPerson(1))
    assert app.pages[1].tab.state.steps
    app.pages[1]._draw_panels(0.0)
    app.pages[1].receive(Press("steps.read", ""))
    assert [type(call.args[0]) for call in told.call_args_list] == [StepsRead]
    app.pages[1].receive(GoToPerson(0))
    assert not app.pages[1].tab.state.steps


def test_the_demo_opens_with_the_clip_playing(app: ReviewApp):
    for tab, plays in (("mine", True), ("mine", False), ("other", False)):
        app.pages[1].tab.plays = tab == "mine"
        app.pages[1].receive(Hello(tab=tab, width=1000, height=700))
        assert app.pages[1].tab.state.playing == plays, "not after a reload"


def test_a_tab_that_is_loaded_again_shows_whom_it_has_shown(app: ReviewApp):
    hello(app, "mine")
    app.pages[1].receive(GoToPerson(1))
    client = app.pages[1].tab.client
    app._close(1)
    app._open(client)
    assert app.pages[1].tab.someone.name == "person 1"
    hello(app, "mine")
    assert app.pages[1].tab.someone.name == "person 2"
    app._close(1)
    app._open(client)
    hello(app, "another")
    assert app.pages[1].tab.someone.name == "person 1"


def test_whoever_is_not_there_cannot_be_gone_to(app: ReviewApp):
    hello(app, "mine")
    page = app.pages[1]
    for number in (2, 999):
        page.receive(GoToPerson(number))
    page.receive(GoToPerson(0))
    assert app.pages[1] is page


def test_a_link_leads_to_its_person(app: ReviewApp):
    hello(app, "mine")

    def follow(link: OpenLink) -> list[str]:
        """What is told."""
        app.pages[1].tab.notify = MagicMock()
        app.pages[1].tab.receive(link)
        app._obey(0.0)
        app._obey(0.0)
        return [call.args[0].text for call in app.pages[1].tab.notify.call_args_list]

    def place() -> tuple[str, int]:
        return app.pages[1].tab.someone.name, app.pages[1].tab.state.frame

    assert follow(OpenLink(frame=6, run=1, phase=2, person=2)) == [] and place() == ("person 2", 6 - LATE)
    assert app.pages[1].tab.state.b == FitChoice(run=1, phase=2)
    assert app._first.remembered["mine"].b == FitChoice(), "the other's fit is what it was"
    assert follow(OpenLink(frame=8)) == [] and place() == ("person 2", 8 - LATE), "whoever is shown"
    assert follow(OpenLink(frame=1, person=1)) == [] and place() == ("person 1", 1)
    for forged in (0, 3, 2**53):
        (told,) = follow(OpenLink(frame=5, person=forged))
        assert f"person {forged}; this clip has 1 (person 1), 2 (person 2)" in told and place() == ("person 1", 1)
    (told,) = follow(OpenLink(frame=1, person=2))
    assert "this clip has frames 4 to 11" in told


def test_a_link_means_the_same_person_where_another_cannot_be_opened(folder: Path, panel_server: viser.ViserServer):
    shutil.rmtree(folder / "person-1")
    with reviewed(folder, panel_server) as app:
        hello(app, "mine")
        page, asked = app.pages[1], MagicMock()
        page.tab.channel.ask = asked
        page.gestures.noting.copy_link()
        assert [call.args[0].person for call in asked.call_args_list] == [2]
        assert page.tab.someone.person_with_number(2) is page.tab.someone
        with pytest.raises(InputError, match="this clip has 2 "):
            page.tab.someone.person_with_number(1)
        with pytest.raises(InputError, match="one person's project"):
            ReviewedPerson(data=page.tab.data).person_with_number(2)


def test_news_of_somebody_else_say_whose_they_are(app: ReviewApp):
    told: list[Notice] = []
    app.pages[1].tab.notify = told.append  # pyright: ignore[reportAttributeAccessIssue]
    for someone in app.people:
        someone.session.tell(Notice(title="Fit everything: done", text="", kind="done"))
    assert [notice.title for notice in told] == ["Fit everything: done", "person 2: Fit everything: done"]


def test_all_locks_are_held_until_the_end(folder: Path):
    with open_two(folder) as people:
        assert [project.read_only for _, project in people.projects] == [False, False]
        for name in ("person-1", "person-2"):
            with pytest.raises(ProjectLocked):
                Project.open(folder / name)
        with opened_people(folder, open_project, print) as others:
            assert [project.read_only for _, project in others.projects] == [True, True]
    for name in ("person-1", "person-2"):
        Project.open(folder / name).close()


def test_who_cannot_be_opened_is_told_and_left_out(folder: Path, capsys: pytest.CaptureFixture):
    shutil.rmtree(folder / "person-1")
    with open_two(folder) as people:
        assert [person.name for person, _ in people.projects] == ["person 2"]
        assert people.chosen(None) is people.chosen(2)
        for number, told in ((1, "could not be opened"), (0, "people 1 to 2"), (3, "people 1 to 2")):
            with pytest.raises(InputError, match=told):
                people.chosen(number)
    assert "person 1 was skipped" in capsys.readouterr().out
    shutil.rmtree(folder / "person-2")
    (folder / "person-2").mkdir()
    with pytest.raises(InputError, match="no person's project"), open_two(folder):
        pass


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--keypoints", "x"], "--keypoints can only be given for a new project"),
        (["--reference", "x.npz"], "a reference is for one"),
        (["--fov", "60"], "--fov can only be given for a new project"),
        (["--person", "3"], "people 1 to 2"),
    ],
)
def test_options_of_a_new_project_are_refused(talk: Path, options: list[str], told: str, capsys: pytest.CaptureFixture):
    assert main(["review", str(talk), "--no-browser", "--port", "0", *options]) == 2
    assert told in capsys.readouterr().err


def exchanged(app: ReviewApp, number: int) -> None:
    page = app.pages[1]
    page.gestures.exchanging.exchange(app.people[1 - page.tab.someone.number], number)


def test_two_people_are_exchanged_from_a_frame_on_and_undone_together(folder: Path, panel_server: viser.ViserServer):
    with reviewed(folder, panel_server) as app:
        hello(app, "mine")
        one, other = (someone.session.project for someone in app.people)
        one.append(MarkBad(frames=(10,), joints=(4,)))
        one.append(SetDepth(frames=(10,), joints=(7,), depth=((0.5,),)))
        before, theirs = one.corrected.xy.copy(), other.corrected.xy.copy()
        exchanged(app, 9)
        assert np.allclose(one.corrected.xy[9:], theirs[9 - LATE :], atol=1e-3)
        assert np.allclose(other.corrected.xy[9 - LATE :], before[9:], atol=1e-3)
        assert np.array_equal(one.corrected.xy[:9], before[:9])
        assert np.array_equal(other.corrected.xy[: 9 - LATE], theirs[: 9 - LATE])
        assert other.corrected.confidence[10 - LATE, 4] == 0, "what was bad does not count there either"
        assert not one.corrected.bad[10, 4] and np.isnan(one.corrected.depth[10, 7])
        assert app.people[1].uncertain == ()
        app.pages[1].gestures.correcting.undo()
        assert np.array_equal(one.corrected.xy, before) and one.corrected.bad[10, 4]
        assert np.array_equal(other.corrected.xy, theirs), "of both"
        assert app.people[1].uncertain == ((9, FRAMES - 1),), "as unsure as before"
        app.pages[1].receive(GoToPerson(1))
        app.pages[1].gestures.correcting.redo()
        assert np.allclose(one.corrected.xy[9:], theirs[9 - LATE :], atol=1e-3)
        assert np.allclose(other.corrected.xy[9 - LATE :], before[9:], atol=1e-3)
        app.pages[1].gestures.correcting.undo()
        assert np.array_equal(one.corrected.xy, before) and np.array_equal(other.corrected.xy, theirs)
        exchanged(app, LATE)
        kept = one.corrected.xy.copy()
    with Project.open(folder / "person-1") as again:
        assert np.array_equal(again.corrected.xy, kept), "as it was, after a restart"


def test_what_was_exchanged_counts_as_detected_but_for_what_a_person_has_placed(app: ReviewApp):
    """Else the fit would trust a detector's points as a person's, and take no mixed-up sides back."""
    one, other = (someone.session.project for someone in app.people)
    one.append(MoveKeypoint(frames=(10,), joints=(4,), xy=(((100.0, 50.0),),)))
    theirs = other.corrected.xy[10 - LATE, 7].copy()
    exchanged(app, 9)
    assert np.argwhere(other.corrected.edited).tolist() == [[10 - LATE, 4]] and not one.corrected.edited[9:].any()
    assert np.allclose(one.detected.xy[10, 7], theirs, atol=1e-3)
    one.append(MoveKeypoint(frames=(10,), joints=(7,), xy=(((1.0, 2.0),),)))
    one.append(Reset(frames=(10,), joints=(7,)))
    assert np.allclose(one.corrected.xy[10, 7], theirs, atol=1e-3), "not this one's own detection"
    for _ in range(3):
        one.undo()
    assert np.array_equal(one.detected.xy, one.detections.xy)


def test_an_exchange_is_not_undone_in_one_while_the_other_was_corrected(app: ReviewApp):
    hello(app, "mine")
    one, other = (someone.session.project for someone in app.people)
    correcting = app.pages[1].gestures.correcting
    exchanged(app, 9)
    other.append(MarkBad(frames=(6,), joints=(4,)))
    with pytest.raises(InputError, match="person 2 has been corrected or marked since"):
        correcting.undo()
    assert len(one.log) == 1
    other.undo()
    correcting.undo()
    other.append(MarkBad(frames=(6,), joints=(4,)))
    with pytest.raises(InputError, match="person 2 has been corrected or marked since"):
        correcting.redo()
    assert len(one.log) == 2


def test_half_an_exchange_is_told_where_more_was_done_after_it(folder: Path, panel_server: viser.ViserServer):
    """As it is if one of the projects is opened by itself."""
    with reviewed(folder, panel_server) as app:
        exchanged(app, 9)
        assert app.pages[1].gestures.exchanging.halves == []
    with Project.open(folder / "person-2") as opened_alone:
        opened_alone.undo()
    with Project.open(folder / "person-1") as opened_alone:
        opened_alone.append(MarkBad(frames=(6,), joints=(4,)))
    with reviewed(folder, panel_server) as app:
        hello(app, "mine")
        gestures = app.pages[1].gestures
        (told,) = gestures.exchanging.halves
        assert told.startswith("Frames 9–11 were taken over from person 2")
        assert app.people[1].uncertain == ((9, FRAMES - 1),), "not settled by half an exchange"
        for _ in range(4):  # each edit of another author asks first
            gestures.correcting.undo()
        assert gestures.exchanging.halves == []


class Disk:
    """Refuses the writes of all projects from one on, for some time."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.left, self.refused, self.error = 10**9, 0, InputError("full")
        whole = Database.transaction

        @contextmanager
        def transaction(database: Database) -> Iterator[Any]:
            self.left -= 1
            if self.left < 0 <= self.left + self.refused:
                raise self.error
            with whole(database) as connection:
                yield connection

        patch.setattr(Database, "transaction", transaction)

    def refuse(self, first: int, count: int, error: BaseException) -> None:
        """Refuse `count` writes after the next `first` ones; 0, 0: none."""
        self.left, self.refused, self.error = first, count, error


def keypoints(app: ReviewApp) -> list[np.ndarray]:
    return [someone.session.project.corrected.xy.copy() for someone in app.people]


def is_either(found: list[np.ndarray], ends: list[list[np.ndarray]]) -> bool:
    return any(all(map(np.array_equal, found, end)) for end in ends)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, 1000], ids=["one write", "all later writes"])
@pytest.mark.parametrize("what", ["exchange", "undo", "redo"])
def test_no_half_exchange_stays_whichever_write_fails_or_is_the_last_before_a_kill(
    folder: Path, panel_server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch, what: str, count: int
):
    """Two people are exchanged, undone or done again, whole or not at all."""
    monkeypatch.setattr("tcfit_app.review.tab.people.RETRY", 0.0)
    disk = Disk(monkeypatch)
    for number, error in itertools.product(range(3), (InputError("full"), KeyboardInterrupt())):
        with reviewed(folder, panel_server) as app:
            hello(app, "mine")
            correcting, group = app.pages[1].gestures.correcting, app.people[0].group
            before = keypoints(app)
            exchanged(app, 9)
            after = keypoints(app)
            if what != "undo":
                correcting.undo()
            if what == "exchange":
                app.people[0].session.project.append(MarkBad(frames=(0,), joints=(4,)))
            disk.refuse(number, count, error)
            told = suppress(KeyboardInterrupt) if number == 2 else suppress(InputError, KeyboardInterrupt)
            with told:
                {"exchange": partial(exchanged, app, 9), "undo": correcting.undo, "redo": correcting.redo}[what]()
            disk.refuse(0, 0, error)
            if isinstance(error, InputError):
                assert group is not None
                group.take_up()
                assert is_either(keypoints(app), [before, after])
        with reviewed(folder, panel_server) as app:
            assert is_either(keypoints(app), [before, after])
            assert app.pages[1].gestures.exchanging.halves == []
            while app.people[0].session.project.undoable is not None:
                app.people[0].undo(author="", shown=None)
            assert is_either(keypoints(app), [before])


def test_what_is_uncertain_later_goes_with_whom_it_is_about(folder: Path, panel_server: viser.ViserServer):
    file = read_people_file(folder)
    spans = ((6, 7), (9, 11)), ((5, 7),)
    people = tuple(
        msgspec.structs.replace(one, uncertain=uncertain) for one, uncertain in zip(file.people, spans, strict=True)
    )
    write_people_file(folder, msgspec.structs.replace(file, people=people))
    with reviewed(folder, panel_server) as app:
        hello(app, "mine")
        exchanged(app, 6)
        assert [someone.uncertain for someone in app.people] == [(), ((9, 11),)]
        app.pages[1].receive(GoToPerson(1))
        gestures = app.pages[1].gestures
        gestures.exchanging.confirm(gestures.exchanging.doubts[0])
        assert [someone.uncertain for someone in app.people] == [(), ()]
        assert [one.uncertain for one in read_people_file(folder).people] == [((6, 7),), ((5, 7),)]
        gestures.correcting.undo()
        assert [someone.uncertain for someone in app.people] == [((6, 7),), ((5, 7),)]


def test_nothing_is_exchanged_where_one_of_them_is_not_or_may_not_be_changed(app: ReviewApp):
    with pytest.raises(InputError, match="are not both there from frame 12 on"):
        exchanged(app, FRAMES)
    app.people[1].session.project._lock, held = None, app.people[1].session.project._lock
    try:
        with pytest.raises(InputError, match="read-only"):
            exchanged(app, 9)
    finally:
        app.people[1].session.project._lock = held
    assert not app.people[0].session.project.log


def test_what_is_right_is_uncertain_no_more(app: ReviewApp, folder: Path):
    hello(app, "mine")
    app.pages[1].receive(GoToPerson(1))
    page = app.pages[1]
    page.tab.set(folds=frozenset({"people"}))
    page.draw(0.0)
    panel = next(panel for panel in page.panels if isinstance(panel, ReviewPanel))
    page.tab.look()
    panel.draw()
    page.receive(Press("people.go", "0"))
    assert page.tab.state.frames == range(9 - LATE, FRAMES - LATE) and page.tab.state.frame == 9 - LATE
    page.receive(Press("people.right", "0"))
    assert page.tab.someone.uncertain == () and read_people_file(folder).people[1].uncertain == ()
    panel.draw()
    assert not page.tab.buttons.find("people.go", "0")
    page.receive(Press("people.exchange", "0"))
    assert [entry.action.source for entry in page.tab.session.project.log] == ["person 1"]
    assert page.tab.session.project.log[0].action.frames == tuple(range(9 - LATE, FRAMES - LATE))
    page.receive(Press("people.exchange", "7"))
    page.receive(Press("people.exchange", "1"))
    page.receive(Press("people.go", "5"))
    assert len(page.tab.session.project.log) == 1


def taken(xy: np.ndarray, confidence: np.ndarray) -> bytes:
    return packed(np.concatenate([xy, confidence[..., None], np.zeros((*confidence.shape, 1))], -1))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"packed": b"nothing"}, "cannot be unpacked"),
        ({"packed": taken(np.zeros((1, 1, 2)), np.zeros((1, 1)))}, "does not have one position"),
        ({"packed": zlib.compress(bytes(10**7))}, "does not have one position"),
        ({"packed": taken(np.full((2, 1, 2), np.nan), np.zeros((2, 1)))}, "a position is not a number"),
        ({"packed": taken(np.zeros((2, 1, 2)), np.full((2, 1), 1.5))}, "a confidence"),
        ({"packed": taken(np.zeros((2, 1, 2)), np.full((2, 1), np.nan))}, "a confidence"),
        ({"frames": (0, 99)}, "no frame 99"),
    ],
)
def test_keypoints_that_make_no_sense_are_not_taken_over(changes: dict[str, Any], told: str):
    edit = TakeOver(
        frames=(0, 1), joints=(4,), source="x", exchange="y", packed=taken(np.zeros((2, 1, 2)), np.ones((2, 1)))
    )
    check(edit, 6)
    with pytest.raises(InputError, match=told):
        check(msgspec.structs.replace(edit, **changes), 6)
