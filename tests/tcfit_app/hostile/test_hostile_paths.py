"""Every command with every kind of path that is none, in every place where it takes one: told in a line, at once, and
nothing is written that is not whole."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fitting_core.files.npz import write_npz
from tcfit_app.cli.ending import INPUT_ERROR
from tcfit_app.cli.main import COMMANDS
from tests.samples.media import write_video
from tests.tcfit_app.conftest import CAMERA, FRAMES, QUICK
from tests.tcfit_app.hostile.calls import Calls, Ended, calls
from tests.tcfit_app.hostile.command_lines import PathOption, path_options, with_path
from tests.tcfit_app.hostile.paths import hostile_paths

OPTIONS = [option for command in COMMANDS for option in path_options(command)]


@dataclass(frozen=True, kw_only=True)
class World:
    """Files that commands work on, and a process that runs them there."""

    folder: Path
    run: Calls
    lines: dict[str, list[str]]
    """A command line of each command that works, or would work if this computer had what it asks for."""
    hostile: dict[str, str]

    def files(self) -> dict[str, tuple[int, int]]:
        """Size and time of everything in the folder."""
        found = {}
        for path in self.folder.rglob("*"):
            if path.name.endswith(("-wal", "-shm", ".lock")):  # of every project that was opened
                continue
            stat = path.lstat()
            found[str(path)] = stat.st_size, stat.st_mtime_ns
        return found

    def tried(self, option: PathOption, kind: str) -> tuple[Ended, set[str]]:
        """Call a command with a hostile path; what it leaves is removed, and told."""
        before = self.files()
        base = self.lines[option.command]
        places = {name: base.index(value) for name, value in POSITIONAL[option.command].items() if value in base}
        ended = self.run(with_path(base, option, self.hostile[kind], places))
        after = self.files()
        new = {path for path in after if path not in before}
        changed = {path for path in before if after.get(path) != before[path] and not Path(path).is_dir()}
        for path in sorted(new):
            shutil.rmtree(path, ignore_errors=True)
            Path(path).unlink(missing_ok=True) if not Path(path).is_dir() else None
        return ended, new | {f"changed: {path}" for path in changed}


POSITIONAL = {
    "fit": {"video": "walk.mp4"},
    "new": {"video": "walk.mp4"},
    "review": {"video": "walk.mp4"},
    "demo": {},
    "detect": {"video": "walk.mp4"},
    "import": {"project": "walk.tcfit", "path": "result"},
    "export": {"path": "walk.tcfit"},
    "evaluate": {"fit": "result"},
    "render": {"path": "result"},
    "batch": {"manifest": "clips.csv"},
    "models": {"paths": "body.npz"},
    "settings": {},
}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory, keypoint_folder: Path) -> Iterator[World]:
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
        "render": ["render", "result", "--out", "new.png"],
        "batch": ["batch", "clips.csv", "--jobs", "1", "--no-overlay", *QUICK],
        "models": ["models", "add", "body.npz"],
        "settings": ["settings", "--config", "settings.toml"],
    }
    with calls(root / "printed", folder) as run:
        fitted = run(["fit", *clip, "--out", "result", "--no-overlay", "--threads", "1", *QUICK], limit=120)
        assert fitted.status == 0, fitted
        made = run(["new", *clip, "--out", "walk.tcfit"])
        assert made.status == 0, made
        imported = run(lines["import"])
        assert imported.status == 0, imported
        yield World(folder=folder, run=run, lines=lines, hostile=dict(hostile_paths(root / "hostile")))


def complaints(world: World, option: PathOption, kinds: list[str]) -> list[str]:
    """What is wrong with a command's ends."""
    found = []
    for kind in kinds:
        ended, left = world.tried(option, kind)
        fault = ended.fault
        if not fault and ended.status == INPUT_ERROR and left:
            fault = f"fails, and leaves {sorted(left)[:3]}"
        if fault:
            found.append(f"{option.command} {option.flag} with {kind}: {fault}\n{ended.err[-600:]}")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("option", OPTIONS, ids=lambda option: f"{option.command} {option.name}")
def test_every_kind_in_every_place(world: World, option: PathOption):
    found = complaints(world, option, list(world.hostile))
    assert not found, "\n".join(found)


@pytest.mark.parametrize("which", range(len(OPTIONS)), ids=lambda i: f"{OPTIONS[i].command} {OPTIONS[i].name}")
def test_every_place_with_some_kind(world: World, which: int):
    kinds = list(world.hostile)
    found = complaints(world, OPTIONS[which], [kinds[5 * which % len(kinds)]])
    assert not found, "\n".join(found)
