"""The header: what it says, and what it says of a correction that the body does not reach."""

from pathlib import Path

import numpy as np
import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import MoveKeypoint
from tcfit_app.review.browser.page_states import ShowPanel
from tcfit_app.review.drawing.status import Message
from tcfit_app.review.panels.review_panel import ReviewPanel
from tests.drivers.lone_page import LonePage, tiny_page


def test_a_correction_out_of_reach_says_how_far_and_what_to_move_as_well(
    panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    with tiny_page(panel_server, tmp_path / "p", tiny_body, ReviewPanel) as tested:
        tested.fit()
        page, elbow = tested.page, INDEX["right_elbow"]
        tab = page.tab
        tab.set(selection=(elbow,))

        def said() -> list[str]:
            tab.look()
            return [chip.text for chip in page.header.status.messages(0.0, "") if "px from" in chip.text]

        with monkeypatch.context() as limited:
            limited.setattr(type(tab.data), "gaps", None)
            assert not said(), "nothing was corrected, so nothing is measured"
        xy = tab.session.project.corrected.xy[tab.state.frame, elbow]
        x, y = (xy + np.array([0.0, 300.0])).tolist()
        monkeypatch.setattr(type(tab.session.edit_follower), "busy", property(lambda self: False))
        tab.session.project.append(MoveKeypoint(frames=(tab.state.frame,), joints=(elbow,), xy=(((x, y),),)))
        (text,) = said()
        assert text.endswith("from the right elbow. Move the right wrist too, or reset the keypoint")
        assert 200 < float(text.split("px")[0].rpartition("still ")[2]) < 400
        tab.set(selection=(INDEX["right_wrist"],))
        assert not said()
        tab.set(selection=(elbow,))
        tab.session.project.undo()
        assert not said()


def test_the_most_urgent_is_shown_and_leads_on_and_the_rest_is_in_a_menu(
    fitted_page: LonePage, monkeypatch: pytest.MonkeyPatch
):
    asked, cancelled, page = [], [], fitted_page.page
    monkeypatch.setattr(page.tab.channel, "ask", asked.append)
    monkeypatch.setattr(page.header.status, "messages", lambda now, problem: messages)
    messages = [
        Message(text="Read-only", kind="warning"),
        Message(text="The video is gone", kind="warning", panel="Review"),
        Message(text="Fitting 43 %", kind="busy", progress=0.43, cancel=lambda: cancelled.append(True)),
    ]
    shown = fitted_page.html()
    assert ">Fitting 43 %<" in shown and "width:43.0%" in shown and ">Read-only<" in shown
    assert ">The video is gone<" not in shown and ">1 more ▾<" in shown
    fitted_page.press("header.cancel", "Fitting")
    fitted_page.press("header.more", "The video is gone")
    del messages[0]
    fitted_page.press("header.lead", "Review")
    assert cancelled and asked == 2 * [ShowPanel(panel="Review")]
    messages.clear()
    assert ">Saved<" in fitted_page.html()
