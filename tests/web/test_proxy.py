"""The live page behind a reverse proxy that shows it under a path, and who may then connect."""

from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from salpchain.errors import InputError
from salpchain.web import guard, server
from tests.web.browser import live_server, open_browser, player, until
from tests.web.proxy import PREFIX, reverse_proxy
from tests.web.test_server import get, served

SWIMS = "live.connected && live.policy && !live.loading && live.frames > 3 && live.chains.length"


@pytest.mark.parametrize("keeps_host", [False, True], ids=["own host", "host kept"])
def test_under_a_path_the_page_and_its_channel_work_and_ask_for_nothing_outside(keeps_host):
    asked = []
    with reverse_proxy(keeps_host) as proxy, open_browser() as browser:
        words = [] if keeps_host else ["--allow-origin", proxy.address]
        with live_server("greedy", *words) as (address, _):
            proxy.upstream = urlsplit(address).port
            page = browser.new_page()
            page.on("request", lambda request: asked.append(request.url))
            page.on("websocket", lambda socket: asked.append(socket.url))
            page.goto(f"{proxy.address}{PREFIX}/")
            until(page, SWIMS)
            page.evaluate("live.send('reset', {length: 5})")
            until(page, "live.chains[0].units.length === 5")
            page.click("#record")
            until(page, "document.getElementById('record').textContent > 'Stop 0.1'")
            page.click("#record")
            player(page)
    assert any(url.startswith("ws:") for url in asked) and len(asked) > len(server.PAGE)
    place = urlsplit(proxy.address).netloc
    assert all(urlsplit(url).netloc == place for url in asked)
    assert all(urlsplit(url).path.startswith(f"{PREFIX}/") for url in asked)


@pytest.fixture(scope="module")
def port():
    """Of an application that a proxy shows under https://lab.example.org."""
    with served(server.Live("greedy"), origins=frozenset({"https://lab.example.org"})) as port:
        yield port


WELCOME = [
    {"Origin": "https://lab.example.org"},  # the proxy tells the server's own host
    {"Origin": "https://lab.example.org", "Host": "lab.example.org"},  # or the browser's
    {"Host": "lab.example.org"},  # the page itself, without an origin
    {},
]
STRANGE = [
    {"Origin": "http://lab.example.org"},
    {"Origin": "http://lab.example.org", "Host": "lab.example.org"},
    {"Origin": "https://lab.example.org:8443"},
    {"Origin": "https://lab.example.org.evil.example"},
    {"Origin": "https://evil.example", "Host": "lab.example.org"},
    {"Origin": "null", "Host": "lab.example.org"},
    {"Host": "lab.example.org:8443"},
    {"Host": "evil.lab.example.org"},
]


@pytest.mark.parametrize("headers", WELCOME, ids=str)
def test_an_origin_that_was_allowed_may_connect(port, headers):
    assert get(port, **headers)[0] == 200
    origin = {name: value for name, value in headers.items() if name == "Origin"}
    with connect(f"ws://127.0.0.1:{port}/swim", additional_headers=origin):
        pass


@pytest.mark.parametrize("headers", STRANGE, ids=str)
def test_no_other_origin_nor_host_may_connect(port, headers):
    assert get(port, **headers)[0] == 403
    if "Host" not in headers:
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{port}/swim", additional_headers=headers)


ORIGINS = {
    "https://lab.example.org": "https://lab.example.org",
    "HTTPS://Lab.Example.org:443/": "https://lab.example.org",
    "http://lab:8080": "http://lab:8080",
    "http://[::1]:80": "http://[::1]",
    "https://bücher.example": "https://xn--bcher-kva.example",
}


@pytest.mark.parametrize(("text", "origin"), ORIGINS.items())
def test_an_origin_is_taken_as_browsers_write_it(text, origin):
    assert guard.checked_origin(text) == origin


@pytest.mark.parametrize(
    "text",
    ["*", "null", "lab.example.org", "https://", "https://*.example.org", "ftp://lab.example.org",
     "https://lab.example.org/salps", "https://lab.example.org?x", "https://me@lab.example.org",
     "https://lab.example.org:99999", "https://lab .example.org", "https://[::1", "https://a..b"],
)  # fmt: skip
def test_what_is_no_origin_is_refused(text):
    with pytest.raises(InputError, match="--allow-origin must be like https:"):
        guard.checked_origin(text)
