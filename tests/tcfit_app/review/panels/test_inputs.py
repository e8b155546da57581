"""Inputs of panels: of what a strange page sends to them, nothing stays that they cannot hold."""

from pathlib import Path
from unittest.mock import MagicMock

import pytest
import viser

from tcfit_app.review.panels import WITHOUT_KEYPOINTS
from tests.drivers.lone_page import lone_page, sample_project

_STRANGE = (b"bytes", {"a": 1}, ["x", "y"], ("x", "y"), (float("nan"), 0.0), (1.0,), float("inf"), float("nan"), None)


def test_no_input_keeps_a_value_that_is_none_like_its_own(
    panel_server: viser.ViserServer, tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    with sample_project(tmp_path / "walk.tcfit", "first") as project, lone_page(panel_server, project) as made:
        for panel in WITHOUT_KEYPOINTS:
            if not any(isinstance(there, panel) for there in made.panels):
                panel(made.page.gestures)
        inputs = [h for h in made._children() if isinstance(h, viser.GuiInputHandle) and getattr(h, "label", "")]
        inputs = [h for h in inputs if not isinstance(h, viser.GuiButtonHandle | viser.GuiUploadButtonHandle)]
        assert len(inputs) > 30
        for handle in inputs:
            before = handle.value
            for value in _STRANGE:
                handle._impl.value = value  # so viser does before it calls
                made.call_back(handle, MagicMock())
                assert handle.value == before, (handle.label, value)
    assert not [record.getMessage() for record in caplog.records if record.exc_info]
