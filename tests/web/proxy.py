"""A reverse proxy as laboratories have them: it shows a server under a path of its own."""

import asyncio
import contextlib
import re
import threading
from contextlib import contextmanager

PREFIX = "/lab/salps"


class Proxy:
    """Shows the server at port `upstream` (set it before use) under PREFIX of `address`.

    It takes the prefix off, as nginx does with `proxy_pass http://127.0.0.1:PORT/`, and passes
    WebSockets on; nothing else of the server is to be had. It tells the server the server's own
    host, unless it keeps the one that the browser asked for.
    """

    def __init__(self, keeps_host):
        self.upstream, self._keeps_host = None, keeps_host

    async def listen(self):
        listening = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.address = f"http://127.0.0.1:{listening.sockets[0].getsockname()[1]}"

    async def _serve(self, reader, writer):
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
            if head.startswith(f"GET {PREFIX}/"):
                await self._pass_on(self._rewritten(head), reader, writer)
            else:
                writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")
        writer.close()

    def _rewritten(self, head):
        """The head of a request without the prefix; one request for each connection."""
        head = head.replace(PREFIX, "", 1)
        if "upgrade: websocket" not in head.lower():
            head = re.sub(r"(?im)^connection:.*$", "Connection: close\r", head)
        own = f"Host: 127.0.0.1:{self.upstream}\r"
        return head if self._keeps_host else re.sub(r"(?im)^host:.*$", own, head, count=1)

    async def _pass_on(self, head, reader, writer):
        """Passes a request and all that follows on, in both directions, until one side ends."""
        theirs, ours = await asyncio.open_connection("127.0.0.1", self.upstream)
        ours.write(head.encode("latin-1"))

        async def pump(source, sink):
            with contextlib.suppress(ConnectionError):
                while data := await source.read(65536):
                    sink.write(data)
                    await sink.drain()

        both = [asyncio.create_task(pump(reader, ours)), asyncio.create_task(pump(theirs, writer))]
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        for task in both:
            task.cancel()
        ours.close()


@contextmanager
def reverse_proxy(keeps_host=False):
    """A proxy in a thread of its own."""
    loop, proxy = asyncio.new_event_loop(), Proxy(keeps_host)
    loop.run_until_complete(proxy.listen())
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    try:
        yield proxy
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
