"""All panels: what they send, and when their buttons are off."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
import viser
from viser import _gui_api, _gui_handles
from viser._icons import svg_from_icon

from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.project import Project
from tcfit_app.review.drawing.status import lasting
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.page import SKELETON
from tcfit_app.review.panels import PANELS
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.server.page_messages import GuiUpdateMessage, read
from tcfit_app.server.screen import FITS
from tcfit_app.server.viser_bridge import icon, keep_icons_open
from tests.drivers.lone_page import LonePage, sample_project
from tests.samples.media import write_images
from tests.samples.project_samples import FRAMES
from tests.tcfit_app.review.panels.conftest import ATTACK, suspect, with_suspects

FIRST = 7
"""The number that users see for frame 0 of the sample clip."""


def test_nothing_is_sent_when_nothing_has_changed(tested: LonePage):
    with_suspects(tested, suspect(2))
    assert tested.draw()
    assert not tested.draw()
    tested.page.tab.seek(3)
    assert tested.draw()
    assert not tested.draw()


def test_a_keypoint_has_one_name_wherever_it_is_read(tested: LonePage):
    joints = tuple(INDEX[name] for name in ("left_wrist", "left_index4", "face_outer_lip3"))
    names = ("left wrist", "left index tip", "face outer lip 3")
    page = tested.page
    page.tab.set(selection=joints)
    page.gestures.correcting.toggle_bad()
    assert page.tab.message[0].startswith(f"Saved: {', '.join(names)} marked bad")
    assert f"<b>Left wrist, {', '.join(names[1:])}</b>" in tested.html()
    assert set(names) <= set(tested.field("Keypoint").options)
    assert [SKELETON.names[joint] for joint in joints] == list(names)


def test_playing_sends_little(tested: LonePage):
    with_suspects(tested)
    tested.page.tab.toggle_playing()
    tested.draw()
    tested.page.tab.set(frame=2)
    assert not tested.draw()


def test_what_others_wrote_is_shown_as_text(tested: LonePage):
    tab, shown = tested.page.tab, []
    tab.set(folds={"corrections"})
    with_suspects(tested)
    shown.append(tested.html())  # with the name of a run
    tab.session.edit(MarkBad(frames=(1,), joints=(4,)), author=ATTACK)
    shown.append(tested.html())
    with_suspects(tested, suspect(2, reason=ATTACK))
    shown.append(tested.html())
    written = [html.count("&lt;img src=x") for html in shown]
    assert 0 < written[0] < written[1] < written[2] and not any("<img" in html for html in shown)


def test_who_else_has_the_clip_open_is_shown(tested: LonePage):
    tab = tested.page.tab
    assert "Also here" not in tested.html()
    tab.authors = lambda: [tab.author, "browser 1", tab.author, "anna", "browser 2", "browser 1"]
    assert "Also here: anna, 2 other browsers" in tested.html()


def test_finding_the_video_again(tested: LonePage, tmp_path: Path):
    page = tested.page
    assert "created without a video" in tested.html()
    assert tested.field("New location").visible
    folder = write_images(tmp_path / "images", *(f"{frame:03}.png" for frame in range(FRAMES)))
    tested.field("New location")._impl.value = f'"{folder}" '
    tested.press("review.relink")
    tested.settle()
    (told,) = tested.notices
    assert (told.title, told.text) == (
        "Video found",
        str(folder),
    ) and page.tab.session.project.media.problem == ""


def test_read_only_buttons_are_off(page_of: Callable[..., LonePage], tmp_path: Path):
    sample_project(tmp_path / "walk.tcfit", "first").close()
    tested = page_of(Project.open(tmp_path / "walk.tcfit", read_only=True))
    tested.page.tab.set(selection=(4,))
    assert "Opened read-only" in tested.html() and ">Mark bad<" not in tested.html()
    assert all(tested.field(name).disabled for name in ("Smoothness (w_T)", "Held near (m)", "Note", "Name"))
    assert lasting(tested.page.tab)[0].text == "Read-only"


def test_what_needs_a_fit_or_the_video_is_off_without(page_of: Callable[..., LonePage], tmp_path: Path):
    tested = page_of(sample_project(tmp_path / "walk.tcfit"))
    gestures = tested.page.gestures
    for name in ("ab", "space", "blinked", "bodies", "outline", "difference", "side"):
        assert "There is no fit yet" in ACTIONS[name].obstacle(gestures), name
    assert "no finished fit" in ACTIONS["approve"].obstacle(gestures)
    assert tested.button("Body").disabled


def test_what_a_user_enters_gets_through(tested: LonePage):
    """The server knows each kind of input, for it drops the values of any other."""
    StartPanel(tested.page.gestures)
    tested.draw()
    inputs = list(tested.page.tab.client.gui._gui_input_handle_from_uuid.values())
    assert len(inputs) > 30
    for widget in inputs:
        if not isinstance(widget, viser.GuiUploadButtonHandle):
            sent = {"type": "GuiUpdateMessage", "uuid": "", "updates": {"value": widget.value}}
            message = read(msgspec.msgpack.encode(sent))
            assert isinstance(message, GuiUpdateMessage)
            assert FITS[type(widget)](widget, message.updates.value), widget


def test_frames_that_are_selected_elsewhere_are_not_changed(tested: LonePage):
    page, project = tested.page, tested.page.tab.session.project
    page.tab.set(frames=range(1, 4), selection=(4,))
    page.tab.seek(5)
    page.gestures.correcting.nudge(1.0, 0.0)  # of the frame on show alone
    known = len(project.log)
    changing = ("bad", "reset", "copy", "interpolate", "swap_body", "mirror_depth", "clear_depth", "fine", "flag")
    for name in changing:
        with pytest.raises(InputError, match=f"frames {FIRST + 1}–{FIRST + 3}, and frame {FIRST + 5} is on show"):
            tested.press("action", name)
    with pytest.raises(InputError, match="is on show"):
        tested.press("action", "swap_legs")
    assert len(project.log) == known and not project.marks.all()
    assert f"Frame {FIRST + 5} is not among the selected frames" in tested.html()
    tested.press("frames.go")
    assert page.tab.state.frame == 1 and "is not among" not in tested.html()
    tested.press("action", "bad")
    assert tested.last_edit == MarkBad(frames=(1, 2, 3), joints=(4,))
    page.tab.seek(5)
    tested.press("action", "escape")
    assert page.tab.state.selection == () and page.tab.state.frames is not None, "the keypoint first"
    tested.press("action", "escape")
    tested.press("action", "flag")
    assert list(project.marks.all()) == [5]


def test_icons_are_viser_s_own(monkeypatch: pytest.MonkeyPatch):
    """Read from its archive by us, as viser does it slowly."""
    for kind in PANELS:
        assert icon(kind.icon) == svg_from_icon(kind.icon)
    for user in (_gui_handles, _gui_api):
        monkeypatch.setattr(user, "svg_from_icon", svg_from_icon)
    keep_icons_open()
    assert _gui_handles.svg_from_icon is icon and _gui_api.svg_from_icon is icon  # pyright: ignore
