"""The review app as its users have it: a real browser, the demo project with few frames, a fit that runs."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
import torch

from fitting_core.detect import second_look
from fitting_core.keypoints import INDEX, PARTS
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import DetectAgain, Lock, SetDepth
from tcfit_app.project.project import Project
from tests.drivers.review_page import QUICK, Reviewing, opened, reviewing
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

WRIST, ELBOW = INDEX["right_wrist"], INDEX["left_elbow"]


@pytest.fixture(scope="module")
def review(demo_project: Path, browser: "Browser", tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reviewing]:
    """The project in a browser, after a fit that streamed in before its eyes."""
    folder = Path(shutil.copytree(demo_project, tmp_path_factory.mktemp("app") / "demo.tcfit"))
    with reviewing(folder, browser) as found:
        bodies = []
        found.app.post(lambda: found.session.fit_everything(QUICK, kind="smplx", gender="neutral"))
        until(lambda: found.session.jobs)

        def look() -> bool:
            bodies.append(found.session.fits.show(FitChoice()))
            return not found.session.jobs

        until(look, "the fit")
        shown = {shown.phase for shown in bodies if shown is not None}
        assert shown >= {1, 3}, "the phases came in one after the other"
        yield found
        assert not found.complaints


@pytest.fixture(autouse=True)
def at_ease(request: pytest.FixtureRequest) -> None:
    """Every test begins in Edit, at frame 8, with nothing selected."""
    if "review" not in request.fixturenames:
        return
    review: Reviewing = request.getfixturevalue("review")
    page = review.page
    review.tab.mouse.up()  # of a test that failed
    review.app.post(
        lambda: page.tab.set(mode="edit", frame=8, selection=(), frames=None, playing=False, blinked=False, side=True)
    )
    until(lambda: page.tab.state.frame == 8)
    review.rest()


def test_plays_pauses_and_steps(review: Reviewing):
    review.press("Space", lambda: review.frame > 10)
    assert review.page.tab.state.playing
    review.press("Space", lambda: not review.page.tab.state.playing)
    review.press("Home", lambda: review.frame == 0)
    review.press("ArrowRight", lambda: review.frame == 1)
    review.press("Shift+ArrowRight", lambda: review.frame == 11)
    review.press("ArrowLeft", lambda: review.frame == 10)
    review.press("End", lambda: review.frame == review.page.tab.length - 1)


def test_a_keypoint_is_dragged_and_the_body_follows(review: Reviewing):
    before = review.session.fits.show(FitChoice())
    assert before is not None
    was = review.session.project.corrected.xy[8, WRIST].copy()
    x, y = review.place("right_wrist")
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x - 30, y - 24, steps=6)
    until(lambda: review.session.edit_follower.live is not None, "the live correction")
    review.tab.mouse.move(x - 60, y - 48, steps=6)
    review.tab.mouse.up()
    until(lambda: review.session.project.last_edit > 0, "the edit")
    moved = review.session.project.corrected.xy[8, WRIST] - was
    assert moved == pytest.approx(np.array([-60, -48]) / review.scale(), abs=0.05)
    review.rest()
    after = review.session.fits.show(FitChoice())
    assert after is not None and after.run.kind == "corrections"
    assert not torch.equal(after.params.body_pose[8], before.params.body_pose[8])
    assert torch.equal(after.params.body_pose[20], before.params.body_pose[20])
    assert review.page.tab.state.selection == (WRIST,)
    edits = review.session.project.last_edit
    review.press("x", lambda: review.session.project.corrected.bad[8, WRIST])
    review.press("Control+z", lambda: not review.session.project.corrected.bad[8, WRIST])
    review.press("Control+z", lambda: np.array_equal(review.session.project.corrected.xy[8, WRIST], was))
    review.press("Control+Shift+z", lambda: not np.array_equal(review.session.project.corrected.xy[8, WRIST], was))
    assert review.session.project.last_edit == edits + 4


def test_a_range_is_fitted_again_with_another_weight(review: Reviewing):
    page = review.page
    review.press("BracketLeft", lambda: page.tab.state.frames is not None)
    review.press("Shift+ArrowRight", lambda: review.frame == 18)
    review.press("BracketRight", lambda: page.tab.state.frames == range(8, 19))
    settings = page.tab.state.settings
    changed = replace(QUICK, temporal=replace(QUICK.temporal, weight=500.0))
    review.app.post(lambda: page.tab.set(settings=replace(settings, config=changed)))
    runs = len(review.session.fits.runs)
    review.press("r", lambda: len(review.session.fits.runs) > runs)
    review.rest()
    run = review.session.fits.runs[-1]
    assert (run.kind, run.frames, run.state, run.config.temporal.weight) == ("frames", range(8, 19), "finished", 500.0)
    until(lambda: run.name in shown_labels(review)[0], "the new run in the view")


def test_two_fits_side_by_side(review: Reviewing):
    review.press("2", lambda: len(shown_labels(review)) == 2)
    labels = shown_labels(review)
    assert labels[0].startswith("A   Fit ") and labels[1].startswith("B   Frames 8–18"), labels
    assert labels[1].endswith("smoother (w_T 500)"), "what a range was fitted again of, and the new run"
    review.app.post(lambda: review.page.tab.set(a=FitChoice(phase=1), b=FitChoice()))
    until(lambda: "first pass" in shown_labels(review)[0] and "final" in shown_labels(review)[1], "its first phase")
    a, b = (until(lambda i=i: body_in_page(review, i), "a body") for i in (0, 1))
    assert a != b
    review.press("b", lambda: "final" in shown_labels(review)[0])
    review.press("3", lambda: review.page.tab.state.mode == "space")
    review.press("1", lambda: len(shown_labels(review)) == 1)


def wrist_in_space(review: Reviewing) -> list[float]:
    """As the page has it, in camera space."""
    return until(lambda: review.tab.evaluate("() => tcfit.state('bodies')"), "the body")["bodies"][0]["points"][WRIST]


def wrist_in_side_view(review: Reviewing) -> list[float]:
    return until(lambda: review.tab.evaluate("(joint) => tcfit.placeOfFit(joint, 1)", WRIST), "the wrist")


def test_the_side_view_shows_the_body_and_takes_clicks(review: Reviewing):
    plate = until(lambda: review.tab.evaluate(SIDE_PLATE), "the side view")
    until(lambda: seen_on(review, plate) > 0.05, "the body on its plate")
    review.press("v", lambda: review.tab.evaluate(SIDE_PLATE) is None)
    review.rest()
    assert len(shown_labels(review)) == 1 and review.page.tab.state.side is False
    review.press("v", lambda: review.tab.evaluate(SIDE_PLATE))
    review.rest()
    edits = review.session.project.last_edit
    x, y = wrist_in_side_view(review)
    review.tab.mouse.move(x, y)
    until(lambda: "the pelvis" in review.tab.locator(".tcfit-tooltip").first.inner_text(), "what is under it")
    review.tab.mouse.click(x, y)
    until(lambda: review.page.tab.state.selection == (WRIST,), "the selection")
    assert review.session.project.last_edit == edits and not review.session.edit_follower.busy


def test_a_keypoint_is_dragged_in_depth_in_the_side_view(review: Reviewing):
    until(lambda: review.tab.evaluate("() => tcfit.state('side')"), "the side view")
    review.rest()
    before, (x, y) = review.session.project.last_edit, wrist_in_side_view(review)
    depth = wrist_in_space(review)[2]
    metre = review.tab.evaluate("() => tcfit.state('side').metre") * review.scale()
    review.tab.mouse.move(x, y)
    review.tab.mouse.down()
    review.tab.mouse.move(x - 0.1 * metre, y, steps=5)  # from the right, the camera is at the left
    until(lambda: review.session.edit_follower.live is not None, "the live correction")
    review.tab.mouse.up()
    until(lambda: review.session.project.last_edit == before + 1, "the edit")
    edit = review.session.project.log[-1].action
    assert isinstance(edit, SetDepth) and (edit.frames, edit.joints) == ((8,), (WRIST,))
    review.rest()
    assert wrist_in_space(review)[2] - depth == pytest.approx(-0.1, abs=0.04)
    review.press("Control+z", lambda: np.isnan(review.session.project.corrected.depth).all())
    review.rest()


def test_a_right_click_on_a_keypoint_opens_its_menu(review: Reviewing):
    review.rest()
    x, y = review.place("right_wrist")
    review.tab.mouse.click(x, y, button="right")
    menu = review.tab.get_by_role("menu", name="right wrist")
    until(menu.is_visible, "the menu")
    until(lambda: review.page.tab.state.selection == (WRIST,), "the selection")
    menu.get_by_role("menuitem", name="Mark bad, or restore").click()
    until(lambda: review.session.project.corrected.bad[8, WRIST], "the mark")
    assert menu.count() == 0
    review.press("Control+z", lambda: not review.session.project.corrected.bad[8, WRIST])
    review.rest()


def choose(review: Reviewing, *labels: str) -> None:
    """Of the picture's menu, away from all keypoints, and of those that it opens."""
    x, y = review.tab.evaluate("(bottom) => tcfit.place(0, bottom)", review.session.project.clip.camera.size[1])
    review.tab.mouse.click(x + 12, y - 12, button="right")  # messages lie over the other corners
    for label in labels:
        review.tab.get_by_role("menuitem", name=label).click()


def test_a_right_click_beside_all_keypoints_opens_the_picture_s_menu(review: Reviewing):
    choose(review, "Bodies on or off")
    until(lambda: not review.page.tab.state.bodies, "no bodies")
    review.press("m", lambda: review.page.tab.state.bodies)


def test_in_3d_the_side_view_gives_way_to_the_room(review: Reviewing):
    review.press("3", lambda: review.tab.evaluate("() => tcfit.state('layout').mode") == "space")
    # A keypoint of the fit can be taken there too, and 3D does not turn.
    review.rest()
    edits, pose = review.session.project.last_edit, review.page.tab.scene.cameras.pose
    place = [(0.0, 0.0)]
    while place[-1] != (now := tuple(review.tab.evaluate("(joint) => tcfit.placeOfFit(joint)", WRIST))):
        place.append(now)
        review.tab.wait_for_timeout(300)
    x, y = place[-1]
    review.tab.mouse.move(x, y)
    until(lambda: "the pelvis" in review.tab.locator(".tcfit-tooltip").first.inner_text(), "what is under it")
    review.tab.mouse.down()
    review.tab.mouse.move(x - 30, y, steps=4)
    review.tab.mouse.up()
    until(lambda: review.session.project.last_edit == edits + 1, "the edit")
    assert isinstance(review.session.project.log[-1].action, SetDepth)
    assert review.page.tab.scene.cameras.pose.position == pytest.approx(pose.position)
    review.press("Control+z", lambda: np.isnan(review.session.project.corrected.depth).all())
    review.rest()
    review.press("1", lambda: review.tab.evaluate(SIDE_PLATE))


@pytest.mark.thorough
def test_a_ring_that_is_dragged_locks_the_joint(review: Reviewing):
    tab, edits = review.page.tab, review.session.project.last_edit
    tab.do(lambda: tab.set(mode="space", selection=(ELBOW,)))
    until(lambda: review.page.gestures.turning.rings(tab.shown) is not None, "the rings")
    review.rest()
    assert grabbed(review), "no place near the joint is on a ring"
    review.tab.mouse.up()
    until(lambda: review.session.project.last_edit > edits, "the edit")
    edit = review.session.project.log[-1].action
    assert isinstance(edit, Lock) and (edit.frames, edit.joints) == ((8,), (ELBOW,))
    review.press("Control+z", lambda: review.session.project.redoable is not None)


def grabbed(review: Reviewing) -> bool:
    """Press places around the joint until a ring is taken hold of, and turn it; the button is still down then."""
    for radius in range(20, 90, 5):
        for angle in np.linspace(0, 2 * np.pi, 16, endpoint=False):
            x, y = review.tab.evaluate("(joint) => tcfit.placeOfFit(joint)", ELBOW)
            at = x + radius * np.cos(angle), y + radius * np.sin(angle)
            review.tab.mouse.move(*at)
            review.tab.mouse.down()
            review.tab.wait_for_timeout(60)
            if review.page.gestures.turning._held is not None:
                review.tab.mouse.move(at[0] + 20, at[1] + 20, steps=5)
                return True
            review.tab.mouse.up()
            if review.page.tab.state.selection != (ELBOW,):  # another keypoint was met
                review.page.tab.do(lambda: review.page.tab.set(selection=(ELBOW,)))
                review.rest()
    return False


def drag(review: Reviewing, start: tuple[float, float], end: tuple[float, float]) -> None:
    """From one of the image's pixels to another."""
    for step, (x, y) in enumerate((start, end)):
        place = review.tab.evaluate("([x, y]) => tcfit.place(x, y)", [x, y])
        review.tab.mouse.move(*place, steps=1 + 3 * step)
        (review.tab.mouse.up if step else review.tab.mouse.down)()


@pytest.mark.thorough
def test_a_rectangle_is_drawn_around_a_hand(review: Reviewing, monkeypatch: pytest.MonkeyPatch):
    asked: list[dict[str, Any]] = []

    def look_again(source: Any, frames: list[int], **given: Any) -> np.ndarray:
        asked.append({"frames": frames, **given})
        points = np.zeros((len(frames), 137, 3))
        points[:, PARTS[given["part"]]] = (50, 60, 0.5)
        return points

    monkeypatch.setattr(second_look, "look_again", look_again)
    again, project = review.page.gestures.again, review.session.project
    edits = project.last_edit
    choose(review, "Detect in a rectangle", "Left hand")
    until(lambda: review.tab.evaluate("() => tcfit.state('framing')?.around") == "left hand", "the page to know")
    review.press("Escape", lambda: again.framing is None)
    choose(review, "Detect in a rectangle", "Right hand")
    until(lambda: review.tab.evaluate("() => tcfit.state('framing')?.around") == "right hand", "the page to know")
    wrist = tuple(project.corrected.xy[8, PARTS["right_hand"].start].tolist())
    end = (wrist[0] + 60, wrist[1] + 40)
    drag(review, wrist, end)  # it begins on a keypoint, which stays where it is
    until(lambda: project.last_edit > edits, "the edit")
    assert asked[0]["part"] == "right_hand" and len(asked) == 1
    assert asked[0]["region"] == pytest.approx((*wrist, *end), abs=2)
    edit = project.log[-1].action
    assert isinstance(edit, DetectAgain) and edit.part == "right_hand"
    until(lambda: review.tab.evaluate("() => tcfit.state('framing')") is None, "the page to know the end")
    review.press("Control+z", lambda: project.redoable is not None)


def test_every_key_is_taken(review: Reviewing):
    page = review.page
    for key, name in {"m": "bodies", "k": "keypoints", "d": "difference", "l": "loop"}.items():
        before = getattr(page.tab.state, name)
        review.press(key, lambda name=name, before=before: getattr(page.tab.state, name) != before)
        review.press(key, lambda name=name, before=before: getattr(page.tab.state, name) == before)
    review.press("d", lambda: review.tab.locator(".tcfit-spring i").is_visible())
    review.press("m", lambda: review.tab.locator(".tcfit-spring i").is_hidden())
    review.press("m", lambda: review.tab.locator(".tcfit-spring i").is_visible())
    review.press("d", lambda: review.tab.locator(".tcfit-spring i").is_hidden())
    review.press("Control+a", lambda: len(page.tab.state.selection) > 60)
    review.press("Escape", lambda: page.tab.state.selection == ())


def test_notes_are_written_changed_and_deleted(review: Reviewing):
    project = review.session.project
    field = review.tab.get_by_label("Note", exact=True)
    review.tab.keyboard.press("y")
    until(lambda: field.evaluate("(field) => field === document.activeElement"), "the field")
    field.fill("The wrist is hidden here")
    field.press("Enter")
    (note,) = until(lambda: project.notes, "the note")
    assert (note.frames, note.text) == (range(8, 9), "The wrist is hidden here")
    lane = until(lambda: review.tab.evaluate("() => tcfit.state('marks').notes"), "the lane")
    assert lane == [{"first": 8, "last": 8, "text": note.text}]
    until(lambda: field.input_value() == "", "an empty field")
    review.tab.get_by_role("button", name="Change", exact=True).click()
    until(lambda: field.input_value() == note.text, "its text")
    field.fill("The wrist is seen")
    field.press("Enter")
    until(lambda: [note.text for note in project.notes] == ["The wrist is seen"], "the other text")
    review.tab.get_by_role("button", name="Delete", exact=True).click()
    until(lambda: not project.notes, "no note")
    field.blur()
    review.press("Control+z", lambda: [note.text for note in project.notes] == ["The wrist is seen"])
    review.press("Control+z", lambda: project.notes == (note,))
    review.press("Control+z", lambda: not project.notes)


def test_a_link_leads_to_its_frame_and_fit(review: Reviewing, browser: "Browser"):
    tab = review.page.tab
    review.tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    review.app.post(lambda: (tab.set(b=FitChoice(run=1, phase=1)), tab.seek(8)))
    review.app.post(lambda: review.page.gestures.noting.copy_link())
    link = f"{review.server.address.url}/?frame=8&run=1&phase=1"
    # Browsers share the clipboard: what another test has left there may come first.
    until(lambda: review.tab.evaluate("() => navigator.clipboard.readText()") == link, "the link")
    review.app.post(lambda: tab.set(b=FitChoice()))
    other = opened(review.app, review.server, browser)
    for opening in (
        lambda: other.tab.goto(link),
        lambda: (other.tab.goto("data:text/html,<a>link</a>"), other.tab.evaluate("(to) => location.assign(to)", link)),
    ):
        known = other.page
        opening()
        until(lambda known=known: other.page is not known and other.page.tab.ready, "the page")
        until(lambda: (other.frame, other.page.tab.state.b) == (8, FitChoice(run=1, phase=1)), "what the link says")
        until(lambda: other.tab.evaluate("() => location.href") == f"{review.server.address.url}/", "a plain address")
        other.app.post(lambda: (other.page.tab.set(b=FitChoice()), other.page.tab.seek(0)))
    other.tab.goto(f"{review.server.address.url}/?frame=8&run=77")
    other.tab.get_by_text("The link leads to run 77").wait_for()
    other.tab.close()
    until(lambda: review.page.tab is tab)


def test_a_reload_keeps_everything(review: Reviewing):
    review.press("2", lambda: review.page.tab.state.mode == "ab")
    review.press("End", lambda: review.frame == review.page.tab.length - 1)
    review.app.post(lambda: review.page.tab.set(frames=range(4, 9)))
    until(lambda: "4–8" in review.tab.locator(".tcfit-frames").inner_text(), "the selected frames")
    before, edits = review.page.tab.state, review.session.project.last_edit
    client = review.page.tab.client.client_id
    review.tab.reload()
    until(lambda: review.app.pages and review.page.tab.client.client_id != client and review.page.tab.ready, "the page")
    assert replace(review.page.tab.state, playing=False) == replace(before, playing=False)
    assert review.session.project.last_edit == edits
    until(lambda: len(shown_labels(review)) == 2)
    until(lambda: body_in_page(review, 1), "the body")
    until(lambda: "4–8" in review.tab.locator(".tcfit-frames").inner_text(), "the selected frames")
    assert not review.complaints


def test_a_second_browser_has_its_own_frame_and_sees_the_same_project(review: Reviewing, browser: "Browser"):
    first = review.page
    other = opened(review.app, review.server, browser)
    assert other.page is not first and other.frame == 0
    other.press("ArrowRight", lambda: other.frame == 1)
    assert first.tab.state.frame == 8
    seen = review.session.project.keypoints_version
    first.tab.do(lambda: first.tab.set(selection=(WRIST,)))
    review.tab.keyboard.press("Control+ArrowUp")
    until(lambda: review.session.project.keypoints_version > seen, "the edit")
    edited = review.session.project.keypoints_version
    other.press("Control+z", lambda: "again" in other.page.tab.message[0])
    assert review.session.project.keypoints_version == edited, "the edit of another browser"
    other.press("Control+z", lambda: review.session.project.keypoints_version > edited)
    assert not other.complaints
    other.tab.context.close()
    until(lambda: len(review.app.pages) == 1)


def test_states_without_a_fit_a_video_or_the_lock(demo_project: Path, browser: "Browser", tmp_path: Path):
    folder = tmp_path / "copy.tcfit"
    with Project.open(demo_project, read_only=True) as project:
        Project.create(folder, replace(project.clip, source=None)).close()
    with Project.open(folder), reviewing(folder, browser, read_only=True) as found:
        texts = until(lambda: chips(found), "the status line")
        assert any("No fit yet" in text for text in texts) and any("Read-only" in text for text in texts)
        assert any("created without a video" in text for text in texts)
        found.tab.keyboard.press("d")
        found.tab.get_by_text("There is no fit yet").first.wait_for()
        assert not found.page.tab.state.difference, "there is nothing between two fits yet"
        found.tab.keyboard.press("Shift+R")
        found.tab.get_by_text("open read-only").first.wait_for()
        assert not found.session.jobs and not found.complaints


SIDE_PLATE = """() => {
  const { image, posters } = tcfit.state('layout') ?? { posters: [] };
  const at = posters.findIndex((poster) => poster.kind === "side");
  if (at < 0) return null;
  return [...tcfit.place(0, 0, at), ...tcfit.place(posters[at].width * image[1], image[1], at)];
}"""
"""Left, top, right and bottom of the side view's plate in the window."""


def seen_on(review: Reviewing, plate: list[float]) -> float:
    """Share of the plate on which the window shows a body of run B's colour."""
    left, top, right, bottom = (round(edge) for edge in plate)
    clip = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    png = np.frombuffer(review.tab.screenshot(clip=clip), np.uint8)  # pyright: ignore[reportArgumentType]
    image = cv2.imdecode(png, cv2.IMREAD_COLOR)
    assert image is not None
    return float((image[..., 2] > image[..., 0] + 60.0).mean())


def shown_labels(review: Reviewing) -> list[str]:
    """Labels of the pictures as the page has them."""
    return labels_of(review, "picture")


def labels_of(review: Reviewing, kind: str) -> list[str]:
    """Labels of one kind of posters."""
    find = "(kind) => tcfit.state('layout')?.posters.filter((p) => p.kind === kind).map((p) => p.label) ?? []"
    return review.tab.evaluate(find, kind)


def chips(review: Reviewing) -> list[str]:
    """What the header says, with the lines of its menu."""
    return review.tab.evaluate("() => [...document.querySelectorAll('.tcfit-status > *')].map((one) => one.outerHTML)")


def body_in_page(review: Reviewing, poster: int) -> list[float]:
    """The first bytes of a poster's body, as viser's scene in the page has them; empty if there is none."""
    return review.tab.evaluate(
        """(poster) => {
          const nodes = Object.entries(window.__viserSceneTree.getState());
          const mine = nodes.filter(([name]) => name.startsWith(`/posters/${poster}/`)).map(([, n]) => n.message.props);
          const body = mine.find((props) => props.vertices);
          return body ? [...body.vertices.slice(0, 240)] : [];
        }""",
        poster,
    )
