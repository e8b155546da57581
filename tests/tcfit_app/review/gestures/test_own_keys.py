"""Keys that a user chose: read, written, refused, and shown wherever keys are."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import viser

from fitting_core.errors import InputError
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.browser.page_states import Keys
from tcfit_app.review.gestures import own_keys
from tcfit_app.review.gestures.actions import ACTIONS, Key
from tcfit_app.review.gestures.own_keys import bindings, change_keys, key_text, keys_from, keys_of, keys_problem
from tcfit_app.review.panels.key_list import key_groups
from tests.drivers.lone_page import LonePage, lone_page, sample_project


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """In place of the user's."""
    path = tmp_path / "data" / "keys.toml"
    monkeypatch.setattr(own_keys, "own_keys_file", lambda: path)
    return path


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path) -> Iterator[LonePage]:
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        made.page.receive(Hello("me", 1000, 700))
        yield made


def test_usual_keys_without_a_file():
    assert all(keys_of(name) == action.keys for name, action in ACTIONS.items()) and not keys_problem()
    assert key_text("undo") == "Ctrl+Z" and key_text("save_picture") == ""


def test_changed_keys_are_kept_and_taken_back(file: Path):
    change_keys("save_picture", "F2 Ctrl+Shift+s")
    assert keys_of("save_picture") == (Key(key="F2"), Key(key="s", ctrl=True, shift=True))
    change_keys("bad", "")
    assert keys_of("bad") == () and "bad" not in {binding.action for binding in bindings()}
    assert ("F2 or Ctrl+Shift+S", "Save the picture") in key_groups()["View"]
    assert file.read_text() == '"save_picture" = "F2 Ctrl+Shift+S"\n"bad" = ""\n'
    change_keys("difference", "x")
    assert key_text("difference") == "X", "the key that another command gave up"
    with pytest.raises(InputError, match='X is the key of "Colour by distance'):
        change_keys("bad", None)
    change_keys("difference", None)
    for name in ("bad", "save_picture"):
        change_keys(name, None)
    assert file.read_text() == "" and keys_of("bad") == ACTIONS["bad"].keys


@pytest.mark.parametrize("name", list(ACTIONS))
def test_keys_are_read_as_they_are_shown(name: str):
    assert keys_from(" ".join(map(str, ACTIONS[name].keys))) == ACTIONS[name].keys


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("D", Key(key="d")),
        ("shift+d", Key(key="d", shift=True)),
        ("5", Key(key="Digit5")),
        ("Ctrl++", Key(key="+", ctrl=True)),
        ("+", Key(key="+")),
        ("pagedown", Key(key="PageDown")),
        ("Ctrl+←", Key(key="ArrowLeft", ctrl=True)),
        ("esc", Key(key="Escape")),
    ],
)
def test_keys_as_people_write_them(text: str, key: Key):
    assert keys_from(text) == (key,)


@pytest.mark.parametrize("text", ["Hyper+D", "Tab", "ä", "F13", "Shift", "Shift+", "Ctrl+Shift+?", "DD", "+D+"])
def test_what_is_no_key_is_refused(text: str, file: Path):
    with pytest.raises(InputError, match="is no key"):
        change_keys("bad", text)
    assert not file.exists()


@pytest.mark.parametrize(("text", "whose"), [("Ctrl+W", "the browser"), ("Ctrl+K", "Commands")])
def test_keys_that_never_reach_the_app_are_refused(text: str, whose: str):
    with pytest.raises(InputError, match=f"never reaches tcfit: {whose} has it"):
        change_keys("bad", text)


def test_a_conflict_is_refused_with_both_names(file: Path):
    with pytest.raises(InputError, match=r'T is the key of "Flag on or off".*before "Mark bad, or restore"'):
        change_keys("bad", "T")
    assert not file.exists() and keys_of("bad") == ACTIONS["bad"].keys


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('bad = "T"', 'T is the key of "'),
        ('nothing = "T"', "no command 'nothing'"),
        ("bad = 3", "bad = 3 is no text"),
        ('bad = "Hyper+T"', "is no key"),
        ("bad", "Expected '='"),
        ("\udcff", "codec"),
        pytest.param("#" * 2**21, "expected at most 1.0 MB", id="large"),
    ],
)
def test_a_file_that_cannot_be_used_says_why_and_leaves_the_usual_keys(file: Path, content: str, said: str):
    file.parent.mkdir()
    file.write_bytes(content.encode("utf-8", "surrogateescape"))
    assert said in keys_problem() and keys_of("bad") == ACTIONS["bad"].keys
    with pytest.raises(InputError, match="Mend the file"):
        change_keys("bad", "F2")
    assert file.read_bytes() == content.encode("utf-8", "surrogateescape")


def test_a_change_is_seen_in_the_window_the_panels_and_by_the_page(tested: LonePage):
    tab = tested.page.tab
    tab.set(keys=True)
    tested.page._draw_keys()
    tested.field("Command")
    tested.enter("Command", ACTIONS["flag"].title)
    assert tested.field("Keys").value == "T"
    tested.field("Keys").value = "X"
    tested.press("keys.change")
    tested.page._draw_keys()
    assert "X is the key of &quot;Mark bad" in tested.html() and key_text("flag") == "T"
    tested.field("Keys").value = "F2"
    tested.press("keys.change")
    tested.page._draw_keys()
    shown = tested.html()
    assert "<kbd>F2</kbd>" in shown and "is the key of" not in shown
    assert "Flag on or off (F2)" in shown
    sent = tab.channel._sent["keys"]
    assert isinstance(sent, Keys) and ("F2", "flag") in {(each.key, each.action) for each in sent.bindings}
    assert tab.browser.commands["flag"].description == "F2"
    tested.press("keys.usual")
    assert key_text("flag") == "T" and tested.field("Keys").value == "T"
    tab.set(keys=False)
    tested.page._draw_keys()
    assert not tab.buttons.on_show("keys.change", "")


def test_a_tab_is_told_of_a_file_that_cannot_be_used(panel_server: viser.ViserServer, tmp_path: Path, file: Path):
    file.parent.mkdir()
    file.write_text("bad = 3")
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        made.page.receive(Hello("me", 1000, 700))
        assert [notice.title for notice in made.notices] == ["Your own keys are not used"]
