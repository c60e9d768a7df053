"""A recording of the live page in a real browser: begun, ended, replayed, downloaded."""

import re

import pytest

from tests.web.browser import player, shoot, until, watched
from tests.web.test_page import restart


@pytest.fixture
def page(server, browser):
    """The page, paused, with one chain of 6 units."""
    with watched(browser, server, accept_downloads=True) as page:
        until(page, "live.connected && live.policy && !live.loading && live.chains.length")
        page.evaluate("live.send('pause', {on: true})")
        until(page, "live.paused")
        restart(page, 6)
        yield page


def step(page, count):
    before = page.evaluate("live.time")
    for _ in range(count):
        page.evaluate("live.send('step')")
    until(page, f"live.time > {before} + {0.1 * count - 0.05}")


def record_a_cut(page):
    """Records 3 steps of a chain and 4 of its parts; opens the replay."""
    page.click("#record")
    until(page, "document.getElementById('record').textContent.startsWith('Stop')")
    step(page, 3)
    page.evaluate("live.send('cut', {chain: live.chains[0].name, link: 2})")
    until(page, "live.chains.length === 2")
    step(page, 4)
    ends = page.evaluate("live.chains.map((chain) => chain.units[0].slice(0, 2))")
    page.click("#record")
    until(page, "document.getElementById('recorded').open")
    return ends


def test_when_it_stops_a_recording_is_replayed_cut_and_all(page):
    ends = record_a_cut(page)
    frame = player(page)
    assert frame.inner_text("#title") == "Recorded live"
    assert frame.inner_text("#about") == "0.7 s, up to 2 chains, steered by greedy"
    frame.evaluate("document.getElementById('play').click()")
    counts = frame.evaluate("""[0, 0.25, 0.3, 0.5, 0.7].map(
        (time) => Recorded.partsAt(replay.swims, time / 0.1).map((part) => part.length))""")
    assert counts == [[6], [6], [3, 3], [3, 3], [3, 3]]
    last = frame.evaluate("replay.swims.slice(1).map((part) => [part.x(4, 0), part.y(4, 0)])")
    for seen, true in zip(last, ends, strict=True):
        assert seen == pytest.approx(true, abs=3e-4)
    frame.locator("#scrub").fill("0.5")
    page.wait_for_timeout(300)
    shoot(page, "live-recorded")
    page.click("#recorded form button")
    assert not page.is_visible("#recorded")


def test_a_downloaded_recording_plays_without_the_server(page, browser, tmp_path):
    record_a_cut(page)
    with page.expect_download() as download:
        page.click("#download")
    assert re.fullmatch(r"salpchain-recording-\d+\.html", download.value.suggested_filename)
    path = tmp_path / "swim.html"
    download.value.save_as(path)
    page.click("#recorded form button")
    with watched(browser, path.as_uri(), offline=True) as alone:
        until(alone, "replay.state.time > 0.3")
        assert alone.inner_text("#about").startswith("0.7 s, up to 2 chains")


def test_keys_go_to_the_replay_while_it_is_open_and_a_button_brings_it_back(page):
    record_a_cut(page)
    page.keyboard.press("r")  # would reset the world
    step(page, 1)
    assert page.evaluate("live.chains.length") == 2
    page.keyboard.press("Escape")
    assert not page.is_visible("#recorded")
    page.click("#replay")
    assert player(page).inner_text("#title") == "Recorded live"
    page.keyboard.press("Escape")
    page.keyboard.press("v")
    until(page, "document.getElementById('record').textContent.startsWith('Stop')")
    page.keyboard.press("v")  # nothing swam: there is nothing to show
    until(page, "document.getElementById('toast').textContent.includes('nothing was recorded')")
    assert not page.is_visible("#recorded")


def test_another_browser_sees_that_it_is_recorded_and_gets_no_window(page, browser, server):
    with watched(browser, server) as other:
        until(other, "live.connected && live.chains.length")
        record_a_cut(page)
        until(other, "!document.getElementById('replay').hidden")
        assert other.inner_text("#record") == "Record"
        assert not other.is_visible("#recorded")
