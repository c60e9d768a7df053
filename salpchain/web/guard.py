"""Who may talk to the server, and how much: hosts, origins, sizes, rates."""

import ipaddress
import re
import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

from salpchain.errors import InputError

LARGEST_MESSAGE = 32 * 1024  # bytes; a drawing of 500 points takes 20 kB (chosen)
LARGEST_FRAME = 1024 * 1024  # bytes, beyond which a connection is closed at once (chosen)
PER_SECOND, BURST = 60.0, 120.0  # messages of one client; a drag sends one for each frame (chosen)
PATIENCE = 2000  # messages refused, after which the client is sent away (chosen)
FORGIVEN = 10  # refusals that each message within the allowance makes good (chosen)
MOST_CLIENTS = 32  # at once (chosen)

USUAL_PORTS = {"http": 80, "https": 443}
HOST = re.compile(r"[a-z0-9._-]+|[0-9a-f:.]*:[0-9a-f:.]*")  # a name, or an address of IPv6

Scope = MutableMapping[str, Any]
App = Callable[[Scope, Any, Any], Awaitable[None]]

HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self';"
        " connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none';"
        " frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-cache",
}


class Guard:
    """Refuses requests for another host name or from another origin, before anything else.

    A page of another site could otherwise talk to a server on this machine, by its address or by a
    name that its owner points at 127.0.0.1. Addresses written as numbers cannot be pointed.
    """

    def __init__(
        self, app: App, names: frozenset[str], origins: frozenset[str] = frozenset()
    ) -> None:
        """Guard an application.

        `names` are the host names that are ours besides localhost and numbers; `origins` (as
        `checked_origin` gives them) are those under which a reverse proxy shows the page.
        """
        self._app, self._names, self._origins = app, names | {"localhost"}, origins
        self._proxies = {urlsplit(origin).netloc for origin in origins}

    async def __call__(self, scope: Scope, receive: Any, send: Any) -> None:
        """Passes a request on, or answers 403."""
        if scope["type"] not in ("http", "websocket") or self._welcome(scope):
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _refuse(_with_headers(send))

    def _welcome(self, scope: Scope) -> bool:
        headers = [(name, value.decode("latin-1")) for name, value in scope["headers"]]
        hosts = [value for name, value in headers if name == b"host"]
        origins = [value for name, value in headers if name == b"origin"]
        if len(hosts) != 1:
            return False
        ours, proxied = self._ours(hosts[0]), hosts[0].lower() in self._proxies
        if not (ours or proxied):
            return False
        return all(
            origin in self._origins or (ours and _same_place(origin, hosts[0]))
            for origin in origins
        )

    def _ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return name in self._names or _is_number(name)


def checked_origin(text: str) -> str:
    """An origin as browsers write it: scheme, host and, unless it is the usual one, port.

    Raises:
        InputError: it is something else, such as an address with a path or a wildcard.
    """
    wrong = f"--allow-origin must be like https://lab.example.org, got {text!r}"
    try:
        parts = urlsplit(text)
        name, port = (parts.hostname or "").encode("idna").decode(), parts.port
    except (ValueError, UnicodeError):
        raise InputError(wrong) from None
    if parts.scheme not in USUAL_PORTS or not HOST.fullmatch(name):
        raise InputError(wrong)
    if parts.path not in ("", "/") or parts.query or parts.fragment or "@" in parts.netloc:
        raise InputError(f"{wrong}: an origin has no path, query or user")
    host = f"[{name}]" if ":" in name else name
    usual = port in (None, USUAL_PORTS[parts.scheme])
    return f"{parts.scheme}://{host}" + ("" if usual else f":{port}")


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _same_place(origin: str, host: str) -> bool:
    """Whether a page of this origin came from this host; `null` did not."""
    parts = urlsplit(origin)
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


def _with_headers(send: Any) -> Any:
    """Adds our headers to an answer, but those that it has already."""
    ours = {name.encode(): value.encode() for name, value in HEADERS.items()}

    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = message.get("headers", [])
            extra = [(name, ours[name]) for name in ours.keys() - {name for name, _ in own}]
            message = {**message, "headers": [*own, *extra]}
        await send(message)

    return sending


async def _refuse(send: Any) -> None:
    text = (
        b"salpchain live answers only to its own page, at the address that the terminal shows\n"
        b"(behind a reverse proxy: salpchain live --allow-origin https://lab.example.org)\n"
    )
    head = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": 403, "headers": head})
    await send({"type": "http.response.body", "body": text})


class Allowance:
    """How many messages a client may still send: so many a second, a few more at once."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """A full allowance."""
        self._clock, self._left, self._last = clock, BURST, clock()
        self.refused = 0

    def take(self) -> bool:
        """Whether one more message is allowed now."""
        now = self._clock()
        self._left = min(BURST, self._left + PER_SECOND * (now - self._last))
        self._last = now
        if self._left < 1:
            self.refused += 1
            return False
        self._left -= 1
        self.refused = max(0, self.refused - FORGIVEN)
        return True
