"""What is on show in a tab: one answer for everything that is drawn."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice, Fits
from tcfit_app.review.browser.page_events import Hello
from tests.drivers.lone_page import LonePage, sample_project


@pytest.fixture
def tested(page_of: Callable[..., LonePage], tmp_path: Path) -> LonePage:
    return page_of(sample_project(tmp_path / "walk.tcfit", "first", "second"))


@pytest.mark.parametrize(
    ("mode", "blinked", "places"),
    [
        ("edit", False, (("b",),)),
        ("edit", True, (("a",),)),
        ("ab", False, (("a",), ("b",))),
        ("ab", True, (("b",), ("a",))),
        ("space", False, (("b",),)),
        ("space", True, (("a",),)),
    ],
)
def test_bodies_have_their_places_by_mode(tested: LonePage, mode: str, blinked: bool, places: tuple):
    tested.page.tab.set(mode=mode, blinked=blinked)
    assert tested.page.tab.look().places == places


def test_in_space_a_is_there_too_on_request(tested: LonePage):
    tested.page.tab.set(mode="space", ghost=True)
    assert tested.page.tab.look().places == (("a", "b"),)


def test_a_fit_s_own_camera_is_that_of_the_room_only(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    tab = tested.page.tab
    clip = tab.session.project.clip.camera
    own = replace(clip, focal=(2 * clip.focal[0], 2 * clip.focal[1]))
    show = Fits.show
    monkeypatch.setattr(Fits, "show", lambda self, choice: replace(show(self, choice), camera=own))  # pyright: ignore
    cameras = []
    for mode in ("edit", "ab", "space"):
        tab.set(mode=mode)
        cameras.append(tab.look().camera)
    assert cameras == [clip, clip, own]


def test_a_fit_that_cannot_be_read_is_told_and_the_other_is_there(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    tab, (first, second) = tested.page.tab, tested.page.tab.session.fits.runs
    tab.set(mode="ab", a=FitChoice(run=first.id), b=FitChoice(run=second.id))
    show = Fits.show

    def damaged(self: Fits, choice: FitChoice) -> object:
        if choice.run == first.id:
            raise InputError("runs/000001.npz is damaged.")
        return show(self, choice)

    monkeypatch.setattr(Fits, "show", damaged)
    shown = tab.look()
    assert shown.a is None and shown.b is not None and shown.problem == "runs/000001.npz is damaged."
    assert "runs/000001.npz is damaged." in [one.text for one in tested.page.header.status.messages(0.0, shown.problem)]


def test_it_is_resolved_once_for_all_that_is_drawn(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    page, asked = tested.page, []
    page.receive(Hello("a tab", 1000, 700))
    page.draw(0.0)
    show = Fits.show
    monkeypatch.setattr(Fits, "show", lambda self, choice: asked.append(choice) or show(self, choice))
    page.draw(0.1)
    assert asked == [page.tab.state.b]
