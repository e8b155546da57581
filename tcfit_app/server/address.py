"""The address at which the review app listens, and the names by which browsers may reach it."""

import errno
import ipaddress
import re
import socket
from dataclasses import dataclass

from fitting_core.errors import InputError

PORTS_TRIED = 100
"""Number of ports tried, from the requested one upwards."""
_HOST_HEADER = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:[0-9]{1,5})?")


@dataclass(frozen=True, kw_only=True)
class Address:
    """An address that a socket is bound to."""

    asked: str
    """The requested host: a name or an address."""
    ip: ipaddress.IPv4Address | ipaddress.IPv6Address
    port: int

    @property
    def loopback(self) -> bool:
        """Whether it is reachable from this computer only."""
        return self.ip.is_loopback

    @property
    def url(self) -> str:
        """Its URL for a browser on this computer, without a trailing slash."""
        any_address = "127.0.0.1" if self.ip.version == 4 else "::1"
        return f"http://{_in_url(any_address if self.ip.is_unspecified else self.asked)}:{self.port}"

    def accepts(self, host_header: str) -> bool:
        """Whether a request's Host names this server.

        Anyone could point a name of theirs here (DNS rebinding), so only known names pass. Addresses cannot be
        misused: if other computers may connect, every address passes, because a container or router may translate
        ours. Any port passes, because an SSH tunnel may end at another one.
        """
        match = _HOST_HEADER.fullmatch(host_header.lower())
        if match is None:
            return False
        names = {"127.0.0.1", "localhost", "[::1]", _in_url(self.asked.lower())}
        if self.ip.is_unspecified:
            names.add(socket.gethostname().lower())
        return match[1] in names or (not self.loopback and ip_in(match[1].strip("[]")) is not None)


def listen(host: str, port: int) -> tuple[socket.socket, Address]:
    """A listening socket at the requested port (0: any), or at the next free one. Raises InputError if the host is not
    one of this computer's, or no port is free or allowed."""
    if not 0 <= port < 2**16:
        raise InputError(f"There is no port {port}. Give one from 1 to 65535, or 0 for any that is free.")
    try:
        family, _, _, _, (ip, *_) = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise InputError(f"The host {host!r} is not known here ({error}). {_HOSTS}") from error
    for candidate in range(port, min(port + PORTS_TRIED, 2**16)):
        try:
            listening = socket.create_server((ip, candidate), family=family)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            reason = error.strerror or error
            raise InputError(f"Cannot listen on {host}, port {candidate}: {reason}. {_HOSTS}") from error
        bound = listening.getsockname()[1]
        return listening, Address(asked=host, ip=ipaddress.ip_address(str(ip).split("%")[0]), port=bound)
    raise InputError(f"All ports from {port} to {candidate} are in use. Give another one with --port.")


_HOSTS = (
    "Give 127.0.0.1 (this computer only), an address of this computer, or 0.0.0.0 (all of them), and a port from 1024."
)


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def ip_in(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The IP address in a text, without its zone; None for other texts."""
    try:
        return ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return None
