"""What a hostile user, or a careless one, gives where a path is expected."""

import os
import socket
from collections.abc import Mapping
from pathlib import Path

LONG = "x" * 5_000


def hostile_paths(folder: Path) -> Mapping[str, str]:
    """Makes them in a new folder, each under a name that says what it is; those that cannot be made are texts."""
    folder.mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "nothing in it").mkdir()
    bytes_file = folder / os.fsdecode(b"caf\xe9")
    bytes_file.write_bytes(b"\x00\xff" * 300)
    (folder / "loop").symlink_to("loop")
    (folder / "text").write_text("no such format\n")
    (folder / "empty").touch()
    locked = folder / "locked"
    locked.write_text("nobody reads this")
    locked.chmod(0)
    listening = socket.socket(socket.AF_UNIX)
    # A socket's name may have 108 bytes: it is bound where it lies.
    here = os.open(".", os.O_RDONLY)
    os.chdir(folder)
    listening.bind("socket")
    os.fchdir(here)
    os.close(here)
    listening.close()
    return {
        "pipe": str(folder / "pipe"),
        "endless device": "/dev/zero",
        "full device": "/dev/full",
        "terminal": "/dev/tty",
        "socket": str(folder / "socket"),
        "folder": str(folder / "nothing in it"),
        "5,000 characters": LONG,
        "5,000 characters in a folder": f"{folder}/{LONG}",
        "no UTF-8": str(bytes_file),
        "nothing under a name that is no UTF-8": os.fsdecode(b"caf\xe8"),
        "home of nobody": "~nosuchuser/walk.mp4",
        "link to itself": str(folder / "loop"),
        "unreadable": str(locked),
        "below a file": str(folder / "text" / "walk"),
        "text": str(folder / "text"),
        "empty": str(folder / "empty"),
        "nothing": str(folder / "missing"),
        "no characters": "",
    }
