"""The lists of keys say all that ACTIONS holds, in the app and in its documentation."""

from pathlib import Path

from tcfit_app.review.gestures.actions import ACTIONS, Key, key_text
from tcfit_app.review.panels import PANELS
from tcfit_app.review.panels.key_list import GESTURES, joined_keys, key_groups, keys_html
from tcfit_app.review.tab.state import MODES
from tests.drivers.lone_page import LonePage

PAGE = Path(__file__).parents[4] / "docs" / "app.md"


def keys_markdown() -> str:
    """The table in docs/app.md."""
    rows = [
        (f"**{title}**" if number == 0 else "", keys, what.replace("|", "\\|"))
        for title, lines in {**key_groups(), **GESTURES}.items()
        for number, (keys, what) in enumerate(lines)
    ]
    return "\n".join(["| | keys | |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)])


def test_the_documentation_has_the_keys_of_the_app():
    assert keys_markdown() in PAGE.read_text(encoding="utf-8")


def test_every_key_is_listed_in_the_group_of_its_action():
    for action in ACTIONS.values():
        for key in action.keys:
            keys = " ".join(keys for keys, _ in key_groups()[action.group])
            assert str(key).rpartition("+")[2] in keys, action.title


def test_an_action_has_a_line_of_its_own_or_its_family_has():
    for action in ACTIONS.values():
        if action.keys:
            titles = [title for _, title in key_groups()[action.group]]
            assert titles.count(action.family or action.title) == 1


def test_no_two_actions_share_a_key_and_none_takes_one_of_the_browser():
    keys = [key for action in ACTIONS.values() for key in action.keys]
    assert len(set(keys)) == len(keys)
    assert not {key.key for key in keys if key.ctrl} & set("knqtwp"), "the browser or the palette has them"


def test_keys_of_a_family_say_their_modifiers_once():
    left, right = Key(key="ArrowLeft", ctrl=True), Key(key="ArrowRight", ctrl=True)
    assert joined_keys((left,), (right,)) == "Ctrl+← →"
    assert joined_keys((Key(key="n"),), (Key(key="n", shift=True),)) == "N, Shift+N"
    assert joined_keys((left, right)) == "Ctrl+← or Ctrl+→"


def test_keys_are_called_what_is_written_on_them():
    assert key_text("undo") == "Ctrl+Z"
    assert key_text("range_start") == "["
    assert [key_text(name) for name in MODES] == ["1", "2", "3"]


def test_every_panel_of_a_fitted_clip_has_a_key():
    keys = [key_text(f"panel_{panel.title.lower()}") for panel in PANELS]
    assert keys == [f"Shift+{number}" for number, _ in enumerate(PANELS, 1)]


def test_the_window_has_a_heading_for_each_group(tested: LonePage):
    shown = keys_html(tested.page.gestures)
    assert all(f"<b>{group}</b>" in shown for group in key_groups())
    assert "Compare" in shown and "tcfit-close" in shown
