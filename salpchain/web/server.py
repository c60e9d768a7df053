"""The server of the live page: a few files, and one WebSocket for each browser."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from importlib.resources import files
from typing import TYPE_CHECKING

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.report.replay import content_policy
from salpchain.web import messages
from salpchain.web.guard import (
    LARGEST_FRAME,
    LARGEST_MESSAGE,
    MOST_CLIENTS,
    PATIENCE,
    Allowance,
    Guard,
)

if TYPE_CHECKING:
    from salpchain.web.engine import Engine
    from salpchain.world.config import WorldConfig

PAGE = {
    "/": ("salpchain.web", "static/live.html", "text/html"),
    "/live.js": ("salpchain.web", "static/live.js", "text/javascript"),
    "/tools.js": ("salpchain.web", "static/tools.js", "text/javascript"),
    "/recording.js": ("salpchain.web", "static/recording.js", "text/javascript"),
    "/line.js": ("salpchain.web", "static/line.js", "text/javascript"),
    "/live.css": ("salpchain.web", "static/live.css", "text/css"),
    "/look.css": ("salpchain.report", "page/look.css", "text/css"),
    "/drawing.js": ("salpchain.report", "page/drawing.js", "text/javascript"),
    "/surroundings.js": ("salpchain.report", "page/surroundings.js", "text/javascript"),
    "/icon.svg": ("salpchain.web", "static/icon.svg", "image/svg+xml"),
}
TRY_AGAIN = 1013  # WebSocket close code
ERRORS_AT_ONCE = 8  # that wait for one browser; more are dropped (chosen)


class Client:
    """One browser: the newest state that it has not got yet, and a few errors."""

    def __init__(self) -> None:
        """Nothing to send."""
        self.allowance = Allowance()
        self._state: bytes | None = None
        self._first: list[bytes] = []
        self._errors: list[bytes] = []
        self._news = asyncio.Event()

    def tell(self, message: bytes) -> None:
        """Sends a state soon; one that was not sent yet is left out, so a slow browser costs
        nothing."""
        self._state = message
        self._news.set()

    def greet(self, *messages: bytes) -> None:
        """Sends what a browser must have first, in this order."""
        self._first += messages
        self._news.set()

    def complain(self, text: str) -> None:
        """Sends an error soon."""
        if len(self._errors) < ERRORS_AT_ONCE:
            self._errors.append(messages.write("error", text=text))
            self._news.set()

    async def send_to(self, browser: WebSocket) -> None:
        """Sends what there is, for ever."""
        while True:
            await self._news.wait()
            self._news.clear()
            waiting = [*self._first, *self._errors, *([self._state] if self._state else [])]
            self._first, self._errors, self._state = [], [], None
            for message in waiting:
                await browser.send_text(message.decode())


class Live:
    """The application: it owns the engine and the browsers that watch."""

    def __init__(
        self,
        chosen: str = "",
        runs: StrPath = "",
        seed: int = 0,
        world: "WorldConfig | None" = None,
    ) -> None:
        """Nothing heavy is imported before the server runs."""
        self._asked = chosen, runs, seed, world
        self.engine: Engine | None = None
        self.clients: set[Client] = set()
        self.failure: Exception | None = None
        self.when_failed = lambda: None

    def app(
        self, names: frozenset[str] = frozenset(), origins: frozenset[str] = frozenset()
    ) -> Guard:
        """The ASGI application behind its guard; see `Guard` for the arguments."""
        pages = [Route(path, _file, methods=["GET"]) for path in PAGE]
        recordings = Route("/recordings/{number:int}.html", self._recording, methods=["GET"])
        routes = [*pages, recordings, WebSocketRoute("/swim", self._meet)]
        site = Starlette(routes=routes, lifespan=self._lifespan)
        site.router.redirect_slashes = False
        return Guard(site, names, origins)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        work = asyncio.create_task(self._swim())
        try:
            yield
        finally:
            work.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await work

    async def _swim(self) -> None:
        """Makes the engine (which imports JAX) in a thread, then swims; a failure ends it all."""
        try:
            self.engine = await asyncio.to_thread(self._make_engine)
            self.engine.watched = len(self.clients)
            for client in self.clients:
                self._greet(client)
            await self.engine.run()
        except Exception as error:
            self.failure = error
            self.when_failed()

    def _make_engine(self) -> "Engine":
        from pathlib import Path

        from salpchain.devices import use_devices
        from salpchain.web.engine import Engine
        from salpchain.web.fleet import Fleet

        use_devices()
        chosen, runs, seed, world = self._asked
        fleet = Fleet(chosen, Path(runs) if runs else None)
        return Engine(fleet, self._tell, self._complain, seed, world)

    def _tell(self, message: bytes) -> None:
        for client in self.clients:
            client.tell(message)

    def _complain(self, text: str) -> None:
        for client in self.clients:
            client.complain(text)

    def _greet(self, client: Client) -> None:
        assert self.engine is not None
        client.greet(self.engine.welcome(), self.engine.state())

    async def _meet(self, browser: WebSocket) -> None:
        """Talks with a browser until it goes."""
        await browser.accept()
        if len(self.clients) >= MOST_CLIENTS:
            text = f"{MOST_CLIENTS} browsers watch already: try again later"
            await browser.send_text(messages.write("error", text=text).decode())
            await browser.close(TRY_AGAIN)
            return
        client = Client()
        self.clients.add(client)
        sending = asyncio.create_task(client.send_to(browser))
        try:
            if self.engine:
                self.engine.watched = len(self.clients)
                self._greet(client)
            await self._listen(browser, client)
        except (WebSocketDisconnect, RuntimeError):
            pass  # it went, or was gone when something was to be sent
        finally:
            sending.cancel()
            self.clients.discard(client)
            if self.engine:
                self.engine.watched = len(self.clients)

    async def _listen(self, browser: WebSocket, client: Client) -> None:
        while True:
            text = await _next_text(browser)
            if not client.allowance.take():
                client.complain("too many messages: slow down")
                if client.allowance.refused > PATIENCE:
                    await browser.close(1008)
                    return
                continue
            self._answer(client, text)

    def _answer(self, client: Client, text: str | bytes) -> None:
        """Does what the text asks for, or says why not; nothing in it stops the loop."""
        if len(text) > LARGEST_MESSAGE:
            client.complain(f"a message has at most {LARGEST_MESSAGE} bytes, got {len(text)}")
            return
        try:
            message = messages.read(text)
            if self.engine is None:
                raise InputError("the engine is starting: wait a moment")
            self.engine.do(message)
        except (ValueError, InputError) as error:
            client.complain(str(error))

    async def _recording(self, request: Request) -> Response:
        """The replay page of a recording; the page may be shown within the live page."""
        number = request.path_params["number"]
        page = self.engine and self.engine.recordings.page(number)
        if not page:
            text = "there is no such recording (any more)\n"
            return Response(text, 404, media_type="text/plain; charset=utf-8")
        headers = {
            "content-security-policy": f"{content_policy()}; frame-ancestors 'self'",
            "x-frame-options": "SAMEORIGIN",
            "content-disposition": f'inline; filename="salpchain-recording-{number}.html"',
        }
        return Response(page, headers=headers, media_type="text/html; charset=utf-8")


async def _next_text(browser: WebSocket) -> str | bytes:
    message = await browser.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1000))
    return message.get("text") or message.get("bytes") or ""


async def _file(request: Request) -> Response:
    """One of the page's files; the path is looked up in a list, never on the disk."""
    package, name, kind = PAGE[request.url.path]
    return Response((files(package) / name).read_bytes(), media_type=f"{kind}; charset=utf-8")


def listen(host: str, port: int) -> socket.socket:
    """A socket that is bound; port 0 takes any free one.

    Raises:
        InputError: the port is in use (the message names the next free one) or may not be used,
            or the host is no address of this machine.
    """
    try:
        return _bound(host, port)
    except socket.gaierror:
        raise InputError(f"--host {host} is no name or address of this machine") from None
    except PermissionError:
        raise InputError(f"port {port} needs more rights: choose one from 1024 on") from None
    except OSError as error:
        free = _next_free(host, port + 1)
        if free is None:
            why = (error.strerror or str(error)).lower()
            raise InputError(f"cannot listen on {host}, port {port} ({why})") from None
        raise InputError(f"port {port} is in use: try --port {free}") from None


def _bound(host: str, port: int) -> socket.socket:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
        made.listen(128)
    except OSError:
        made.close()
        raise
    return made


def _next_free(host: str, first: int) -> int | None:
    for port in range(first, min(first + 100, 65536)):
        with contextlib.suppress(OSError):
            _bound(host, port).close()
            return port
    return None


def serve(live: Live, names: frozenset[str], origins: frozenset[str], bound: socket.socket) -> None:
    """Serves until interrupted.

    Raises:
        Exception: what made the engine fail, if it did.
    """
    config = uvicorn.Config(
        live.app(names, origins),
        log_level="warning",
        ws_max_size=LARGEST_FRAME,
        ws_max_queue=8,
        ws_ping_interval=20,
        ws_ping_timeout=20,
        limit_concurrency=4 * MOST_CLIENTS,
        timeout_graceful_shutdown=1,
        server_header=False,
    )
    server = uvicorn.Server(config)
    live.when_failed = lambda: setattr(server, "should_exit", True)
    server.run(sockets=[bound])
    if live.failure:
        raise live.failure
