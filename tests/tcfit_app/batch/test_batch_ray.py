"""Many clips on a Ray that runs on this computer."""

import json
import os
from collections import Counter
from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.main import main
from tests.samples.batch_clips import CHEAP, events, write_batch

pytest.importorskip("ray", reason="Ray is not installed (pip install tcfit[ray])")
ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_a_local_ray_fits_and_goes_on(tmp_path: Path, free_body: BodyModel, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    manifest = write_batch(tmp_path, free_body, clips=6, broken=2)
    command = ["batch", str(manifest), *CHEAP, "--jobs", "2", "--ray", "local"]
    assert main(command) == 1
    rows = json.loads((tmp_path / "clips.batch/summary.json").read_text())["rows"]
    assert Counter(row["state"] for row in rows) == {"done": 4, "failed": 2}
    assert "is not readable as JSON" in rows[1]["reason"]
    assert all(read_fit(path).complete for path in (tmp_path / "fits").iterdir())
    assert main(command) == 1
    assert len(list(events(tmp_path, "fitted"))) == 4 and len(list(events(tmp_path, "started"))) == 6
