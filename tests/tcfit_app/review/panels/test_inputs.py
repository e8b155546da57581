"""Inputs of panels: the server knows each kind of them, for it drops the values of any other."""

from pathlib import Path

import msgspec
import viser

from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.server.page_messages import GuiUpdateMessage, read
from tcfit_app.server.screen import FITS
from tests.drivers.lone_page import lone_page, sample_project


def test_what_a_user_enters_gets_through(panel_server: viser.ViserServer, tmp_path: Path):
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        StartPanel(made.page.gestures)
        made.draw()
        inputs = list(made.page.tab.client.gui._gui_input_handle_from_uuid.values())
        assert len(inputs) > 30
        for widget in inputs:
            if not isinstance(widget, viser.GuiUploadButtonHandle):
                sent = {"type": "GuiUpdateMessage", "uuid": "", "updates": {"value": widget.value}}
                message = read(msgspec.msgpack.encode(sent))
                assert isinstance(message, GuiUpdateMessage)
                assert FITS[type(widget)](widget, message.updates.value), widget
