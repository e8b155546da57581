"""Files that commands work on, for calls that may do anything to them."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.tcfit_app.hostile.calls import LIMIT, Calls, Ended
from tests.tcfit_app.hostile.command_lines import PathOption, with_path


@dataclass(frozen=True, kw_only=True)
class World:
    """Files that commands work on, and a process that runs them there."""

    folder: Path
    run: Calls
    lines: dict[str, list[str]]
    """A command line of each command that works, or would work if this computer had what it asks for."""
    hostile: dict[str, str]
    packages: Path
    """Where plugins may be installed."""

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
        base = self.lines[option.command]
        places = {name: base.index(value) for name, value in POSITIONAL[option.command].items() if value in base}
        return self.ran(with_path(base, option, self.hostile[kind], places))

    def ran(self, line: list[str], *, limit: float = LIMIT) -> tuple[Ended, set[str]]:
        """Run a command line; what it leaves is removed, and told."""
        before = self.files()
        ended = self.run(line, limit=limit)
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
    "batch": {"manifest": "clips.csv"},
    "models": {"paths": "body.npz"},
    "settings": {},
}
