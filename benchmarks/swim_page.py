"""What the swim page costs: `python -m benchmarks.swim_page` writes swim-page-NAME.json.

Bytes, seconds to the first stroke, frames per second, milliseconds of a control step, and how many
episodes the page takes to their goal of those that Python plays from the same starts: in the
system's Chromium without a screen, opened from disk. `--success` measures the last alone.
"""

import argparse
import gzip
import json
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from salpchain.machine import processor
from salpchain.web.swim_page import swim_page
from tests.web.browser import QUIET, chromium
from tests.web.episodes import episodes, python_plays

RESULTS = Path(__file__).parent / "results"
EPISODES, PLAYED = 100, (8, 32)  # of each of these lengths
SECONDS = 10  # of swimming that is watched, for each length
STROKE = """() => new Promise((done) => {
    const look = () => {
        const pushes = window.live?.chains.some((c) => c.units.some((u) => Math.abs(u[3]) > 0.01));
        if (pushes && live.frames > 0) requestAnimationFrame(() => done(performance.now()));
        else requestAnimationFrame(look);
    };
    look();
})"""
WATCH = """(seconds) => new Promise((done) => {
    const begin = performance.now(), first = live.frames, took = [];
    let seen = live.states;
    const look = () => {
        if (live.states !== seen) { took.push(live.took); seen = live.states; }
        const passed = (performance.now() - begin) / 1000;
        if (passed < seconds) requestAnimationFrame(look);
        else done({ frames: (live.frames - first) / passed, states: took.length / passed, took });
    };
    look();
})"""


def swims(page: Page, length: int) -> dict[str, float]:
    """A chain of this length in contact with itself: it is drawn to a ring of three turns."""
    page.evaluate("(length) => live.send('scene', {length, seed: 2})", length)
    wait(page, f"live.chains[0].units.length === {length}")
    page.evaluate(COIL, length)
    page.wait_for_timeout(3000)
    seen = page.evaluate(WATCH, SECONDS)
    took = sorted(seen["took"])
    return {
        "frames per second": round(seen["frames"], 1),
        "control steps per second": round(seen["states"], 1),
        "step, median, ms": round(statistics.median(took), 2),
        "step, 95 %, ms": round(took[int(0.95 * len(took))], 2),
    }


# Some episodes at a time, so that the page goes on between them.
PLAY = """async ({ file, starts, limit }) => {
    const policy = Policy.fromFile(Salp.bytes(file)), found = [];
    live.send("pause", { on: true });
    for (const one of starts) {
        found.push(Tank.play(policy, one, limit).success);
        await new Promise((done) => setTimeout(done, 0));
    }
    return found;
}"""


def succeeds(page: Page, length: int) -> dict[str, object]:
    """How many episodes the page takes to their goal, and Python from the same starts."""
    data, states = episodes(length, EPISODES)
    here = page.evaluate(PLAY, data)
    there = python_plays(length, states).tolist()
    alike = sum(one == other for one, other in zip(here, there, strict=True))
    return {"episodes": EPISODES, "page": sum(here), "Python": sum(there), "alike": alike}


COIL = """(length) => {
    const points = [[0, 0]];
    let angle = 0;
    for (let i = 1; i < length; i++) {
        angle += 0.9;
        const [x, y] = points[i - 1];
        points.push([x + 0.07 * Math.cos(angle), y + 0.07 * Math.sin(angle)]);
    }
    live.send("draw", {chain: live.chains[0].name, points});
}"""


def wait(page: Page, condition: str) -> None:
    """Waits for a condition in the page, whose own policy forbids Playwright's waiting."""
    while not page.evaluate(condition):
        page.wait_for_timeout(20)


@contextmanager
def opened() -> Iterator[tuple[Page, str]]:
    """A page of the browser, and the address of the swim page on disk."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        file = Path(folder) / "index.html"
        file.write_text(swim_page())
        browser = playwright.chromium.launch(executable_path=chromium(), args=QUIET)
        yield browser.new_page(viewport={"width": 1280, "height": 720}), file.as_uri()
        browser.close()


def costs() -> dict[str, object]:
    """Bytes, seconds and frames."""
    text = swim_page().encode()
    with opened() as (page, address):
        strokes = []
        for _ in range(6):
            page.goto("about:blank")
            page.goto(address)
            strokes.append(page.evaluate(STROKE) / 1000)
        lengths = {str(length): swims(page, length) for length in (16, 64, 128)}
    return {
        "bytes": len(text),
        "bytes, gzip": len(gzip.compress(text)),
        "first stroke, s, median of 5, warm": round(statistics.median(strokes[1:]), 3),
        "first stroke, s, cold": round(strokes[0], 3),
        "by units": lengths,
    }


def success() -> dict[str, object]:
    """Episodes by units, and where they were played."""
    with opened() as (page, address):
        page.goto(address)
        wait(page, "live.states > 2")
        found = {str(length): succeeds(page, length) for length in PLAYED}
        version = page.context.browser.version if page.context.browser else ""
    return {"success by units": found, "browser": f"Chromium {version}", "processor": processor()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--name", default="here")
    parser.add_argument("--success", action="store_true", help="keep the other figures")
    words = parser.parse_args()
    file = RESULTS / f"swim-page-{words.name}.json"
    known = json.loads(file.read_text()) if words.success and file.exists() else costs()
    found = known | success()
    file.write_text(json.dumps(found, indent=2))
    print(json.dumps(found, indent=2))
