"""The files of this computer that a page may name.

The gate admits browsers to one project, not to everything that the user may read. A path typed into a page counts only
if the browser runs on this computer, or if the server was started with a folder for such
paths.
"""

import ipaddress
import os
import stat
from dataclasses import dataclass
from pathlib import Path

from websockets.datastructures import Headers

from fitting_core.errors import InputError
from tcfit_app.server.address import ip_in

_LONGEST = 4096
"""Maximum length of a path on Linux, in characters."""
_FORWARDED = ("Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "X-Real-IP")
"""Headers by which a proxy on this computer reveals remote browsers."""


def on_this_computer(address: str, headers: Headers) -> bool:
    """Whether a request comes from this computer itself.

    Args:
        address: The other end of its connection; headers are not trusted for it.
        headers: The request's; one from a proxy counts as remote.
    """
    ip = ip_in(address)
    if isinstance(ip, ipaddress.IPv6Address) and ip.ipv4_mapped is not None:
        ip = ip.ipv4_mapped
    return ip is not None and ip.is_loopback and not any(name in headers for name in _FORWARDED)


@dataclass(frozen=True, kw_only=True)
class PageFiles:
    """The files that one page may name."""

    here: bool
    """Whether the page is open on this computer."""
    root: Path | None = None
    """Folder to which all pages are restricted; None: pages on this computer may name any file."""

    def path(self, text: str) -> Path:
        """The path that a user typed; it need not exist. Raises InputError if it is no path, leads to something that is
        neither a file nor a folder, or is not allowed here.

        Args:
            text: May be quoted, may begin with ~; with a folder for such paths it may be relative to that.
        """
        given = text.strip().strip("\"'")
        if self.root is None and not self.here:
            raise InputError(
                "Paths are only taken from a browser on the computer that runs tcfit. Upload the file instead, or have "
                "tcfit started with --files DIR, a folder that all pages may use."
            )
        if not given or len(given) > _LONGEST:
            raise InputError(f"The path has {len(given)} characters; expected 1 to {_LONGEST}.")
        try:
            path = Path(given).expanduser()
            path = path if self.root is None else _below(self.root.resolve(), path)
            special = _is_special(path)
        except InputError:  # is a ValueError, too
            raise
        except (OSError, RuntimeError, ValueError) as error:  # a name too long, ~ of an unknown user, a circle of links
            raise InputError(f"{given[:200]!r} cannot be looked for: {error}.") from error
        if special:
            raise InputError(f"{path}: is neither a file nor a folder; expected a file or a folder.")
        return path


def _is_special(path: Path) -> bool:
    """Whether it is a pipe, device or the like, which may have no end."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _below(root: Path, given: Path) -> Path:
    """A path in a folder, links followed; the existence of paths outside is not revealed."""
    path = (root / given).resolve()
    if not (path.is_relative_to(root) and all(place.is_relative_to(root) for place in _links_in(path))):
        raise InputError(f"{given}: does not lie in {root}. Put it there, or upload it.")
    return path


def _links_in(folder: Path) -> list[Path]:
    """Where the links in a folder lead; empty for a file."""
    if not folder.is_dir():
        return []
    with os.scandir(folder) as entries:
        return [Path(entry.path).resolve() for entry in entries if entry.is_symlink()]
