"""What a newcomer sees, and how many clicks, drags and keys the usual tasks take, done here as a user does them."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.keypoints import FINGER_JOINTS, INDEX, NAMES
from fitting_core.measure.hands.handshapes import HandshapeSet, finger_bones
from tcfit_app.review.panels import PANELS
from tests.drivers.page_tab import GUTTER, MARGIN
from tests.drivers.review_page import Reviewing, reviewing
from tests.drivers.waiting import until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

WRIST, HAND = INDEX["right_wrist"], range(NAMES.index("right_thumb1") - 1, NAMES.index("right_thumb1") + 20)
RULER = 9.0
"""Its middle, in pixels below the timeline's upper border."""


@dataclass
class User:
    """Does things, and counts them."""

    review: Reviewing
    count: int = 0

    def click(self, x: float, y: float) -> None:
        self.count += 1
        self.review.tab.mouse.click(x, y)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        self.count += 1
        mouse = self.review.tab.mouse
        mouse.move(*start)
        mouse.down()
        mouse.move(*end, steps=5)
        mouse.up()

    def key(self, name: str) -> None:
        self.count += 1
        self.review.tab.keyboard.press(name)

    def press(self, role: str, name: str) -> None:
        self.count += 1
        self.review.tab.get_by_role(role, name=name, exact=False).first.click()  # pyright: ignore[reportArgumentType]

    def in_timeline(self, frame: float, y: float = 90.0) -> tuple[float, float]:
        box = self.review.tab.locator(".tcfit-strip").bounding_box()
        assert box is not None
        length = self.review.page.tab.length
        return box["x"] + GUTTER + (frame + 0.5) / length * (box["width"] - GUTTER - MARGIN), box["y"] + y

    def seek(self, frame: int) -> None:
        self.click(*self.in_timeline(frame))
        until(lambda: self.review.frame == frame, f"frame {frame}")
        until(lambda: self.review.tab.evaluate("() => tcfit.state('keypoints').frame") == frame, "its keypoints")

    def select_frames(self, first: int, last: int) -> None:
        self.drag(self.in_timeline(first, RULER), self.in_timeline(last, RULER))
        until(lambda: self.review.page.tab.state.frames == range(first, last + 1), "the selected frames")

    def move_wrist(self, by: tuple[float, float]) -> None:
        x, y = self.review.place("right_wrist")
        self.drag((x, y), (x + by[0], y + by[1]))


@pytest.fixture(scope="module")
def review(fitted_demo: Path, browser: "Browser", tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reviewing]:
    folder = Path(shutil.copytree(fitted_demo, tmp_path_factory.mktemp("counted") / "demo.tcfit"))
    with reviewing(folder, browser) as found:
        yield found
        assert not found.complaints


@pytest.fixture
def user(review: Reviewing) -> User:
    page = review.page
    review.app.post(lambda: page.tab.set(mode="edit", frame=8, selection=(), frames=None, side=True))
    until(lambda: review.frame == 8)
    review.rest()
    return User(review)


def test_playing_a_first_correction_and_its_undoing(user: User):
    review, project = user.review, user.review.session.project
    for playing in (True, False):
        user.key("Space")
        until(lambda playing=playing: review.page.tab.state.playing is playing, "the player")
    user.count, edits = 0, project.last_edit
    user.seek(12)
    x, y = review.place("right_elbow")
    user.drag((x, y), (x - 20, y + 20))
    until(lambda: project.last_edit > edits, "the edit")
    assert user.count == 2
    user.key("Control+z")
    until(lambda: project.redoable is not None, "the undo")
    review.rest()
    user.key("n")
    until(lambda: review.page.tab.state.selection, "the next suspicious place")
    assert user.count == 4, "one key each"


def test_a_wrist_that_is_wrong_over_ten_frames(user: User):
    review = user.review
    before, edits = review.session.project.clip.keypoints, review.session.project.last_edit
    for frame in (5, 14):
        user.seek(frame)
        user.move_wrist((30.0, -20.0))
        edits += 1
        until(lambda done=edits: review.session.project.last_edit == done, "the edit")
    assert user.count == 4, "two seeks and two drags"
    after, way = review.session.project.clip.keypoints, np.array([30.0, -20.0]) / review.scale()
    for frame in range(5, 15):
        np.testing.assert_allclose(after.xy[frame, WRIST] - before.xy[frame, WRIST], way, atol=0.1)
        there = [joint for joint in HAND if before.confidence[frame, joint] > 0]
        assert there and np.abs(after.xy[frame, there] - before.xy[frame, there] - way).max() < 0.1
    review.rest()


def test_a_keypoint_that_is_bad_over_a_range(user: User):
    user.select_frames(3, 12)
    user.click(*user.review.place("right_wrist"))
    user.key("x")
    until(lambda: user.review.session.project.corrected.bad[3:13, WRIST].all(), "the marks")
    assert user.count == 3


def test_another_weight_on_a_range_beside_the_old_run(user: User):
    review, page = user.review, user.review.page
    runs = len(review.session.fits.runs)
    user.select_frames(6, 14)
    user.press("tab", "Fit")
    field = review.tab.get_by_label("Smoothness (w_T)").first
    user.count += 1
    field.fill("500")
    field.press("Enter")
    until(lambda: page.tab.state.settings.config.temporal.weight == 500, "the weight")
    user.press("button", "Fit frames")
    until(lambda: len(review.session.fits.runs) > runs, "the run")
    user.key("2")
    review.rest()
    assert user.count == 5
    old, new = page.tab.look().a, page.tab.look().b
    assert old is not None and new is not None
    assert new.run.id == review.session.fits.runs[-1].id and old.run.id == new.run.parent


def test_an_arm_on_the_wrong_side_over_twenty_frames(user: User):
    user.select_frames(2, 21)
    user.click(*user.review.place("right_wrist"))
    user.key("Shift+M")
    until(lambda: np.isfinite(user.review.session.project.corrected.depth[2:22, WRIST]).all(), "the depths")
    assert user.count == 3
    user.review.rest()


def test_a_fist_instead_of_a_flat_hand_over_twenty_frames(user: User, monkeypatch: pytest.MonkeyPatch):
    review, page = user.review, user.review.page
    monkeypatch.setattr(page.gestures.shaping, "blend", 0)
    user.select_frames(2, 21)
    user.click(*review.place("right_wrist"))
    user.press("tab", "Correct")
    user.press("button", "Fist")
    until(lambda: np.isfinite(review.session.project.corrected.turn[2:22, FINGER_JOINTS["right"]]).all(), "the shape")
    assert user.count == 4
    review.rest()
    until(lambda: not review.session.jobs and not review.session.edit_follower.busy, "the fit")
    shown = page.tab.look().b
    assert shown is not None
    body = review.session.bodies.of(shown.run.body)
    bones = finger_bones(keypoints_in_space(body, shown.params)[0], "right")[2:22]
    shapes = [HandshapeSet(body).nearest(bones[[frame]]) for frame in range(20)]
    assert all(shape is not None and shape.name == "fist" and shape.degrees < 7 for shape in shapes)


def test_a_glb(user: User):
    user.press("tab", "Export")
    with user.review.tab.expect_download() as waiting:
        user.press("button", "Blender")
    assert waiting.value.suggested_filename.endswith(".glb") and user.count == 2


def test_the_first_steps_stay_until_they_have_been_read(review: Reviewing, browser: "Browser"):
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    tab = context.new_page()
    tab.goto(review.server.gate.link)
    steps = tab.locator(".tcfit-panel", has=tab.get_by_text("First steps", exact=True))
    steps.wait_for()
    texts = steps.locator("li").all_inner_texts()
    assert len(texts) == 4 and texts[0] == "Play the clip Space"
    assert steps.bounding_box()["x"] > tab.locator(".tcfit").bounding_box()["width"], "not over the picture"  # pyright: ignore
    tab.reload()
    steps.wait_for()
    steps.get_by_role("button", name="Got it").click()
    steps.wait_for(state="detached")
    tab.reload()
    tab.wait_for_selector("html.tcfit-ready", state="attached")
    assert not steps.count()
    tab.get_by_role("button", name="Help").click()
    tab.get_by_role("menuitem", name="First steps").click()
    steps.wait_for()
    context.close()
    until(lambda: len(review.app.pages) == 1, "the end of the other tab")


MOST_CONTROLS = 12
"""In the panel, whatever is selected."""
CONTROLS = """() =>
  [...document.querySelectorAll(".mantine-ScrollArea-content :is(button, input:not([type=hidden]), [role=slider])")]
    .filter((one) => one.checkVisibility() && one.getClientRects().length > 0)
    .map((one) => one.innerText || one.ariaLabel || one.labels?.[0]?.textContent || one.value)"""


@pytest.mark.parametrize("title", [panel.title for panel in PANELS])
@pytest.mark.parametrize("selected", ["nothing", "elbow", "wrist", "finger", "several", "frames"])
def test_a_newcomer_sees_few_controls(user: User, title: str, selected: str):
    joints = {"elbow": ("right_elbow",), "wrist": ("right_wrist",), "finger": ("right_index3",)}
    several = ("right_elbow", "right_shoulder", "neck")
    chosen = tuple(INDEX[name] for name in (several if selected == "several" else joints.get(selected, ())))
    frames = range(10, 21) if selected == "frames" else None
    user.review.app.post(lambda: user.review.page.tab.set(selection=chosen, frames=frames, frame=12, folds=frozenset()))
    user.review.tab.get_by_role("tab", name=title, exact=True).click()
    found: list[str] = []

    def settled() -> bool:
        before = found[:]
        found[:] = user.review.tab.evaluate(CONTROLS)
        return bool(found) and found == before

    user.review.tab.wait_for_timeout(500)  # panels are drawn a little after the picture
    until(settled, "the panel")
    assert len(found) <= MOST_CONTROLS, f"{len(found)} controls: {found}"
