"""The replay page: in Python its data, in a real browser what a person does with it."""

import base64
import itertools
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.report.replay import page, write_replay
from tests.report.swims import swim
from tests.web.browser import open_browser, shoot, until, watched


def data_of(text):
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])["swims"]


def numbers(packed, kind):
    return np.frombuffer(base64.b64decode(packed), kind).astype(float)


def test_positions_come_back_to_a_fifth_of_a_millimetre_and_angles_to_a_minute():
    one = swim(5)
    (packed,) = data_of(page([one]))
    position = numbers(packed["position"], "<i2").reshape(one.unit_position.shape)
    np.testing.assert_allclose(
        position * packed["grain"] + packed["middle"], one.unit_position, atol=2e-4
    )
    angle = numbers(packed["angle"], "<i2").reshape(one.unit_angle.shape) * np.pi / 32767
    np.testing.assert_allclose(np.cos(angle - one.unit_angle), 1, atol=1e-7)
    thrust = numbers(packed["thrust"], "<i1").reshape(one.thrust.shape) / 127
    np.testing.assert_allclose(thrust, one.thrust, atol=4e-3)
    np.testing.assert_allclose(numbers(packed["distance"], "<f4"), one.distance, rtol=1e-6)


def test_a_page_has_what_is_around_a_swim_and_only_what_there_is():
    gain = np.ones((39, 3))
    gain[5:, 1] = 0.0
    water = np.full((2, 1, 1, 2), [0.02, -0.04])
    around = Surroundings(np.array([[0, 1, 2, 3, 0.1]]), np.zeros((0, 3)), gain, water)
    plain, packed = data_of(page([swim(3), replace(swim(3), world="rough", around=around)]))
    assert packed["walls"] == [[0, 1, 2, 3, 0.1]] and packed["dead"] == [None, 5, None]
    flow = numbers(packed["water"]["flow"], "<i1") * packed["water"]["speed"] / 127
    np.testing.assert_allclose(flow.reshape(water.shape), water, atol=2e-4)
    assert "posts" not in packed and not {"walls", "posts", "dead", "water"} & plain.keys()


def test_512_steps_of_64_units_take_less_than_a_megabyte():
    assert len(page([swim(64, times=513)])) < 1_000_000


def test_a_name_that_looks_like_html_stays_a_name():
    evil = "</script><script>alert(1)</script><!--{{script}}"
    text = page([swim(3, policy=evil)])
    assert text.count("<script") == 6 and evil not in text
    assert data_of(text)[0]["policy"] == evil


def test_a_page_loads_nothing_from_anywhere():
    text = page([swim(3)])
    assert not re.search(r"""(src|href|url)\s*[=(]\s*["']?(https?:)?//""", text)
    assert "default-src 'none'" in text


@pytest.mark.parametrize("count", [0, 13])
def test_no_or_too_many_swims_are_refused(count, tmp_path):
    with pytest.raises(InputError, match=r"1 to 12|at least one"):
        write_replay([swim(2, times=2)] * count, tmp_path / "x.html")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replay")
    one, other = swim(6, times=60), swim(6, times=40, policy="<b>other</b>")
    return {
        "one": write_replay([one], folder / "one.html").as_uri(),
        "both": write_replay([one, other], folder / "both.html").as_uri(),
    }


def time_of(page):
    return page.evaluate("replay.state.time")


def test_it_plays_by_itself_to_the_end_and_pauses(browser, places):
    with watched(browser, places["one"]) as page:
        page.select_option("#speed", "16")
        until(page, "replay.state.time >= replay.end")
        assert page.inner_text("#play") == "Play"
        assert page.inner_text("#title") == "made, 6 units"
        assert page.inner_text("#clock") == "5.9 / 5.9 s"
        shoot(page, "replay")


def test_every_key_does_what_the_help_says(browser, places):
    with watched(browser, places["one"]) as page:
        page.keyboard.press("Space")
        assert page.inner_text("#play") == "Play"
        page.keyboard.press("Home")
        assert time_of(page) == 0
        page.keyboard.press("ArrowRight")
        assert time_of(page) == pytest.approx(0.1)
        page.keyboard.press("Shift+ArrowRight")
        assert time_of(page) == pytest.approx(1.1)
        page.keyboard.press("ArrowLeft")
        assert time_of(page) == pytest.approx(1.0)
        page.keyboard.press("End")
        assert time_of(page) == pytest.approx(5.9)
        page.keyboard.press("ArrowUp")
        assert page.input_value("#speed") == "4"
        scale = page.evaluate("replay.swims[0].camera.scale")
        page.keyboard.press("+")
        assert page.evaluate("replay.swims[0].camera.scale") == pytest.approx(1.25 * scale)
        x = page.evaluate("replay.swims[0].camera.x")
        page.keyboard.press("d")
        assert page.evaluate("replay.swims[0].camera.x") > x
        page.keyboard.press("0")
        assert page.evaluate("replay.swims[0].camera.scale") == pytest.approx(scale)
        page.keyboard.press("?")
        assert page.is_visible("#help")
        page.keyboard.press("Escape")
        assert not page.is_visible("#help")


def test_wheel_drag_scrub_and_curves_obey_the_mouse(browser, places):
    with watched(browser, places["one"]) as page:
        box = page.locator("#water").bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(*middle)
        before = page.evaluate("[replay.swims[0].camera.x, replay.swims[0].camera.scale]")
        page.mouse.wheel(0, -200)
        until(page, f"replay.swims[0].camera.scale > {before[1]}")
        page.mouse.down()
        page.mouse.move(middle[0] + 80, middle[1])
        page.mouse.up()
        assert page.evaluate("replay.swims[0].camera.x") < before[0]
        curves = page.locator("#curves").bounding_box()
        left, width = page.evaluate("[replay.state.curves.left, replay.state.curves.width]")
        page.mouse.click(curves["x"] + left + width / 2, curves["y"] + 40)
        assert time_of(page) == pytest.approx(2.95, abs=0.02)
        page.locator("#scrub").fill("1.5")
        assert time_of(page) == 1.5 and page.inner_text("#play") == "Play"


def test_what_is_drawn_are_the_units_where_the_trajectory_has_them(browser, places):
    """Pixels where the first and the last unit start have the colours of their places."""
    with watched(browser, places["one"], reduced_motion="reduce") as page:
        until(page, "replay.swims[0].camera.box[2] > 1")
        page.evaluate(FRAMES)
        start = swim(6, times=60).unit_position[0]
        for unit, expected in ((0, (0x22, 0xC3, 0xD6)), (5, (0xF7, 0x60, 0x9F))):
            seen = page.evaluate(PIXEL, start[unit].tolist())
            assert np.abs(np.array(seen[:3]) - expected).max() < 60


FRAMES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
PIXEL = """(place) => {
    const [x, y] = replay.swims[0].camera.toScreen(...place);
    const water = document.getElementById('water').getContext('2d');
    return [...water.getImageData(x + 4, y + 4, 1, 1).data];
}"""


def test_help_on_a_phone_begins_at_its_top_and_names_no_keys(browser, places):
    look = {"viewport": {"width": 390, "height": 300}, "has_touch": True, "is_mobile": True}
    with watched(browser, places["one"], **look) as page:
        page.locator("#keys").tap()
        until(page, "document.getElementById('help').open")
        assert page.evaluate("document.getElementById('help').scrollTop") == 0
        assert page.locator("#help kbd:visible").count() == 0
        assert "two fingers" in page.inner_text("#help") and page.is_visible("#help form button")


def test_two_swims_side_by_side_on_a_phone_in_light(browser, places):
    look = {"viewport": {"width": 360, "height": 640}, "color_scheme": "light"}
    with watched(browser, places["both"], **look) as page:
        until(page, "replay.state.time > 0.3")
        boxes = page.evaluate("replay.swims.map((s) => s.camera.box)")
        assert boxes[0] != boxes[1]
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        assert page.locator("b").count() == 0
        shoot(page, "replay-phone")


def test_it_stands_still_at_first_for_whoever_wants_less_motion(browser, places):
    with watched(browser, places["one"], reduced_motion="reduce") as page:
        assert page.inner_text("#play") == "Play" and time_of(page) == 0


def overlap(one, other):
    (_, x, y, width, height), (_, u, v, wide, high) = one, other
    return x < u + wide and u < x + width and y < v + high and v < y + height


@pytest.mark.parametrize("size", [(1280, 800), (390, 780), (320, 500)])
@pytest.mark.parametrize("name", ["one", "both"])
def test_curves_have_panels_of_their_own_with_round_ticks_from_zero(browser, places, size, name):
    width, height = size
    look = {"viewport": {"width": width, "height": height}, "reduced_motion": "reduce"}
    with watched(browser, places[name], **look) as page:
        until(page, "replay.state.texts && replay.state.texts.length > 5")
        placed, texts = page.evaluate("[replay.state.curves, replay.state.texts]")
        room = page.locator("#curves").bounding_box()
    upper, lower = placed["panels"]
    assert upper["y"] + upper["height"] < lower["y"]
    written = [text for text, *_ in texts]
    assert {upper["title"], lower["title"], "0.5 N", "1 N"} <= set(written)
    for panel in (upper, lower):
        assert panel["ticks"][0] == 0 and panel["ticks"][-1] == panel["top"] >= panel["most"]
        assert f"{panel['ticks'][-1]:g} {panel['unit']}" in written
        for line in panel["lines"]:
            assert all(0 <= value <= panel["top"] for value in line["values"])
    for ticks in (upper["ticks"], lower["ticks"], placed["times"]):
        steps = np.diff(ticks)
        np.testing.assert_allclose(steps, steps[0])
        assert round(steps[0] / 10 ** np.floor(np.log10(steps[0]) + 1e-9), 6) in (1, 2, 5)
    for one, other in itertools.combinations(texts, 2):
        assert not overlap(one, other), (one, other)
    for _, x, y, wide, high in texts:
        assert x >= 0 and x + wide <= room["width"] and y >= 0 and y + high <= room["height"]


def test_curves_tell_the_distance_and_the_strength_that_the_swim_had(browser, places):
    one = swim(6, times=60)
    with watched(browser, places["one"], reduced_motion="reduce") as page:
        until(page, "replay.state.curves")
        upper, lower = page.evaluate("replay.state.curves.panels.map((p) => p)")
        values = [
            page.evaluate(f"[...replay.state.curves.panels[{k}].lines[0].values]") for k in (0, 1)
        ]
    factor = {"m": 1, "cm": 100}[upper["unit"]]
    np.testing.assert_allclose(values[0], factor * one.distance, rtol=1e-5)
    np.testing.assert_allclose(values[1], np.abs(one.thrust).mean(axis=1), atol=0.005)
    assert lower["unit"] == "N"


@pytest.mark.parametrize(("width", "height"), [(1280, 600), (390, 1000)])
@pytest.mark.parametrize("bearing", [0.4, 2.5, -2.0])
def test_the_way_to_the_target_runs_along_the_longer_side(
    browser, tmp_path, width, height, bearing
):
    one = swim(6, bearing, times=60)
    place = write_replay([one], tmp_path / "turned.html").as_uri()
    look = {"viewport": {"width": width, "height": height}, "reduced_motion": "reduce"}
    with watched(browser, place, **look) as page:
        until(page, "replay.swims[0].camera.box[2] > 1 && replay.swims[0].camera.scale != 400")
        ends = [one.unit_position[0].mean(axis=0).tolist(), one.target.mean(axis=0).tolist()]
        (x, y), (u, v) = (page.evaluate(ON_SCREEN, end) for end in ends)
        back = page.evaluate(BACK, ends[0])
        left, top, wide, high = page.evaluate("replay.swims[0].camera.box")
        everything = [
            page.evaluate(ON_SCREEN, p) for p in one.unit_position[::20].reshape(-1, 2).tolist()
        ]
    np.testing.assert_allclose(back, ends[0], atol=1e-9)
    if width > height:
        assert u > x + 100 and v == pytest.approx(y, abs=2)
    else:
        assert v < y - 60 and u == pytest.approx(x, abs=2)
    for px, py in everything:
        assert left < px < left + wide and top < py < top + high


ON_SCREEN = "(place) => replay.swims[0].camera.toScreen(...place)"
BACK = "(place) => { const c = replay.swims[0].camera; return c.toWorld(...c.toScreen(...place)); }"
