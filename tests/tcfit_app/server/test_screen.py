"""What a page sends, tried with a client that sends what it likes: only what is on show can be used."""

import logging
import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, get_args

import msgspec
import pytest
import viser
from viser import _messages
from viser.infra._messages import wire_field_names

from tcfit_app.server import page_messages, screen, uploads
from tcfit_app.server.page_messages import PageMessage, read, written
from tcfit_app.server.serving import ReviewServer, review_server
from tcfit_app.server.uploads import AT_ONCE, UPLOAD_BYTES
from tests.drivers.raw_tab import RawTab, admitted, camera, raw_tab

PART = 512 << 10


@dataclass
class Tried:
    """A server with a tab that has one widget of each kind."""

    server: ReviewServer
    tab: RawTab
    widgets: dict[str, Any]
    files: list[viser.UploadedFile] = field(default_factory=list)

    def uuid(self, name: str) -> str:
        return self.widgets[name]._impl.uuid

    def settle(self) -> None:
        """Until what was sent before has arrived."""
        text = self.widgets["text"]
        told = f"settled {time.monotonic()}"
        self.tab.set(self.uuid("text"), told)
        self.tab.until(lambda: text.value == told)

    def upload(self, content: bytes, *, to: str = "upload", name: str = "transfer", **changes: Any) -> None:
        """As viser's page does it."""
        about = {"source_component_uuid": self.uuid(to), "transfer_uuid": name}
        count = math.ceil(len(content) / PART)
        start = {"filename": "a.npz", "mime_type": "", "part_count": count, "size_bytes": len(content)}
        self.tab.send({"type": "FileTransferStartUpload", **about, **start, **changes})
        for i in range(count):
            self.part(i, content[i * PART : (i + 1) * PART], **about)

    def part(self, index: int, content: bytes, **about: str) -> None:
        usual = {"source_component_uuid": self.uuid("upload"), "transfer_uuid": "transfer"}
        self.tab.send({"type": "FileTransferPart", **usual, **about, "part_index": index, "content": content})

    @property
    def told(self) -> list[str]:
        """Notices in the tab."""
        return [message["props"]["body"] for message in self.tab.messages if "Notification" in message["type"]]


def add_widgets(client: viser.ClientHandle) -> dict[str, Any]:
    gui = client.gui
    with gui.add_folder("Closed", visible=False), gui.add_folder("Within"):
        folded = gui.add_slider("Folded", 0, 9, 1, 5)
        folded_upload = gui.add_upload_button("Folded upload")
    return {
        "text": gui.add_text("Text", "usual"),
        "unseen text": gui.add_text("Unseen", "usual", visible=False),
        "dropdown": gui.add_dropdown("Choice", ("one", "two")),
        "number": gui.add_number("Number", 5, min=1, max=9),
        "free number": gui.add_number("Number", 0.5),
        "slider": gui.add_slider("Slider", 0.0, 0.3, 0.1, 0.1),
        "two numbers": gui.add_vector2("Two", (1.0, 2.0)),
        "folded": folded,
        "folded upload": folded_upload,
        "disabled": gui.add_slider("Disabled", 0, 9, 1, 5, disabled=True),
        "hidden": gui.add_slider("Hidden", 0, 9, 1, 5, visible=False),
        "upload": gui.add_upload_button("Upload"),
        "progress": gui.add_progress_bar(3.0),
        "checkbox": gui.add_checkbox("Of no panel", False),
    }


@contextmanager
def opened(server: ReviewServer, cookie: str) -> Iterator[Tried]:
    made: list[Tried] = []
    known = set(server.viser.get_clients())
    with raw_tab(server.address.url, cookie) as tab:

        def client() -> viser.ClientHandle | None:
            new = set(server.viser.get_clients()) - known
            return server.viser.get_clients()[new.pop()] if new else None

        tab.until(client)
        found = client()
        assert found is not None
        made.append(Tried(server, tab, add_widgets(found)))
        made[0].widgets["upload"].on_upload(lambda event: made[0].files.append(event.target.value))
        yield made[0]


@pytest.fixture(scope="module")
def server() -> Iterator[ReviewServer]:
    with review_server("A clip", port=0, open_browser=False, say=lambda text: None) as running:
        yield running


@pytest.fixture(scope="module")
def cookie(server: ReviewServer) -> str:
    return admitted(server.gate.link)


@pytest.fixture
def tried(
    server: ReviewServer, cookie: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> Iterator[Tried]:
    with caplog.at_level(logging.INFO), opened(server, cookie) as found:
        yield found
        found.settle()
    loud = [record for record in caplog.records if record.levelno > logging.INFO]
    assert not loud, loud
    assert capfd.readouterr() == ("", "")


# --- messages ---

UPDATE = {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": 1.5}}
START = {
    "type": "FileTransferStartUpload",
    "source_component_uuid": "a",
    "transfer_uuid": "b",
    "filename": "c",
    "mime_type": "",
    "part_count": 1,
    "size_bytes": 3,
}
TURN = {
    "type": "TransformControlsUpdateMessage",
    "name": "/a",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 1.0, 2.0],
    "owner": "b",
}
OF_PAGES = [
    camera(),
    camera(position=(0, 1, 2), image_width=0),  # whole numbers come as such
    UPDATE,
    {**UPDATE, "updates": {"value": "text"}},
    {**UPDATE, "updates": {"value": [1, 2]}},
    {"type": "CommandTriggerMessage", "uuid": "a"},
    {"type": "TransformControlsDragStartMessage", "name": "/a", "owner": "b"},
    TURN,
    {"type": "TransformControlsDragEndMessage", "name": "/a", "owner": "b"},
    START,
    {"type": "FileTransferPart", "source_component_uuid": "a", "transfer_uuid": "b", "part_index": 0, "content": b"c"},
]
OF_NOBODY = [
    5,
    {},
    {"type": "NoSuchMessage"},
    {"type": "GuiFormDirtyMessage", "uuid": "a"},
    {"type": "GuiFormSubmitMessage", "uuid": "a"},
    {"type": "GuiButtonHoldMessage", "uuid": "a", "frequency": 1.0},
    {"type": "ShareUrlRequest"},
    {"type": "ShareUrlDisconnect"},
    {"type": "RunJavascriptMessage", "source": "alert(1)"},
    {"type": "Message"},
    {**UPDATE, "updates": {}},
    {**UPDATE, "updates": {"value": "x", "visible": True}},
    {**UPDATE, "updates": {"label": "x"}},
    {**UPDATE, "excluded_self_client": 0},
    {**UPDATE, "uuid": 5},
    {**UPDATE, "uuid": "x" * 65},
    *(
        {**UPDATE, "updates": {"value": value}}
        for value in (None, True, b"x", [1], [1, 2, 3], ["a", "b"], {}, [[1, 2]])
    ),
    *(camera(fov=fov) for fov in (0.0, -1.0, 4.0, math.nan, "1", None)),
    *(camera(position=place) for place in ((0.0, 0.0), (0.0, 0.0, math.nan), (0.0, 0.0, 1e300), "abc", None)),
    *({**TURN, "wxyz": turn} for turn in ([1.0, 0.0, 0.0], [math.nan, 0.0, 0.0, 0.0], [1e300, 0.0, 0.0, 0.0], None)),
    {**TURN, "name": "x" * 65},
    camera(image_width=-1),
    camera(image_height=1.5),
    {**START, "size_bytes": -1},
    {**START, "part_count": 1 << 60},
    {**START, "filename": "x" * 2000},
]


def packed(message: object) -> bytes:
    return msgspec.msgpack.encode(message)


def test_the_messages_are_those_of_viser():
    kinds = {type(read(packed(message))) for message in OF_PAGES}
    assert kinds == set(get_args(PageMessage))
    for kind in kinds:
        assert kind.__struct_fields__ == wire_field_names(getattr(_messages, kind.__name__))


@pytest.mark.parametrize("message", OF_PAGES)
def test_what_a_page_sends_gets_to_viser_as_it_is(message: dict[str, Any]):
    passed = written(read(packed(message)))
    assert vars(_messages.Message.deserialize(passed)) == vars(_messages.Message.deserialize(packed(message)))


@pytest.mark.parametrize("message", OF_NOBODY)
def test_what_no_page_sends_does_not(message: object):
    with pytest.raises(ValueError):
        read(packed(message))


@pytest.mark.parametrize(
    "sent",
    ["text", b"", b"\xc1", b"\x91" * 200_000, b"\x81\xa1a" * 200_000, b"\xdd\xff\xff\xff\xff", packed(UPDATE)[:-1]],
    ids=["text", "empty", "no such byte", "lists", "objects", "a huge list", "torn"],
)
def test_what_is_no_message_does_not(sent: bytes | str):
    with pytest.raises(ValueError):
        read(sent)


def test_a_field_that_comes_twice_gets_to_viser_once():
    twice = b"\x83" + packed({"type": "CommandTriggerMessage", "uuid": "a"})[1:] + packed({"uuid": "b"})[1:]
    assert _messages.Message.deserialize(written(read(twice))) == _messages.CommandTriggerMessage("b")


# --- widgets ---

TAKEN = {
    "text": ["", "other", "x" * 100_000],
    "unseen text": ["an event of the script"],
    "dropdown": ["two"],
    "number": [1, 9.0, 3.0],
    "free number": [-1e9, 1e9, 7],
    "slider": [0, 0.3, 0.30000000000000004],
    "two numbers": [[1, 2], [-1e9, 1e9]],
}
DROPPED = {
    "text": [1, 1.5, [1.0, 2.0]],
    "dropdown": ["three", "", 1, [1.0, 2.0]],
    "number": ["3", 0, 10, math.nan, math.inf, 1e300, [1.0, 2.0]],
    "free number": [1e10, -1e300, math.inf, math.nan],
    "slider": [-0.1, 0.4, "0.1", math.nan, [0.1, 0.1]],
    "two numbers": ["ab", 1.0, [1e300, 0.0], [0.0, math.nan], [0.0, math.inf]],
    "folded": [6],
    "disabled": [6],
    "hidden": [6],
    "upload": ["text", 1.0],
    "progress": [4.0],
    "checkbox": [1.0, "x"],
}


def test_a_widget_takes_what_its_page_lets_a_user_enter(tried: Tried):
    for name, values in TAKEN.items():
        widget = tried.widgets[name]
        for value in values:
            tried.tab.set(tried.uuid(name), value)
            tried.settle()
            kept = tried.widgets["text"].value if name == "text" else widget.value
            assert kept == (tuple(value) if isinstance(value, list) else value) or name == "text", (name, value)


def test_a_widget_keeps_its_value_if_a_page_sends_what_nobody_can_enter(tried: Tried):
    before = {name: widget.value for name, widget in tried.widgets.items()}
    for name, values in DROPPED.items():
        for value in values:
            tried.tab.set(tried.uuid(name), value)
    tried.settle()
    after = {name: widget.value for name, widget in tried.widgets.items()}
    assert after == {**before, "text": after["text"]}


def test_a_tab_does_not_reach_the_widgets_of_another(tried: Tried, cookie: str):
    with opened(tried.server, cookie) as other:
        tried.tab.set(other.uuid("slider"), 0.3)
        tried.settle()
        assert other.widgets["slider"].value == 0.1


def test_nothing_that_is_forged_gets_to_other_tabs_or_to_new_ones(tried: Tried, cookie: str):
    with opened(tried.server, cookie) as other:
        for kind in ("GuiFormDirtyMessage", "GuiFormSubmitMessage"):
            tried.tab.send({"type": kind, "uuid": "forged"})
        tried.settle()
        with opened(tried.server, cookie) as new:
            for one in (other, new):
                one.settle()
                assert "forged" not in repr(one.tab.messages)


def test_a_command_is_triggered(tried: Tried):
    done: list[int | None] = []
    [client] = tried.server.viser.get_clients().values()
    command = client.gui.add_command("Do it")
    command.on_trigger(lambda event: done.append(event.client_id))
    tried.tab.send({"type": "CommandTriggerMessage", "uuid": command._impl.uuid})
    tried.tab.send({"type": "CommandTriggerMessage", "uuid": "forged"})
    tried.tab.until(lambda: done)
    assert done == [client.client_id]


def test_a_camera_that_looks_nowhere_is_none(tried: Tried):
    [client] = tried.server.viser.get_clients().values()
    tried.tab.send(camera(position=(1.0, 2.0, 3.0)))
    for changes in ({"position": (0.0, 0.0, 0.0)}, {"up_direction": (0.0, 0.0, 0.0)}):
        tried.tab.send(camera(**changes))
    tried.settle()
    assert tuple(client.camera.position) == (1.0, 2.0, 3.0)


def test_it_is_noted_once(tried: Tried, caplog: pytest.LogCaptureFixture):
    for _ in range(50):
        tried.tab.send({"type": "ShareUrlRequest"})
    tried.tab.set("forged \x1b[31m", "\x1b]0;forged\7")
    tried.settle()
    [told] = [record.getMessage() for record in caplog.records if "Dropped" in record.getMessage()]
    assert "ShareUrlRequest" in told


def test_a_flood_waits_and_other_tabs_do_not(
    server: ReviewServer, cookie: str, tried: Tried, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(screen, "AHEAD", 20.0)
    monkeypatch.setattr(screen, "MESSAGES_A_SECOND", 50.0)
    with opened(server, cookie) as flooding:
        begin = time.monotonic()
        for i in range(120):
            flooding.tab.set(flooding.uuid("text"), f"{i}")
        tried.settle()
        assert flooding.widgets["text"].value != "119", "the other tab has waited for the flood"
        flooding.tab.until(lambda: flooding.widgets["text"].value == "119")
        assert time.monotonic() - begin > 1.5


# --- uploads ---


def test_files_are_uploaded(tried: Tried):
    for content in (b"", b"small", bytes(range(256)) * 5000):
        tried.upload(content)
        tried.tab.until(lambda content=content: tried.files and tried.files[-1].content == content)
    assert [file.name for file in tried.files] == 3 * ["a.npz"]
    assert not tried.told


@pytest.mark.parametrize("name", ["slider", "text", "progress", "folded upload"])
def test_a_file_for_what_takes_none_is_dropped(tried: Tried, name: str):
    before = tried.widgets[name].value
    tried.upload(b"content", to=name)
    tried.upload(b"content")
    tried.tab.until(lambda: tried.files)
    tried.upload(b"content", name="other")
    tried.part(0, b"content", source_component_uuid=tried.uuid(name))
    tried.settle()
    assert name == "text" or tried.widgets[name].value == before


def test_a_part_goes_where_its_file_was_announced_for(tried: Tried):
    """viser would give the file to whatever the last part names."""
    tried.upload(b"", part_count=1, size_bytes=7)
    tried.part(0, b"content", source_component_uuid=tried.uuid("slider"))
    tried.settle()
    assert tried.widgets["slider"].value == 0.1 and not tried.files
    tried.part(0, b"content")
    tried.tab.until(lambda: tried.files)


def test_parts_that_were_not_announced_are_dropped(tried: Tried):
    third = 50_000
    a, b, c = (letter * third for letter in (b"a", b"b", b"c"))
    tried.upload(b"", part_count=3, size_bytes=3 * third)
    wrong = [(3, a), (1 << 40, b""), (0, 4 * a), (0, 3 * a)]
    for index, content in [*wrong, (0, a), (0, b), (1, 3 * b), (2, c), *wrong, (1, b[1:]), (1, b), (1, a)]:
        tried.part(index, content)
    tried.tab.until(lambda: tried.files)
    tried.settle()
    assert [file.content for file in tried.files] == [a + b + c]


def test_a_file_that_is_too_large_is_told_before_it_comes(tried: Tried):
    tried.upload(b"", size_bytes=UPLOAD_BYTES + 1, part_count=UPLOAD_BYTES // PART + 1)
    tried.part(0, bytes(PART))
    tried.tab.until(lambda: tried.told)
    assert "256.0 MB; expected at most 256 MB" in tried.told[0]
    tried.upload(b"small", name="another")
    tried.tab.until(lambda: tried.files)


def test_files_in_more_parts_than_anybody_cuts_are_dropped(tried: Tried):
    for size, count in ((1 << 20, 1 << 20), (10, 2), (2 << 20, 1), (0, 1), (5, 0)):
        tried.upload(b"", name=f"{size}", size_bytes=size, part_count=count)
    tried.upload(b"small")
    tried.tab.until(lambda: tried.files)
    assert [file.content for file in tried.files] == [b"small"] and not tried.told


def test_few_files_come_at_the_same_time(tried: Tried):
    for i in range(AT_ONCE + 1):
        tried.upload(b"", name=f"{i}", size_bytes=10, part_count=1)
    tried.tab.until(lambda: tried.told)
    assert "Too much is being uploaded" in tried.told[0]
    for i in range(AT_ONCE):
        tried.part(0, bytes(10), transfer_uuid=f"{i}")
    tried.tab.until(lambda: len(tried.files) == AT_ONCE)
    tried.upload(b"again", name="again")
    tried.tab.until(lambda: len(tried.files) == AT_ONCE + 1)


def test_what_a_tab_has_begun_is_over_when_it_closes(server: ReviewServer, cookie: str):
    room = uploads.ROOM_BYTES // UPLOAD_BYTES
    for _ in range(room):
        with opened(server, cookie) as one:
            for i in range(AT_ONCE):
                size, count = UPLOAD_BYTES, UPLOAD_BYTES // PART
                one.upload(b"", name=f"{i}", size_bytes=size, part_count=count)
            one.settle()
    with opened(server, cookie) as last:
        last.upload(b"small")
        last.tab.until(lambda: last.files)
        assert not last.told


def test_all_tabs_share_the_room_for_uploads(server: ReviewServer, cookie: str):
    with ExitStack() as opening:
        tabs = [opening.enter_context(opened(server, cookie)) for _ in range(3)]
        for tab in tabs:
            for i in range(AT_ONCE):
                tab.upload(b"", name=f"{i}", size_bytes=UPLOAD_BYTES, part_count=UPLOAD_BYTES // PART)
            tab.settle()
        tabs[2].tab.until(lambda: len(tabs[2].told) == 2)
        assert [len(tab.told) for tab in tabs] == [0, 0, 2]


def test_a_message_that_is_longer_than_any_ends_its_connection(tried: Tried, cookie: str):
    with opened(tried.server, cookie) as other:
        other.tab.connection.send(bytes(page_messages.MESSAGE_BYTES + 1))
        other.tab.until(lambda: other.tab.closed)
