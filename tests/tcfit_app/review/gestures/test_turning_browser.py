"""The rings in Chromium: viser tells how the pointer turns them, and the server takes that."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import Lock
from tcfit_app.project.project import Project
from tests.drivers.lone_page import lone_page
from tests.drivers.review_page import Reviewing, reviewing, until
from tests.samples.sessions import small_clip

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough
ELBOW = INDEX["left_elbow"]
FRAME = 3


def test_a_ring_that_is_dragged_locks_the_joint(
    tmp_path: Path, free_body: BodyModel, panel_server: viser.ViserServer, browser: "Browser"
):
    folder = tmp_path / "walk.tcfit"
    with Project.create(folder, small_clip(free_body)) as project, lone_page(panel_server, project) as made:
        made.fit()
    with reviewing(folder, browser) as review:
        tab = review.page.tab
        tab.do(lambda: tab.set(mode="space", frame=FRAME, selection=(ELBOW,)))
        until(lambda: review.page.gestures.turning.rings(tab.shown) is not None, "the rings")
        review.rest()
        held = grabbed(review)
        assert held, "no place near the joint is on a ring"
        review.tab.mouse.up()
        until(lambda: review.session.project.log, "the edit")
        edit = review.session.project.log[-1].action
        assert isinstance(edit, Lock) and edit.frames == (FRAME,) and edit.joints == (ELBOW,)
        assert not review.complaints


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
