"""Many clips on a Ray that runs on this computer."""

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
from tests.samples.batch_clips import CHEAP, fitted, rows_of, states_of, write_batch

pytest.importorskip("ray", reason="Ray is not installed (pip install tcfit[ray])")
ROOT = Path(__file__).parents[3]
CLIPS = 24


@pytest.mark.slow
def test_a_local_ray_fits_and_goes_on(tmp_path: Path, free_body: BodyModel, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    manifest = write_batch(tmp_path, free_body, clips=6, broken=2)
    command = ["batch", str(manifest), *CHEAP, "--jobs", "2", "--ray", "local"]
    assert main(command) == 1
    assert Counter(states_of(tmp_path)) == {"done": 4, "failed": 2}
    assert "is not readable as JSON" in rows_of(tmp_path)["fits/c001"]["reason"]
    assert all(read_fit(path).complete for path in (tmp_path / "fits").iterdir())
    assert main(command) == 1
    assert Counter(states_of(tmp_path)) == {"done before": 4, "failed": 2}


@pytest.mark.slow
def test_a_node_that_dies_costs_nothing_but_time(tmp_path: Path, free_body: BodyModel, monkeypatch):
    """Three nodes, one of which is killed with what it fits: nothing is lost."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    manifest = write_batch(tmp_path, free_body, clips=CLIPS)
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
    rows = rows_of(tmp_path)
    assert [row["state"] for row in rows.values()] == ["done"] * CLIPS
    assert all(read_fit(tmp_path / name).complete for name in rows)
    assert not [path for path in (tmp_path / "fits").iterdir() if path.name.startswith(".")]


def _kill_when(cluster: Any, node: Any, folder: Path) -> None:
    """Kills a node's processes as soon as a quarter of the clips is fitted."""
    while len(fitted(folder)) < CLIPS // 4:
        time.sleep(0.05)
    cluster.remove_node(node, allow_graceful=False)
