"""The live page and the pictures: a step, the lag of a drag, many clients, start, drawing, soak.

python -m benchmarks.live [--minutes N] [--name NAME]

Each figure is taken with what a person would start: `salpchain live` in a process of its own. With
--minutes, five clients send random messages, valid and not, for so long; memory is read from /proc.
"""

import argparse
import json
import random
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax.random as jr
import numpy as np
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from benchmarks.run import add_options, begun
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import save_policy
from salpchain.evaluation.trajectory import Trajectory
from salpchain.files import write_json
from salpchain.networks.actor_critic import actor_critic
from salpchain.report.replay import page
from salpchain.report.video import Film, Picture

CLIENTS, WATCHED = 20, 10.0  # browsers, and for how many seconds
DRAGS, STEPS = 60, 200
CHROMIUM = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"]


@contextmanager
def served(policy: Path) -> Iterator[tuple[str, int, float]]:
    """The address, the process, and when it was started."""
    words = ["live", str(policy), "--port", "0"]
    begin = time.perf_counter()
    command = [sys.executable, "-m", "salpchain.cli.main", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        found = re.search(r"http://(\S+)", process.stdout.readline())
        assert found is not None
        yield found[1], process.pid, begin
    finally:
        process.terminate()
        process.wait(timeout=30)


def say(client: ClientConnection, kind: str, **content: Any) -> None:
    """Sends a message."""
    client.send(json.dumps({"type": kind, **content}))


def state_where(client: ClientConnection, good: Callable[[Any], bool]) -> Any:
    """The next state of which this is true."""
    while True:
        message = json.loads(client.recv(timeout=120))
        if message["type"] == "state" and good(message):
            return message


@contextmanager
def ready(address: str, length: int) -> Iterator[ClientConnection]:
    """A client of a world that swims with one chain."""
    with connect(f"ws://{address}/swim") as client:
        state_where(client, lambda state: state["policy"] and not state["loading"])
        say(client, "reset", length=length)
        state_where(client, lambda state: len(state["chains"][0]["units"]) == length)
        yield client


def first_picture(address: str, begin: float) -> dict[str, float]:
    """Seconds from the start of the command to the first state, and to the first stroke."""
    with connect(f"ws://{address}/swim") as client:
        state_where(client, lambda state: True)
        shown = time.perf_counter() - begin
        state_where(client, lambda state: state["time"] > 0)
        return {"chain_shown": shown, "chain_swims": time.perf_counter() - begin}


def step_time(address: str, length: int) -> float:
    """Median time (ms) that the server needs for a control step, policy and packing included."""
    with ready(address, length) as client:
        say(client, "pace", speed=4)
        took = [state_where(client, lambda _: True)["took"] for _ in range(STEPS)]
        say(client, "pace", speed=1)
    return statistics.median(took)


def drag_lag(address: str) -> float:
    """Median time (ms) from sending a target to the state that has it."""
    lags = []
    with ready(address, 16) as client:
        name = state_where(client, lambda _: True)["chains"][0]["name"]
        for index in range(DRAGS):
            turn, begin = 0.01 * (index + 1), time.perf_counter()
            say(client, "place", chain=name, x=0.5, y=0.0, turn=turn)
            state_where(client, lambda s, turn=turn: abs(s["chains"][0]["turn"] - turn) < 1e-6)
            lags.append(time.perf_counter() - begin)
            time.sleep(0.03)
    return 1e3 * statistics.median(lags)


def drag_to_pixel(address: str) -> float:
    """Median time (ms) from a pointer's move to the frame that shows the server's answer."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=CHROMIUM)
        view = browser.new_page()
        view.goto(f"http://{address}")
        while not view.evaluate("live.frames > 10 && !live.loading"):
            view.wait_for_timeout(50)
        view.evaluate("live.following = false")
        x, y = view.evaluate("live.camera.toScreen(...live.chains[0].target[2])")
        top = view.locator("#water").bounding_box()["y"]  # type: ignore[index]
        view.mouse.move(x, y + top)
        view.mouse.down()
        for index in range(DRAGS):
            view.mouse.move(x + index, y + top)
            view.wait_for_timeout(30)
        view.mouse.up()
        lags = view.evaluate("live.lags")
        browser.close()
    return statistics.median(lags)


def many_clients(address: str) -> dict[str, float]:
    """States per second of the slowest of many browsers, and the step's time meanwhile."""
    heard: list[list[tuple[float, float]]] = [[] for _ in range(CLIENTS)]

    def watch(mine: list[tuple[float, float]]) -> None:
        with connect(f"ws://{address}/swim") as client:
            barrier.wait()
            end = time.monotonic() + WATCHED
            while time.monotonic() < end:
                message = json.loads(client.recv(timeout=10))
                if message["type"] == "state":
                    mine.append((time.monotonic(), message["took"]))

    barrier = threading.Barrier(CLIENTS)
    threads = [threading.Thread(target=watch, args=(mine,)) for mine in heard]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    rates = [(len(mine) - 1) / (mine[-1][0] - mine[0][0]) for mine in heard]
    return {
        "clients": CLIENTS,
        "slowest_states_per_second": min(rates),
        "step_ms": statistics.median(took for mine in heard for _, took in mine),
    }


def drawing() -> dict[str, float]:
    """Frames drawn each second (wall and CPU) at 1280 x 720 for 16 units; the size of a replay."""
    picture = Picture([_made(16, 200)], Film())
    begin, cpu = time.perf_counter(), time.thread_time()
    for index in range(200):
        picture.at(0.1 * index)
    wall, cpu = time.perf_counter() - begin, time.thread_time() - cpu
    size = len(page([_made(64, 513)])) / 1e6
    return {"frames_per_s": 200 / wall, "frames_per_cpu_s": 200 / cpu, "replay_64_units_mb": size}


def _made(length: int, times: int) -> Trajectory:
    """A chain that wriggles; nothing is known of its velocities."""
    dice, links = np.random.default_rng(0), length - 1
    unit = np.cumsum(dice.normal(0, 0.01, (times, length, 2)), axis=0)
    unit[..., 0] += 0.07 * np.arange(length)

    def none(count: int, *more: int) -> np.ndarray:
        return np.zeros((times, count, *more))

    return Trajectory(
        "made", 0, 0, "fixed", length, 0.1, True, unit, none(length), none(length, 2),
        none(length), none(links, 2), none(links), none(links, 2), none(links),
        dice.uniform(-1, 1, (times - 1, length)), np.zeros(times - 1), unit[-1],
    )  # fmt: skip


def soak(address: str, pid: int, minutes: float) -> dict[str, Any]:
    """Five clients at random; memory (MB) after the first tenth and at the end, and the rest."""
    end, counts = time.monotonic() + 60 * minutes, [0] * 5
    threads = [threading.Thread(target=_pester, args=(address, k, end, counts)) for k in range(5)]
    for thread in threads:
        thread.start()
    process, sizes = psutil.Process(pid), []
    while time.monotonic() < end:
        time.sleep(min(5.0, 6 * minutes))
        sizes.append(process.memory_info().rss / 1e6)
    for thread in threads:
        thread.join()
    settled = statistics.median(sizes[len(sizes) // 5 : len(sizes) // 5 + 3])
    with connect(f"ws://{address}/swim") as client:
        state_where(client, lambda _: True)
    return {
        "minutes": minutes,
        "messages": sum(counts),
        "memory_mb": [round(size) for size in sizes],
        "growth": sizes[-1] / settled - 1,
        "alive": process.is_running(),
    }


def _pester(address: str, seed: int, end: float, counts: list[int]) -> None:
    """Random messages, one in four broken; now and then a new connection."""
    dice = random.Random(seed)
    while time.monotonic() < end:
        try:
            with connect(f"ws://{address}/swim") as client:
                names = [0]
                for _ in range(dice.randint(1, 200)):
                    client.send(_random_message(dice, names))
                    counts[seed] += 1
                    time.sleep(dice.uniform(0.01, 0.05))
                    names = _names(client) or names
                    if time.monotonic() > end:
                        return
        except (ConnectionClosed, OSError):
            time.sleep(0.1)


def _names(client: ClientConnection) -> list[int]:
    """Of the chains in the newest state that has come, if any."""
    names: list[int] = []
    try:
        while True:
            message = json.loads(client.recv(timeout=0))
            if message["type"] == "state":
                names = [chain["name"] for chain in message["chains"]]
    except TimeoutError:
        return names


def _random_message(dice: random.Random, names: list[int]) -> str:
    def place() -> float:
        return dice.uniform(-2, 2)

    one, other = dice.choice(names), dice.choice([*names, 99_999])
    made: list[dict[str, Any]] = [
        {"type": "place", "chain": one, "x": place(), "y": place(), "turn": place()},
        {"type": "draw", "chain": one, "points": [[place(), place()] for _ in range(9)]},
        {"type": "grow", "chain": one},
        {"type": "shrink", "chain": one},
        {"type": "cut", "chain": one, "link": dice.randint(0, 20)},
        {"type": "join", "chain": one, "other": other},
        {"type": "push", "chain": one, "unit": dice.randint(0, 12), "x": place(), "y": 1},
        {"type": "thruster", "chain": one, "unit": 1, "on": dice.random() < 0.8},
        {"type": "flow", "x": dice.uniform(-0.2, 0.2), "y": 0},
        {"type": "pause", "on": False},
        {"type": "target", "chain": one},
        {"type": "record", "on": dice.random() < 0.5},
        {"type": "steer", "policy": dice.choice(["greedy", "policy", "none"])},
        {"type": "pace", "speed": dice.choice([0.5, 1, 4, 40])},
    ]
    if dice.random() < 0.02:
        made = [{"type": "reset", "length": dice.randint(2, 128)}]
    text = json.dumps(dice.choice(made))
    broken = [text[: dice.randint(0, len(text))], "[" * 5000, "x" * 40_000, '{"type": 1}']
    return text if dice.random() < 0.75 else dice.choice(broken)


def main() -> None:
    """Measures and writes the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.0)
    add_options(parser)
    asked = parser.parse_args()
    path_of_record, results = begun("live", asked, minutes=asked.minutes)
    with tempfile.TemporaryDirectory() as folder:
        path, card = Path(folder) / "policy.safetensors", PolicyCard(name="fresh")
        save_policy(Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card), path)
        results |= {"drawing": drawing(), **_live(path, asked.minutes)}
    write_json(path_of_record, results)
    print(json.dumps({k: v for k, v in results.items() if k != "machine"}, indent=2))


def _live(policy: Path, minutes: float) -> dict[str, Any]:
    with served(policy) as (address, pid, begin):
        results: dict[str, Any] = {
            "first_picture_s": first_picture(address, begin),
            "step_ms": {length: step_time(address, length) for length in (16, 64, 128)},
            "drag_to_state_ms": drag_lag(address),
            "drag_to_pixel_ms": drag_to_pixel(address),
            "many_clients": many_clients(address),
        }
        if minutes:
            results["soak"] = soak(address, pid, minutes)
    return results


if __name__ == "__main__":
    main()
