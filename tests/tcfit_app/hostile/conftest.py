"""A world for hostile calls."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fitting_core.files.npz import write_npz
from tests.samples.media import write_video
from tests.tcfit_app.conftest import CAMERA, FRAMES, QUICK
from tests.tcfit_app.hostile.calls import calls
from tests.tcfit_app.hostile.paths import hostile_paths
from tests.tcfit_app.hostile.world import World


@pytest.fixture(scope="session")
def hostile_world(tmp_path_factory: pytest.TempPathFactory, keypoint_folder: Path) -> Iterator[World]:
    root = tmp_path_factory.mktemp("hostile")
    folder = root / "world"
    folder.mkdir()
    shutil.copytree(keypoint_folder, folder / "keypoints")
    write_video(folder / "walk.mp4", frames=FRAMES, size=CAMERA.size)
    (folder / "settings.toml").write_text('preset = "tcfit"\n')
    (folder / "clips.csv").write_text("out,keypoints,image_size\nnew,keypoints,640 480\n")
    write_npz(folder / "camera.npz", {"R": np.eye(3), "t": np.zeros(3)})
    clip = ["walk.mp4", "--keypoints", "keypoints"]
    lines = {
        "fit": ["fit", *clip, "--out", "new", "--no-overlay", "--threads", "1", *QUICK],
        "new": ["new", *clip, "--out", "new.tcfit"],
        "review": ["review", *clip, "--out", "new.tcfit", "--no-browser", "--port", "0"],
        "demo": ["demo", "--out", "walk.tcfit", "--no-browser", "--port", "0"],
        "detect": ["detect", "walk.mp4", "--out", "new"],
        "import": ["import", "walk.tcfit", "result"],
        "export": ["export", "walk.tcfit", "--formats", "npz", "--out", "new"],
        "evaluate": ["evaluate", "result", "--reference", "result/fit.npz", "--out", "new"],
        "batch": ["batch", "clips.csv", "--jobs", "1", "--no-overlay", *QUICK],
        "models": ["models", "add", "body.npz"],
        "settings": ["settings", "--config", "settings.toml"],
    }
    packages = root / "packages"
    packages.mkdir()
    with calls(root / "printed", folder, packages=packages) as run:
        fitted = run(["fit", *clip, "--out", "result", "--no-overlay", "--threads", "1", *QUICK], limit=120)
        assert fitted.status == 0, fitted
        made = run(["new", *clip, "--out", "walk.tcfit"])
        assert made.status == 0, made
        imported = run(lines["import"])
        assert imported.status == 0, imported
        yield World(
            folder=folder, run=run, lines=lines, hostile=dict(hostile_paths(root / "hostile")), packages=packages
        )
