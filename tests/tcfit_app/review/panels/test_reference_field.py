"""Where a user says what fits are compared with."""

from collections.abc import Callable
from pathlib import Path
from unittest.mock import MagicMock

import pytest
import viser

from tcfit_app.review.panels.fit.compare import ReferenceField
from tests.drivers.lone_page import lone_page, sample_project


def test_an_upload_is_read_when_it_comes_and_not_when_it_is_taken_up(
    panel_server: viser.ViserServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    waiting: list[Callable[[], None]] = []
    taken: list[viser.UploadedFile] = []
    monkeypatch.setattr(ReferenceField, "_take", lambda self, file: taken.append(file))
    files = [viser.UploadedFile(name=f"{i}.npz", content=b"") for i in range(2)]
    with sample_project(tmp_path / "walk.tcfit") as project, lone_page(panel_server, project, waiting.append) as tested:
        upload = tested.field("Upload a reference")
        for file in files:
            upload._impl.value = file
            tested.call_back(upload, MagicMock())
        for command in waiting:
            command()
    assert taken == files
