"""A recorder of what is on the disk: which files and folders were synced, and when they got their names."""

import builtins
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


class Syncs:
    """What has happened, in order."""

    def __init__(self) -> None:
        self.events: list[tuple[str, Any]] = []
        """("sync", a file's or folder's identity and size), ("name", path that something was renamed to), ("said",
        text)."""

    def check(self, path: Path) -> None:
        """Fail unless a file, or a folder with all that is in it, was on the disk before it got its name, and the name
        is there too, before anything was said. Forgets what has happened so far."""
        named = max(n for n, event in enumerate(self.events) if event == ("name", _absolute(path)))
        before = {content for kind, content in self.events[:named] if kind == "sync"}
        for part in (path, *path.rglob("*")):
            assert _identity(part) in before, f"{part} was not synced before {path.name} appeared"
        after = self.events[named:]
        said = next((n for n, (kind, _) in enumerate(after) if kind == "said"), len(after))
        folders = [content[0] for kind, content in after[:said] if kind == "sync"]
        assert _identity(path.parent)[0] in folders, f"{path.parent} was not synced after {path.name} appeared"
        self.events.clear()


def _absolute(path: Path) -> str:
    return str(path.parent.resolve() / path.name)


def _identity(path: Path | int) -> tuple[int, int]:
    found = os.stat(path)
    return found.st_ino, 0 if os.path.isdir(path) else found.st_size


@contextmanager
def recorded_syncs(monkeypatch: pytest.MonkeyPatch) -> Iterator[Syncs]:
    """Record every fsync, rename and print of Python's; SQLite's own are not seen."""
    syncs = Syncs()
    fsync, say = os.fsync, builtins.print

    def noted(descriptor: int) -> None:
        fsync(descriptor)
        syncs.events.append(("sync", _identity(descriptor)))

    def renamed(rename: Callable[..., None]) -> Callable[..., None]:
        def noting(source: Any, target: Any, **places: Any) -> None:
            rename(source, target, **places)
            syncs.events.append(("name", _absolute(Path(target))))

        return noting

    def said(*words: Any, **options: Any) -> None:
        syncs.events.append(("said", words))
        say(*words, **options)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", noted)
        patch.setattr(os, "replace", renamed(os.replace))
        patch.setattr(os, "rename", renamed(os.rename))
        patch.setattr(builtins, "print", said)
        yield syncs
