"""Access control of the review app: browsers admitted by a one-time link or a password, from the app's own page only.

viser itself answers any client, even a foreign web page in a browser on the same computer. The gate checks each request
first, for the page or the websocket. It cannot stop a reader of this user's terminal, memory or cookies; connections
between computers are not encrypted.
"""

import base64
import hmac
import ipaddress
import re
import secrets
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from http import HTTPStatus
from typing import Protocol
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from tcfit_app.server.address import Address, ip_in

PROTECTION = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of every answer: it is not stored, framed or embedded, and its address is not passed on."""

HOME = "/"
"""viser's page, which is a single file; of a site its own first page."""
NAME_CHARACTERS = 40
"""Maximum length of a sign-in name."""
_TOKEN_BYTES = 32
_PLACE = re.compile(r"(/|/[a-z]{1,20}/[0-9a-f]{1,64})(\?frame=-?[0-9]{1,15}(&(run|phase|person)=[0-9]{1,15})*)?")
"""A review's page, as it is or at a frame and a fit, as its links have it. No other query is for viser's page: with
"?websocket=" it would take orders from a foreign server."""

_TRIES, _MINUTE = 20, 60.0
"""Wrong passwords from one address within this many seconds, after which that address is locked out; others are not
affected."""
_PLACES = 1000
"""Addresses whose wrong passwords are remembered, the latest ones."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """Access for browsers on other computers."""

    password: str = ""
    """Admits any number of browsers; may be empty."""
    public: str = ""
    """The address under which a proxy offers the server, such as https://fits.example.org; may be empty."""

    @property
    def for_others(self) -> bool:
        """Whether browsers on other computers are expected. A proxy on this computer may then connect for them, so no
        connection proves that a browser is local."""
        return bool(self.password or self.public)

    def is_at(self, host_header: str) -> bool:
        """Whether a request's Host names the public address."""
        return bool(self.public) and host_header.lower() == urlsplit(self.public).netloc


class Site(Protocol):
    """Several reviews at paths of their own, and pages around them. All methods may be called from any thread."""

    def page(self, path: str) -> bytes | None:
        """The HTML page at a path, if any."""
        ...

    def has_review(self, path: str) -> bool:
        """Whether a review is at a path, as page and websocket."""
        ...

    def talks_at(self, path: str) -> bool:
        """Whether a websocket of its own pages is at a path."""
        ...


class Gate:
    """Answers the requests that must not reach viser.

    The link's token lets in one browser and is void from then on; a cookie stands for it, for as long as the process
    runs. It holds the sign-in name of a password user, sealed; it is the same for all that came by a link. There always
    is one unused link. Safe to use from several threads.
    """

    def __init__(
        self,
        address: Address,
        *,
        scripts: Mapping[str, bytes] | None = None,
        admitted: Callable[[], None] = lambda: None,
        entry: Entry | None = None,
        site: Site | None = None,
    ) -> None:
        """A gate that admits browsers with the link, or with the password if one is set.

        Args:
            address: Where the server listens.
            entry: Access for browsers on other computers.
            scripts: JavaScript modules by their paths, for browsers that were let in.
            admitted: Called after each new browser, when `link` is a fresh one.
            site: What is served; None: one review, at HOME.
        """
        self._address, self.entry, self.site = address, entry or Entry(), site
        self._wrong: OrderedDict[str, deque[float]] = OrderedDict()
        """Times of the last wrong passwords, by origin."""
        self._scripts = scripts or {}
        self._admitted = admitted
        # Cookies do not tell ports apart: without it two servers on one computer would overwrite each other's.
        self._cookie_name = f"tcfit-{address.port}"
        self._secret = secrets.token_bytes(_TOKEN_BYTES)
        self._token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._lock = threading.Lock()

    @property
    def link(self) -> str:
        """The link for the next browser."""
        with self._lock:
            return (self.entry.public or self._address.url) + self._entrance()

    def answer(self, request: Request, address: str = "") -> Response | None:
        """The answer to a request that must not reach viser; None if viser may answer."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        public = len(hosts) == 1 and self.entry.is_at(hosts[0])
        if len(hosts) != 1 or not (public or self._address.accepts(hosts[0])):
            return _page(HTTPStatus.MISDIRECTED_REQUEST, _WRONG_HOST)
        websocket = "Upgrade" in request.headers
        # Browsers send it with every websocket, but with pages only where one page asks for another.
        own = self.entry.public if public else f"http://{hosts[0]}"
        if (origins or websocket) and origins != [own]:
            return _page(HTTPStatus.FORBIDDEN, _FOREIGN)
        if self.name_of(request.headers) is not None:
            return self._lead(request.path, websocket)
        if not websocket and self._redeem(request.path):
            self._admitted()
            return self._welcome(request.path, secure=own.startswith("https:"))
        if (
            "?" in request.path
            and _PLACE.fullmatch(request.path)
            and "cross-site" in request.headers.get_all("Sec-Fetch-Site")
        ):
            return _going_on(request.path)  # a click in another page, with which the strict cookie does not come
        if self.entry.password and not websocket:
            place = _place(_sent_from(request.headers) or address if public else address)
            return self._ask(request, place, secure=own.startswith("https:"))
        return _page(HTTPStatus.FORBIDDEN, _UNKNOWN)

    def _ask(self, request: Request, place: str, *, secure: bool) -> Response:
        """Check the password, which the browser requests (RFC 7617); any name is accepted."""
        given = request.headers.get_all("Authorization")
        wrong, now = self._wrong.get(place, ()), time.monotonic()
        if len(wrong) == _TRIES and now - wrong[0] < _MINUTE:
            return _page(HTTPStatus.TOO_MANY_REQUESTS, _TOO_OFTEN, {"Retry-After": f"{_MINUTE:.0f}"})
        name, password = _signed_in(given[0]) if len(given) == 1 else ("", "")
        if given and _same(password, self.entry.password):
            return self._welcome(request.path, secure=secure, name=name)
        if given:
            with self._lock:
                self._wrong.setdefault(place, deque(maxlen=_TRIES)).append(now)
                self._wrong.move_to_end(place)
                if len(self._wrong) > _PLACES:
                    self._wrong.popitem(last=False)
        return _page(HTTPStatus.UNAUTHORIZED, _PASSWORD, {"WWW-Authenticate": 'Basic realm="tcfit", charset="UTF-8"'})

    def _lead(self, path: str, websocket: bool) -> Response | None:
        """None for the paths of viser's page; the answer for all others."""
        place = _PLACE.fullmatch(path)
        if place is not None and (path == place[1] or not websocket) and self._has_review(place[1]):
            return None
        if self.site is not None and websocket and self.site.talks_at(path):
            return None
        if self.site is not None and not websocket and (page := self.site.page(path)) is not None:
            return _answer(HTTPStatus.OK, page, {"Content-Type": "text/html; charset=utf-8"})
        if path in self._scripts and not websocket:
            return _answer(HTTPStatus.OK, self._scripts[path], {"Content-Type": "text/javascript; charset=utf-8"})
        plain, asked, _ = path.partition("?")
        if asked and not websocket and (plain == HOME or self._has_review(plain)):
            return _page(HTTPStatus.SEE_OTHER, "", {"Location": plain})  # viser adds a query of its own
        if path == "/favicon.ico" and not websocket:  # browsers ask by themselves, and complain of a 404
            return Response(HTTPStatus.NO_CONTENT, HTTPStatus.NO_CONTENT.phrase, Headers({"Connection": "close"}))
        return _page(HTTPStatus.NOT_FOUND, "Page not found. <a href='/'>Go to the start page.</a>")

    def _has_review(self, path: str) -> bool:
        return path == HOME if self.site is None else self.site.has_review(path)

    def name_of(self, headers: Headers) -> str | None:
        """The name of a signed-in user, empty for one who came by a link; None for a browser that was not let in."""
        cookies = [part.strip().partition("=") for line in headers.get_all("Cookie") for part in line.split(";")]
        for value in (value for name, _, value in cookies if name == self._cookie_name):
            name = _decoded(value.partition(".")[0])
            if _same(value, self._cookie(name)):
                return name
        return None

    def _cookie(self, name: str) -> str:
        """The cookie of a browser that was let in. Only this process can make it."""
        seal = hmac.new(self._secret, name.encode(), "sha256").hexdigest()
        return f"{base64.urlsafe_b64encode(name.encode()).decode().rstrip('=')}.{seal}"

    def _redeem(self, path: str) -> bool:
        with self._lock:
            if not _same(path, self._entrance()):
                return False
            self._token = secrets.token_urlsafe(_TOKEN_BYTES)
            return True

    def _entrance(self) -> str:
        return f"/?token={self._token}"

    def _welcome(self, path: str, *, secure: bool, name: str = "") -> Response:
        cookie = f"{self._cookie_name}={self._cookie(name)}; HttpOnly; SameSite=Strict; Path=/{'; Secure' * secure}"
        return _going_on(path if _PLACE.fullmatch(path) else HOME, {"Set-Cookie": cookie})


def _going_on(path: str, headers: dict[str, str] | None = None) -> Response:
    """A page that reloads itself at a path. It is not a redirect: after a click on a link in another page or program,
    browsers would follow a redirect without the strict cookie."""
    there = escape(path)
    going_on = f"<meta http-equiv='refresh' content='0; url={there}'><a href='{there}'>To the review.</a>"
    return _page(HTTPStatus.OK, going_on, headers)


def busy() -> Response:
    """The answer to a page for which there is no room."""
    return _page(HTTPStatus.SERVICE_UNAVAILABLE, "Too many tabs are open. Close one of them.")


def protect(headers: Headers) -> None:
    """Add PROTECTION to an answer's headers, in place."""
    for name, value in PROTECTION.items():
        if name in headers:
            del headers[name]
        headers[name] = value


def _sent_from(headers: Headers) -> str:
    """The browser's address as the proxy has it, which adds it behind what the browser itself may have sent."""
    return ",".join(headers.get_all("X-Forwarded-For")).rpartition(",")[2].strip()


def _place(address: str) -> str:
    """The origin to count by: an IPv4 address, or an IPv6 network, because a computer can take any address in it."""
    ip = ip_in(address)
    if ip is None:
        return address
    return str(ipaddress.ip_network((ip, 64), strict=False)) if ip.version == 6 else str(ip)


def _signed_in(authorization: str) -> tuple[str, str]:
    """Name (printable characters only) and password of a header Authorization; empty if missing."""
    scheme, _, code = authorization.partition(" ")
    try:
        text = base64.b64decode(code.strip(), validate=True).decode() if scheme.lower() == "basic" else ""
    except ValueError:
        return "", ""
    name, _, password = text.partition(":")
    return "".join(sign for sign in " ".join(name.split()) if sign.isprintable())[:NAME_CHARACTERS], password


def _decoded(name: str) -> str:
    """The name in a cookie; empty if it has none."""
    try:
        return base64.urlsafe_b64decode(name + "=" * (-len(name) % 4)).decode()
    except ValueError:
        return ""


def _same(found: str, expected: str) -> bool:
    """Compare in constant time; `found` may hold any characters."""
    return secrets.compare_digest(found.encode(errors="surrogateescape"), expected.encode())


def _page(status: HTTPStatus, text: str, headers: dict[str, str] | None = None) -> Response:
    body = f"<!doctype html><html lang='en'>{_HEAD}<p>{text}</p></html>\n".encode()
    return _answer(status, body, {"Content-Type": "text/html; charset=utf-8", **(headers or {})})


def _answer(status: HTTPStatus, body: bytes, headers: Mapping[str, str]) -> Response:
    fields = {"Content-Length": str(len(body)), "Connection": "close", **headers}
    return Response(status, status.phrase, Headers(fields), body)


_HEAD = (
    "<meta charset='utf-8'><meta name='viewport' content='width=device-width'><title>tcfit</title><style>"
    "html{color-scheme:light dark;font:1.1em/1.5 system-ui,sans-serif}body{max-width:36em;margin:20vh auto;padding:1em}"
    "</style>"
)
_UNKNOWN = (
    "This review opens through the link that tcfit printed where it was started. Each link works in one browser, "
    "once, and until tcfit is stopped; after each use a fresh one is printed."
)
_PASSWORD = "This review asks for its password. Reload the page to be asked again."
_TOO_OFTEN = "Too many wrong passwords came from your address. Try again in a minute."
_FOREIGN = "Refused: this request comes from another web page."
_WRONG_HOST = (
    "Refused: tcfit does not answer to this host name. Use the link as it was printed, or this computer's "
    "address in place of the name, or start tcfit with <code>--host</code> and this name."
)
