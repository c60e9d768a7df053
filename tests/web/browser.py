"""Chromium of the system, driven by Playwright, and a server of ours for it."""

import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

from salpchain.cli.main import run

SHOTS = Path(__file__).parent.parent.parent / "artefacts"  # ignored by git; kept for people
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def chromium():
    """The path of the system's Chromium; the Makefile installs it where it can."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    pytest.fail("no Chromium on this machine: Debian has it as `apt-get install chromium`")


@contextmanager
def open_browser():
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=QUIET, headless=True)
        yield browser
        browser.close()


@contextmanager
def watched(browser, address, **look):
    """A page at an address; at the end, nothing must have gone wrong in its console."""
    context = browser.new_context(**{"viewport": {"width": 1000, "height": 700}, **look})
    page = context.new_page()
    page.set_default_timeout(30_000)
    page.wrong = []
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    page.on("console", lambda said: said.type == "error" and page.wrong.append(said.text))
    page.goto(address)
    yield page
    context.close()
    assert page.wrong == []


def until(page, condition, patience=30.0):
    """Waits for a condition; Playwright's own waiting evaluates text, which our pages forbid."""
    end = time.monotonic() + patience
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"never came true: {condition}"
        page.wait_for_timeout(20)


def player(page, patience=30.0):
    """The replay within the live page, once it is there."""
    end = time.monotonic() + patience
    while not (frames := [frame for frame in page.frames if "/recordings/" in frame.url]):
        assert time.monotonic() < end, "no replay was opened"
        page.wait_for_timeout(20)
    until(frames[0], "window.replay !== undefined")
    return frames[0]


def shoot(page, name):
    SHOTS.mkdir(exist_ok=True)
    page.screenshot(path=SHOTS / f"{name}.png")


@contextmanager
def live_server(*words, port=0):
    """`salpchain live` in a process of its own; gives its address."""
    command = [sys.executable, "-m", "salpchain.cli.main", "live", "--port", str(port), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        yield re.search(r"http://\S+", line)[0], process
    finally:
        process.terminate()
        process.wait(timeout=20)


def command(*words):
    assert run([str(word) for word in words]) == 0
