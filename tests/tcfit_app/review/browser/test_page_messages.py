"""What travels between server and page, without a page."""

import msgspec
import numpy as np
import pytest

from fitting_core.keypoints import BONES, COUNT, NAMES
from tcfit_app.review.browser import page_events, page_states
from tcfit_app.review.browser.channel import loading, web_files
from tcfit_app.review.browser.page_events import Drag, Hello, Press, Range, decode
from web_tools import wire_types


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ('"type": "hello", "tab": "ab12", "width": 800, "height": 600', Hello(tab="ab12", width=800, height=600)),
        ('"type": "press", "command": "action", "value": "play"', Press(command="action", value="play")),
        ('"type": "range", "first": null, "last": null', Range(first=None, last=None)),
    ],
)
def test_an_event_is_read(text: str, event: Hello | Press | Range) -> None:
    assert decode(f'{{"number": 3, "event": {{{text}}}}}') == page_events.Envelope(number=3, event=event)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{",
        "[" * 10_000,
        '"\ud800"',
        '{"number": 1, "event": {"type": "nothing"}}',
        '{"number": 0, "event": {"type": "drawn", "frame": 1}}',
        '{"number": 1, "event": {"type": "drawn", "frame": -1}}',
        '{"number": 1, "event": {"type": "drawn", "frame": "1"}}',
        '{"number": 1, "event": {"type": "drawn", "frame": 1, "more": 2}}',
        '{"number": 1, "event": {"type": "range", "first": 1}}',
        '{"number": 1, "event": {"type": "select", "joints": [137], "how": "replace"}}',
        '{"number": 1, "event": {"type": "select", "joints": [1], "how": "all"}}',
        '{"number": 1, "event": {"type": "select", "joints": [' + "1," * 137 + '1], "how": "add"}}',
        '{"number": 1, "event": {"type": "key", "action": "' + "a" * 65 + '", "repeat": false}}',
        '{"number": 1, "event": {"type": "press", "command": "action", "value": "' + "a" * 257 + '"}}',
        '{"number": 1, "event": {"type": "drag", "phase": "move", "joints": [1], "dx": 1e9, "dy": 0, "frame": 0}}',
        '{"number": 1, "event": {"type": "drag", "phase": "move", "joints": [1], "dx": NaN, "dy": 0, "frame": 0}}',
        '{"number": 1, "event": {"type": "drawn", "frame": 1}' + " " * 20_000 + "}",
    ],
)
def test_what_is_no_event_is_refused(text: str) -> None:
    with pytest.raises(msgspec.DecodeError):
        decode(text)


def test_a_drag_of_all_keypoints_is_short_enough() -> None:
    drag = Drag(phase="move", joints=tuple(range(COUNT)), dx=-1234.0123456789, dy=0.1, frame=123456)
    text = msgspec.json.encode(page_events.Envelope(number=10**9, event=drag)).decode()
    assert decode(text).event == drag
    assert len(text) < page_events.EVENT_CHARACTERS / 4


def test_the_skeleton_has_all_keypoints_in_groups() -> None:
    skeleton = page_states.Skeleton()
    assert [j for g in skeleton.groups for j in range(g.start, g.stop)] == list(range(COUNT))
    assert list(skeleton.names) == NAMES and list(skeleton.bones) == BONES


def test_values_of_a_curve() -> None:
    assert page_states.curve_values(np.array([1.23456, np.nan, np.inf, -12345.6])) == (1.235, None, None, -12350.0)


def test_frames_become_spans() -> None:
    assert page_states.spans([7, 3, 4, 5, 3, 9, 8]) == ((3, 5), (7, 9))
    assert page_states.spans([]) == ()


def test_the_script_makes_no_code_or_html_of_text() -> None:
    everything = [loading(), *(content.decode() for content in web_files().values())]
    assert not [text for text in everything if "eval(" in text or "innerHTML" in text]
    assert [path for path, content in web_files().items() if b"DOMParser" in content] == ["/tcfit/bars/markup.js"]


def test_what_the_page_s_types_say_is_what_travels() -> None:
    assert wire_types.PATH.read_text() == wire_types.wire_types(), "python -m web_tools.wire_types writes it anew"


def test_another_viser_is_reported() -> None:
    text = '{"number": 1, "event": {"type": "stranger", "viser": "1.2.0", "missing": ["messageQueue", "scene"]}}'
    assert str(decode(text).event) == "tcfit needs viser 1.1.x, found 1.2.0, whose page lacks: messageQueue, scene"
