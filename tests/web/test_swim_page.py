"""The swim page in a real browser, opened from disk: no server, no network."""

import gzip
import re

import numpy as np
import pytest

import salpchain
from salpchain.controllers.storage import save_policy
from salpchain.web import swim_page
from tests.web.browser import shoot, until, watched

MOST = 600_000  # bytes of everything that the page loads, compressed
SWIMS = "live.connected && live.states > 2 && live.chains.length"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    place = tmp_path_factory.mktemp("site") / "index.html"
    place.write_text(swim_page.swim_page())
    return place


@pytest.fixture(scope="module")
def address(path):
    return path.as_uri()


@pytest.fixture
def page(address, browser):
    with watched(browser, f"{address}#length=8&seed=3") as page:
        until(page, SWIMS)
        yield page


def middle_of(page, what):
    return np.array(page.evaluate(f"Tools.middle(live.chains[0].{what})"))


def says(page, words):
    until(page, f"document.getElementById('toast').textContent.includes({words!r})")


def test_the_page_is_one_small_file_that_names_no_other_host(path):
    text = path.read_text()
    assert len(gzip.compress(text.encode())) < MOST
    named = set(re.findall(r"https?://[^\s\"'<>)]+", text))
    assert named <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<(?:script|link|img|iframe)[^>]+\b(?:src|href)=\"(?!data:)", text)


def test_it_swims_from_disk_and_arrives(page):
    assert page.evaluate("live.chains[0].units.length") == 8
    assert page.inner_text("#length") == "8 units"
    page.evaluate("live.send('pace', {speed: 4})")
    until(page, "live.chains[0].arrived !== null", patience=60)
    assert page.evaluate("Math.max(...live.chains[0].units.map((u) => Math.abs(u[3])))") > 0
    shoot(page, "swim-arrived")


def test_no_other_host_can_be_reached_nor_a_script_be_added(page):
    reached = page.evaluate("""async () => {
        const broken = [];
        document.addEventListener("securitypolicyviolation", (event) => {
            broken.push(event.violatedDirective);
        });
        const fetched = await fetch("https://example.org/").then(() => "yes", () => "no");
        const script = document.createElement("script");
        script.textContent = "window.ran = true";
        document.body.append(script);
        await new Promise((done) => setTimeout(done, 50));
        const connect = broken.some((name) => name.startsWith("connect"));
        return [fetched, window.ran ?? "no", connect];
    }""")
    assert reached == ["no", "no", True]
    page.wrong.clear()  # the browser tells of each


def test_the_tools_of_the_live_page_work(page):
    page.evaluate("live.send('pause', {on: true})")
    until(page, "live.paused")
    before = middle_of(page, "target")
    page.keyboard.press("ArrowRight")
    until(page, f"Math.abs(Tools.middle(live.chains[0].target)[0] - {before[0]} - 0.05) < 1e-3")
    page.keyboard.press("q")
    until(page, "Math.abs(live.chains[0].turn - Math.PI / 18) < 1e-3")
    page.keyboard.press("2")
    until(page, "live.chains[0].turn === 0")
    for key, condition in (
        ("+", "live.chains[0].units.length === 9"), ("-", "live.chains[0].units.length === 8"),
        (".", "live.unit === 0"), ("t", "live.chains[0].units[0][4] === 0"),
        ("x", "document.getElementById('toast').textContent.includes('at least 2')"),
        (".", "live.unit === 1"), (".", "live.unit === 2"), ("x", "live.chains.length === 2"),
        ("j", "live.chains.length === 1 && live.chains[0].units.length === 8"),
        ("Shift+ArrowUp", "live.current[1] > 0.03"), ("c", "live.current[1] === 0"),
        ("g", "live.chains[0].since < 0.5 && live.chains[0].distance > 0.1"),
        ("]", "live.pacing === 2"), ("Space", "!live.paused"),
    ):  # fmt: skip
        page.keyboard.press(key)
        until(page, condition)
    epoch = page.evaluate("live.epoch")
    page.keyboard.press("r")
    until(page, f"live.epoch !== {epoch}")
    before = page.evaluate("live.chains[0].units[0]")
    page.evaluate("live.send('push', {chain: live.chains[0].name, unit: 0, x: 3, y: 0})")
    until(page, f"live.chains[0].units[0][0] > {before[0]} + 0.02")


def test_the_length_goes_from_2_to_128_while_it_swims(page):
    page.click("#scenes")
    for length in (2, 128, 20):
        page.evaluate("""(length) => {
            const slider = document.getElementById("long");
            slider.value = length;
            slider.dispatchEvent(new Event("input"));
        }""", length)  # fmt: skip
        until(page, f"live.chains[0].units.length === {length}")
        seen = page.evaluate("live.states")
        until(page, f"live.states > {seen} + 3")
        assert page.evaluate("live.chains[0].units.flat().every(Number.isFinite)")
        if length == 128:
            shoot(page, "swim-128")
    page.evaluate("live.send('resize', {chain: live.chains[0].name, length: 129})")
    says(page, "at most 128 units")


STATES = """(count) => new Promise((done) => {
    const seen = {};
    const look = () => {
        if (live.time !== null && live.chains.length) seen[live.time] = live.chains[0].units;
        if (Object.keys(seen).length < count) requestAnimationFrame(look); else done(seen);
    };
    look();
})"""


def test_a_link_opens_the_same_swim_elsewhere(page, address, browser):
    points = [[0, 0.4], [0.3, 0.6], [0.6, 0.4]]
    page.evaluate("(points) => live.send('draw', {chain: live.chains[0].name, points})", points)
    until(page, "live.chains[0].since < 1 && live.chains[0].target[0][1] < 0.8")
    page.evaluate("live.send('flow', {x: 0.05, y: -0.02})")
    page.evaluate("live.send('cut', {chain: live.chains[0].name, link: 2})")
    page.evaluate("live.send('steer', {policy: 'greedy'})")
    until(page, "live.current[0] === 0.05 && live.chains.length === 2 && live.policy === 'greedy'")
    page.click("#scenes")
    page.click("#share")
    until(page, "location.hash.includes('target=')")
    targets = "live.chains.map(({target}) => target)"
    target, link = page.evaluate(targets), page.evaluate("location.hash")
    assert [len(one) for one in target] == [3, 5] and page.evaluate("live.policy") == "greedy"
    swims = []
    for _ in range(2):
        with watched(browser, address + link) as other:
            until(other, SWIMS)
            for ours, its in zip(target, other.evaluate(targets), strict=True):
                np.testing.assert_allclose(its, ours, atol=1e-3)
            assert other.evaluate("live.policy") == "greedy"
            assert other.evaluate("live.current") == [0.05, -0.02]
            swims.append(other.evaluate(STATES, 60))
    both = swims[0].keys() & swims[1].keys()
    assert len(both) > 3
    for time in both:
        assert swims[0][time] == swims[1][time]


def test_a_damaged_link_gets_a_sentence_and_the_page_swims(address, browser):
    with watched(browser, f"{address}#length=1000&target=<img src=x onerror=alert(1)>") as page:
        until(page, SWIMS)
        says(page, "The link is damaged: it should say a length of 2 to 128 units")
        page.evaluate("location.hash = '#world=moon'")
        says(page, "it should say a world")
        says(page, "The scene stays as it is")
        page.evaluate("location.hash = '#length=5'")
        until(page, "live.chains[0].units.length === 5")
        page.evaluate("location.hash = '#length=5&policy=mine'")
        says(page, "this page does not have the policy mine: drop its file here")


def test_a_policy_of_ones_own_swims_and_a_damaged_one_gets_a_sentence(page, tmp_path):
    file = tmp_path / "policy.safetensors"
    save_policy(salpchain.load("paper-gcn-8"), file)
    page.set_input_files("#file", file)
    until(page, "live.policy === 'paper-gcn-8'")
    assert page.evaluate("document.getElementById('policy').value") == "paper-gcn-8"
    seen = page.evaluate("live.states")
    until(page, f"live.states > {seen} + 5")
    (tmp_path / "half.safetensors").write_bytes(file.read_bytes()[:5000])
    page.set_input_files("#file", tmp_path / "half.safetensors")
    says(page, "damaged or cut short")
    assert page.evaluate("live.policy") == "paper-gcn-8"
    page.evaluate("""() => {
        const data = new DataTransfer();
        data.items.add(new File(["no policy"], "notes.txt"));
        document.dispatchEvent(new DragEvent("drop", {dataTransfer: data, cancelable: true}));
    }""")
    says(page, "neither a policy.safetensors of salpchain nor an ONNX file")
    page.select_option("#policy", "greedy")
    until(page, "live.policy === 'greedy'")


def test_a_recording_is_played_in_the_page(page):
    page.click("#record")
    until(page, "document.getElementById('record').textContent.includes('Stop 1.')")
    page.evaluate("live.send('cut', {chain: live.chains[0].name, link: 3})")
    until(page, "live.chains.length === 2")
    until(page, "document.getElementById('record').textContent.includes('Stop 2.')")
    page.click("#record")
    until(page, "document.getElementById('recorded').open")
    for _ in range(500):
        frames = [frame for frame in page.frames if frame.url.startswith("blob:")]
        if frames and frames[0].evaluate("window.replay !== undefined"):
            break
        page.wait_for_timeout(20)
    (frame,) = frames
    lengths = frame.evaluate("window.replay.swims.map((swim) => swim.length)")
    assert sorted(lengths) == [4, 4, 8]
    assert frame.evaluate("window.replay.end") >= 1.9
    units = frame.evaluate("window.replay.swims[0].x(0, 0)")
    assert np.isfinite(units)
    assert page.get_attribute("#download", "download") == "salpchain-recording-1.html"
    shoot(page, "swim-replay")
    # from disk the replay is of another origin, in which nothing may take the focus
    page.wrong = [said for said in page.wrong if "autofocusing" not in said]


@pytest.mark.parametrize("name", ["task", "length", "sea", "split"])
def test_a_guided_scene_has_three_sentences_and_then_hands_on(page, name):
    page.evaluate("live.send('pace', {speed: 4})")
    page.click("#scenes")
    page.click(f"[data-scene={name}]")
    told = []
    for press in range(3):
        told.append(page.inner_text("#guide-says"))
        page.wait_for_timeout(400)
        assert page.inner_text("#guide-next") == ("Your turn" if press == 2 else "Next")
        if press == 1:
            shoot(page, f"swim-scene-{name}")
        page.click("#guide-next")
    assert len(set(told)) == 3 and page.is_hidden("#guide")
    until(page, {
        "task": "live.chains[0].units.length === 8",
        "length": "live.chains[0].units.length === 40",
        "sea": "live.troubles.length === 3",
        "split": "live.around.posts.length > 0",
    }[name])  # fmt: skip


def test_troubles_are_poured_as_in_the_live_page(page):
    page.click("#trouble")
    for name in ("dead", "delay", "noise", "dropout", "repeat", "weak", "one-sided", "failing"):
        page.click(f"[data-trouble={name}]")
        until(page, f"live.troubles.includes({name!r})")
    page.select_option("#grade", "hard")
    until(page, "live.grade === 'hard'")
    until(page, "live.chains[0].units.filter((unit) => !unit[4]).length >= 4")
    seen = page.evaluate("live.states")
    until(page, f"live.states > {seen} + 15")
    assert page.evaluate("live.chains[0].units.every((unit) => unit[3] >= 0)")  # one-sided
    page.click("#calm")
    until(page, "live.troubles.length === 0 && live.chains[0].units.every((unit) => unit[4])")


def test_without_workers_it_swims_in_the_page_itself(address, browser):
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script("delete window.Worker")
    page.goto(address)
    until(page, "live.connected && live.states > 5 && live.time > 0.3")
    context.close()


@pytest.mark.parametrize("size", [(667, 375), (844, 390), (320, 568), (720, 416)])
def test_every_control_is_within_a_small_window(address, browser, size):
    """Telephones upright and across, and the frame in which a page of the site shows it."""
    width, height = size
    look = {"viewport": {"width": width, "height": height}, "has_touch": True}
    with watched(browser, address, **look) as page:
        until(page, "live.frames > 3 && live.states > 1")
        page.click("#scenes")
        page.click("[data-scene=sea]")
        assert page.is_hidden("#hint")
        shown = page.locator(
            "header :is(button, select), footer :is(button, select), #guide button"
        )
        for box in (one.bounding_box() for one in shown.filter(visible=True).all()):
            assert box["x"] >= 0 and box["x"] + box["width"] <= width + 0.5
            assert box["y"] >= 0 and box["y"] + box["height"] <= height + 0.5
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_it_fits_a_phone(address, browser):
    look = {"viewport": {"width": 390, "height": 760}, "color_scheme": "light", "has_touch": True}
    with watched(browser, address, **look) as page:
        until(page, "live.frames > 10 && live.states > 1")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.click("#scenes")
        for button in ("#share", "#world", "#long", "[data-scene=split]", "#scenes", "#trouble"):
            box = page.locator(button).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["height"] >= 36
        shoot(page, "swim-phone")
