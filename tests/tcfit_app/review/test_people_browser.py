"""Several people of one clip: each can be gone to and worked on, the others are drawn beside them."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import INDEX
from tests.drivers.review_page import Reviewing, opened, reviewed_people, serving
from tests.drivers.waiting import until
from tests.samples.people_projects import FRAMES, LATE, open_two, two_people

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

pytestmark = pytest.mark.thorough

WRIST = INDEX["right_wrist"]


@pytest.fixture(scope="module")
def review(browser: "Browser", free_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reviewing]:
    folder = two_people(tmp_path_factory.mktemp("people") / "talk", free_body)
    with open_two(folder) as people, serving("talk", lambda server: reviewed_people(people, server)) as served:
        yield opened(*served, browser)


def person(review: Reviewing) -> str:
    return review.page.tab.someone.name


def button(review: Reviewing) -> "Locator":
    """The header's, which opens the menu of the people."""
    return review.tab.locator("[data-tcfit='header.person']")


def choose(review: Reviewing, name: str) -> None:
    """In the header's menu."""
    button(review).click()
    review.tab.get_by_role("menuitemradio", name=name, exact=True).click()
    until(lambda: person(review) == name, name)


def state(review: Reviewing, name: str) -> dict[str, Any]:
    # The page's script may still be on its way, after a reload.
    look = "(name) => (window.tcfit?.state ? tcfit.state(name) : null)"
    return until(lambda: review.tab.evaluate(look, name), name)


def names(review: Reviewing) -> list[str]:
    return review.tab.locator(".tcfit-person:visible").all_inner_texts()


def back(review: Reviewing) -> None:
    """To the first person, from the first frame on."""
    review.app.post(lambda: review.page.tab.go_to(review.app.people[0]))
    until(lambda: person(review) == "person 1")
    review.app.post(lambda: review.page.tab.set(frame=0, selection=(), mode="edit", others=True))
    until(lambda: state(review, "cursor")["frame"] == 0)


def test_the_header_swaps_the_person(review: Reviewing):
    back(review)
    assert state(review, "timeline")["first_frame"] == 0
    until(lambda: button(review).is_visible(), "the header")
    review.app.post(lambda: review.page.tab.seek(LATE + 2))
    until(lambda: state(review, "cursor")["frame"] == LATE + 2)
    choose(review, "person 2")
    until(lambda: state(review, "timeline")["first_frame"] == LATE, "the other timeline")
    until(lambda: state(review, "cursor")["frame"] == 2, "the same moment")
    mine = review.app.people[1].session.project.corrected.xy[2, WRIST]
    until(lambda: state(review, "keypoints")["xy"][WRIST] == pytest.approx(mine, abs=0.01), "the other keypoints")
    until(lambda: button(review).inner_text() == "Person 2 of 2 ▾", "the header")
    choose(review, "person 1")
    until(lambda: state(review, "timeline")["length"] == FRAMES, "the timeline of before")
    until(lambda: button(review).inner_text() == "Person 1 of 2 ▾", "the header")
    assert not review.complaints


def test_a_press_on_a_name_goes_to_that_person(review: Reviewing):
    back(review)
    until(lambda: names(review) == [], "nobody else is there yet")
    review.app.post(lambda: review.page.tab.seek(LATE))
    until(lambda: names(review) == ["person 2"], "the name")
    review.tab.locator(".tcfit-person").click()
    until(lambda: person(review) == "person 2")
    until(lambda: names(review) == ["person 1"], "the other name")
    review.press("q", lambda: person(review) == "person 1")


def test_the_others_are_drawn_until_they_are_switched_off(review: Reviewing):
    back(review)
    review.app.post(lambda: review.page.tab.seek(LATE))

    def drawn() -> set[str]:
        scene = review.page.tab.client.scene._handle_from_node_name
        nodes = (f"{root}/body{i}" for root in ("/posters/0", "/posters/side", "/space/filmed") for i in (0, 2))
        return {name for name in nodes if name in scene and scene[name].visible}

    until(lambda: {"/posters/0/body0", "/posters/0/body2"} <= drawn(), "both people")
    review.app.post(lambda: review.page.tab.set(mode="space"))
    until(lambda: {"/space/filmed/body0", "/space/filmed/body2"} <= drawn(), "both people in 3D")
    until(lambda: names(review) == [], "no names in 3D")
    review.app.post(lambda: review.page.tab.set(mode="edit"))
    review.tab.get_by_role("button", name="How the body is drawn").click()
    review.tab.get_by_role("menuitemcheckbox", name="Other people").click()
    review.tab.keyboard.press("Escape")
    until(lambda: "/posters/0/body2" not in drawn(), "one person")
    until(lambda: names(review) == [], "no names")
    assert "/posters/0/body0" in drawn()


def test_a_link_of_one_person_opens_that_one_for_others(review: Reviewing, browser: "Browser"):
    back(review)
    review.tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    review.app.post(lambda: review.page.tab.go_to(review.app.people[1]))
    until(lambda: person(review) == "person 2")
    review.app.post(lambda: review.page.tab.seek(3))
    review.rest()
    review.app.post(lambda: review.page.gestures.noting.copy_link())
    link = f"{review.server.address.url}/?frame={LATE + 3}&run=1&phase=3&person=2"
    until(lambda: review.tab.evaluate("() => navigator.clipboard.readText()") == link, "the link")
    second = opened(review.app, review.server, browser)
    assert person(second) == "person 1"
    second.tab.goto(link)
    until(lambda: (person(second), second.frame) == ("person 2", 3), "what the link says")
    until(lambda: state(second, "timeline")["first_frame"] == LATE, "that one's timeline")
    second.tab.goto(f"{review.server.address.url}/?frame=5&person=9")
    second.tab.get_by_text("The link leads to person 9").wait_for()
    assert person(second) == "person 2"
    second.tab.close()
    until(lambda: len(review.app.pages) == 1)


def test_a_correction_belongs_to_the_person_on_show(review: Reviewing):
    back(review)
    review.press("q", lambda: person(review) == "person 2")
    review.rest()
    logs = [len(someone.session.project.log) for someone in review.app.people]
    x, y = review.place("right_wrist")
    mouse = review.tab.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 30, y + 10, steps=3)
    mouse.up()
    until(lambda: len(review.app.people[1].session.project.log) == logs[1] + 1, "the edit")
    assert len(review.app.people[0].session.project.log) == logs[0]
    review.press("Control+z", lambda: len(review.app.people[1].session.project.log) == logs[1] + 2)
