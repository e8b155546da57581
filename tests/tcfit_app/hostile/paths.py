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
    (folder / "dangling").symlink_to("nowhere")
    (folder / "round").mkdir()
    (folder / "round" / "again").symlink_to("..")
    for a, b in (("to", "fro"), ("fro", "to")):
        (folder / a).symlink_to(b)
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
        "links to each other": str(folder / "to"),
        "dangling link": str(folder / "dangling"),
        "folder that holds itself": str(folder / "round"),
        "endless ways into a folder": str(folder / "round" / "/".join(["again/round"] * 50)),
        "null byte": "walk\0.mp4",
        "line breaks": str(folder / "a\nb\r\x1b[31mc"),
        "process": "/proc/self/mem",
        "pages of a process": "/proc/self/pagemap",
        "open file": "/proc/self/fd/0",
        "kernel's log": "/proc/kmsg",
        "folder of the kernel": "/sys/kernel",
        "random device": "/dev/urandom",
        "unreadable": str(locked),
        "below a file": str(folder / "text" / "walk"),
        "text": str(folder / "text"),
        "empty": str(folder / "empty"),
        "nothing": str(folder / "missing"),
        "no characters": "",
    }
