"""The server's safety and manners, over real sockets: one server for nearly all tests."""

import asyncio
import json
import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from salpchain.controllers.released import released
from salpchain.errors import InputError
from salpchain.web import guard, messages, recorder, server
from salpchain.web.engine import HANDLERS
from tests.web.test_fleet import save_runs


@contextmanager
def served(live, **allowed):
    """An application on a free port of the loopback, in a thread; gives the port."""
    bound = server.listen("127.0.0.1", 0)
    config = uvicorn.Config(
        live.app(**allowed),
        log_level="error",
        ws_max_size=guard.LARGEST_FRAME,
        timeout_graceful_shutdown=1,
    )
    running = uvicorn.Server(config)
    thread = threading.Thread(target=running.run, kwargs={"sockets": [bound]})
    thread.start()
    try:
        until(lambda: running.started)
        yield bound.getsockname()[1]
    finally:
        running.should_exit = True
        thread.join(timeout=20)
        bound.close()


def until(condition, patience=60.0):
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    save_runs(runs)
    return server.Live("greedy", str(runs))


@pytest.fixture(scope="module")
def port(live):
    with served(live) as port:
        until(lambda: live.engine and not live.engine.loading)
        live.engine.do(messages.Pause(on=True))
        yield port


def get(port, path="/", **headers):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


@contextmanager
def client(port, **headers):
    with connect(f"ws://127.0.0.1:{port}/swim", additional_headers=headers) as socket:
        yield socket


def say(socket, kind, **content):
    socket.send(json.dumps({"type": kind, **content}))


def hear(socket, kind, patience=20.0):
    """The next message of a kind."""
    while True:
        message = json.loads(socket.recv(timeout=patience))
        if message["type"] == kind:
            return message


def test_a_browser_is_greeted_with_the_policies_and_the_world(port):
    with client(port) as socket:
        welcome, state = json.loads(socket.recv()), json.loads(socket.recv())
    own = [name for name in welcome["policies"] if name not in released()]
    assert welcome["type"] == "welcome" and own == [
        "greedy",
        "broken",
        "one",
        "approach",
        "caravan",
    ]
    assert state["type"] == "state" and len(state["chains"]) == 1
    assert len(state["chains"][0]["units"]) == len(state["chains"][0]["target"])


def test_every_edit_reaches_every_browser(port):
    with client(port) as one, client(port) as other:
        name = hear(one, "state")["chains"][0]["name"]
        say(one, "place", chain=name, x=1.5, y=-0.5, turn=0.3)
        while abs(hear(other, "state")["chains"][0]["turn"] - 0.3) > 1e-6:
            pass


BAD = [
    ("not json", "JSON"),
    ("", "truncated"),
    ("[]", "object"),
    ("{}", "type"),
    ('{"type": "explode"}', "explode"),
    ('{"type": "grow"}', "chain"),
    ('{"type": "grow", "chain": "1"}', "int"),
    ('{"type": "grow", "chain": -1}', ">= 0"),
    ('{"type": "grow", "chain": 1, "more": 1}', "more"),
    ('{"type": "grow", "chain": 12345}', "no chain 12345"),
    ('{"type": "place", "chain": 1, "x": 1e999, "y": 0, "turn": 0}', "out of range"),
    ('{"type": "place", "chain": 1, "x": NaN, "y": 0, "turn": 0}', "JSON"),
    ('{"type": "place", "chain": 1, "x": 1e6, "y": 0, "turn": 0}', "<= 1000"),
    ('{"type": "draw", "chain": 1, "points": [[0, 0]]}', "length >= 2"),
    ('{"type": "draw", "chain": 1, "points": [[0, 0], [0, 0, 0]]}', "length 2"),
    ('{"type": "pace", "speed": 0}', ">= 0.05"),
    ('{"type": "reset", "length": 500}', "at most 128"),
    ('{"type": "target", "chain": 12345}', "no chain 12345"),
    ('{"type": "record"}', "on"),
    ('{"type": "record", "on": 1}', "bool"),
    ('{"type": "record", "on": false}', "nothing is being recorded"),
    ('{"type": "steer", "policy": "/etc/passwd"}', "no such policy"),
    ('{"type": "steer", "policy": "../one"}', "no such policy"),
    ("[" * 20_000, ""),
    (b"\xff\xfe\x00", ""),
]


@pytest.mark.parametrize(("text", "says"), BAD, ids=[str(text)[:40] for text, _ in BAD])
def test_a_bad_message_gets_an_error_and_the_world_swims_on(port, text, says):
    with client(port) as socket:
        socket.send(text)
        assert says in hear(socket, "error")["text"]
        say(socket, "step")
        before = hear(socket, "state")["time"]
        say(socket, "step")
        while hear(socket, "state")["time"] <= before:
            pass


def test_an_oversized_message_gets_an_error_and_a_huge_one_ends_the_connection(port):
    with client(port) as socket:
        socket.send("x" * (guard.LARGEST_MESSAGE + 1))
        assert f"at most {guard.LARGEST_MESSAGE} bytes" in hear(socket, "error")["text"]
        say(socket, "step")
        with pytest.raises(ConnectionClosed):
            socket.send("x" * (guard.LARGEST_FRAME + 1))
            while True:
                socket.recv(timeout=10)
    assert get(port)[0] == 200


def test_too_many_messages_get_an_error_and_a_flood_ends_the_connection(port, monkeypatch):
    monkeypatch.setattr(guard, "FORGIVEN", 0)  # a machine with much to do makes a flood a trickle,
    monkeypatch.setattr(guard, "PER_SECOND", 1.0)  # and so do steps whose types are checked
    with client(port) as flood, client(port) as calm:
        with pytest.raises(ConnectionClosed):
            for _ in range(int(guard.BURST) + guard.PATIENCE + 2000):
                say(flood, "step")
            while True:
                flood.recv(timeout=60)
        say(calm, "step")
        hear(calm, "state")


def test_the_allowance_fills_up_again_with_time():
    now = [0.0]
    allowance = guard.Allowance(lambda: now[0])
    taken = sum(allowance.take() for _ in range(1000))
    assert taken == guard.BURST and allowance.refused == 1000 - taken
    now[0] = 1.0
    assert sum(allowance.take() for _ in range(1000)) == guard.PER_SECOND


STRANGE = [
    {"Host": "evil.example"},
    {"Host": "evil.example:8000"},
    {"Host": "localhost.evil.example"},
    {"Host": ""},
    {"Origin": "https://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:1"},
    {"Origin": "file://"},
]


@pytest.mark.parametrize("headers", STRANGE, ids=str)
def test_a_request_from_another_origin_or_for_another_host_is_refused(port, headers):
    status, text, _ = get(port, **headers)
    assert status in (400, 403) and "salp-live" not in text
    if "Origin" in headers:
        with pytest.raises(InvalidStatus) as refused, client(port, **headers):
            pass
        assert refused.value.response.status_code == 403


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]", "192.168.7.7"])
def test_the_pages_own_hosts_are_welcome(port, host):
    place = f"{host}:{port}"
    assert get(port, Host=place, Origin=f"http://{place}")[0] == 200
    assert get(port, Host=place, Origin=f"http://{place}.evil.example")[0] == 403


def test_a_foreign_host_cannot_open_the_channel(port):
    """By hand, as a client library writes the Host header itself."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as raw:
        lines = [
            "GET /swim HTTP/1.1", "Host: evil.example", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", "",
        ]  # fmt: skip
        raw.sendall("\r\n".join(lines).encode())
        assert raw.recv(4096).startswith(b"HTTP/1.1 403")


@pytest.mark.parametrize(
    "path",
    ["/etc/passwd", "/../server.py", "/%2e%2e/server.py", "/static/live.js", "/live.js/",
     "//live.js", "/live.js%00", "/..%2f..%2fpyproject.toml", "/swim", "/docs", "/openapi.json"],
)  # fmt: skip
def test_no_other_file_can_be_read(port, path):
    status, text, _ = get(port, path)
    assert status in (404, 403, 426, 400) and "import" not in text and "root:" not in text


def test_the_page_allows_no_script_but_its_own(port):
    for path in server.PAGE:
        status, text, headers = get(port, path)
        assert status == 200 and text
        assert "script-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    page = get(port)[1]
    assert "<script>" not in page and "onclick" not in page and "style=" not in page


def test_what_was_recorded_is_a_page_that_only_the_live_page_may_frame(port):
    with client(port) as socket:
        say(socket, "record", on=True)
        for _ in range(3):
            say(socket, "step")
        while hear(socket, "state")["recording"] != 0.3:
            pass
        say(socket, "record", on=False)
        while not (number := hear(socket, "state")["recorded"]):
            pass
    status, text, headers = get(port, f"/recordings/{number}.html")
    assert status == 200 and "Recorded live" in text
    (policy,) = headers.get_all("content-security-policy")
    assert "frame-ancestors 'self'" in policy and "unsafe" not in policy
    assert "default-src 'none'" in policy and "sha256-" in policy
    assert headers["x-frame-options"] == "SAMEORIGIN"
    assert headers["x-content-type-options"] == "nosniff"
    for path in (f"/recordings/{number + 1}.html", "/recordings/0.html", "/recordings/x.html",
                 "/recordings/-1.html", "/recordings/../live.js", "/recordings/"):  # fmt: skip
        assert get(port, path)[0] == 404
    assert get(port, f"/recordings/{number}.html", Origin="https://evil.example")[0] == 403


def test_a_full_recording_ends_and_every_browser_is_told(port, monkeypatch):
    monkeypatch.setattr(recorder, "LONGEST", 2)
    with client(port) as socket:
        before = hear(socket, "state")["recorded"]
        say(socket, "record", on=True)
        say(socket, "step")
        say(socket, "step")
        assert "a recording holds at most" in hear(socket, "error")["text"]
        while (state := hear(socket, "state"))["recorded"] == before:
            pass
        assert state["recording"] is None


def test_another_method_is_refused(port):
    request = urllib.request.Request(f"http://127.0.0.1:{port}/", data=b"x", method="POST")
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=10)
    assert refused.value.code == 405


def test_more_clients_than_allowed_are_told_so(port, live, monkeypatch):
    until(lambda: not live.clients)
    monkeypatch.setattr(server, "MOST_CLIENTS", 2)
    with client(port) as one, client(port), client(port) as third:
        hear(one, "state")
        assert "try again later" in hear(third, "error")["text"]
        with pytest.raises(ConnectionClosed) as closed:
            third.recv(timeout=10)
        assert closed.value.rcvd.code == server.TRY_AGAIN
    until(lambda: not live.clients)


def test_policies_are_switched_while_it_swims_and_a_broken_one_changes_nothing(port, live):
    with client(port) as socket:
        say(socket, "steer", policy="one")
        while hear(socket, "state", 60)["policy"] != "one":
            pass
        say(socket, "steer", policy="broken")
        assert "not a salpchain policy" in hear(socket, "error", 60)["text"]
        until(lambda: not live.engine.loading)
        assert live.engine.policy == "one"
        say(socket, "steer", policy="greedy")
        while hear(socket, "state", 60)["policy"] != "greedy":
            pass


def test_it_swims_at_its_pace_while_somebody_watches_and_rests_otherwise(port, live):
    until(lambda: not live.clients)
    with client(port) as socket:
        say(socket, "pause", on=False)
        start = hear(socket, "state")["time"]
        while hear(socket, "state")["time"] < start + 0.5:
            pass
    until(lambda: not live.clients)
    time.sleep(0.2)
    stopped = live.engine.world.time
    time.sleep(0.5)
    assert live.engine.world.time == stopped
    live.engine.do(messages.Pause(on=True))


def test_a_client_that_does_not_listen_holds_one_state_not_all():
    async def look():
        client = server.Client()
        for number in range(1000):
            client.tell(b"state %d" % number)
            client.complain("too fast")
        sent = []

        class Browser:
            async def send_text(self, text):
                sent.append(text)

        task = asyncio.create_task(client.send_to(Browser()))
        await asyncio.sleep(0.01)
        task.cancel()
        return sent

    sent = asyncio.run(look())
    assert len(sent) == server.ERRORS_AT_ONCE + 1 and sent[-1] == "state 999"


def test_the_schema_names_every_message_that_the_engine_knows():
    kinds = {kind["properties"]["type"]["enum"][0] for kind in messages.schema()["$defs"].values()}
    assert kinds == {kind.__struct_config__.tag for kind in HANDLERS}


def test_a_port_in_use_names_the_next_free_one():
    with server.listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"port {port} is in use: try --port \d+") as refused:
            server.listen("127.0.0.1", port)
        free = int(str(refused.value).rsplit(" ", 1)[1])
        server.listen("127.0.0.1", free).close()


def test_a_host_that_is_not_here_is_named():
    with pytest.raises(InputError, match="no name or address"):
        server.listen("no.such.host.invalid", 0)


def test_an_engine_that_fails_ends_the_server(monkeypatch, tmp_path):
    (tmp_path / "policy.safetensors").write_bytes(b"half")
    live, told = server.Live(str(tmp_path)), []
    live.when_failed = lambda: told.append(True)
    with served(live):
        until(lambda: told)
    assert "not a salpchain policy" in str(live.failure)
