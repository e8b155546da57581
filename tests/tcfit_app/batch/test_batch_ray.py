"""Many clips on a Ray that runs on this computer."""

import json
import os
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import read_fit
from tcfit_app.cli.main import main
from tests.samples.batch_clips import CHEAP, events, write_batch

pytest.importorskip("ray", reason="Ray is not installed (pip install tcfit[ray])")
ROOT = Path(__file__).parents[3]
CLIPS = 24


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


@pytest.mark.slow
def test_a_node_that_dies_costs_nothing_but_time(tmp_path: Path, free_body: BodyModel, monkeypatch):
    """Three nodes, one of which is killed with what it fits: nothing is lost, and nothing is made twice."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    manifest = write_batch(tmp_path, free_body, clips=CLIPS, subjects=2)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        doomed, _ = cluster.add_node(num_cpus=1), cluster.add_node(num_cpus=1)
        watch = threading.Thread(target=_kill_when, args=(cluster, doomed, tmp_path), daemon=True)
        watch.start()
        assert main(["batch", str(manifest), *CHEAP, "--ray", str(cluster.address)]) == 0
        watch.join(10)
        assert not watch.is_alive(), "the node was not killed"
    finally:
        cluster.shutdown()
    processes = len(
        {json.loads(line)["process"] for line in (tmp_path / "clips.batch/log.jsonl").read_text().splitlines()}
    )
    assert processes >= 3
    rows = json.loads((tmp_path / "clips.batch/summary.json").read_text())["rows"]
    assert [row["state"] for row in rows] == ["done"] * CLIPS
    times = Counter(events(tmp_path, "fitted"))
    assert set(times.values()) == {1} and all(read_fit(tmp_path / row["clip"]).complete for row in rows)
    assert not [path for path in (tmp_path / "fits").iterdir() if path.name.startswith(".")]


def _kill_when(cluster: Any, node: Any, folder: Path) -> None:
    """Kills a node's processes as soon as a quarter of the clips has been begun."""
    log = folder / "clips.batch/log.jsonl"
    while not log.exists() or len(list(events(folder, "fitted"))) < CLIPS // 4:
        time.sleep(0.05)
    cluster.remove_node(node, allow_graceful=False)
