"""The live page on a phone, touched with fingers: every button, every shape, no keys."""

import json

import numpy as np
import pytest

from tests.web.browser import shoot, until, watched
from tests.web.test_page import middle_of, on_screen, restart, settle

PHONE = {
    "viewport": {"width": 390, "height": 844},
    "has_touch": True,
    "is_mobile": True,
    "device_scale_factor": 2,
}
AT_REST = """(() => {
    const {x, y, scale} = live.camera, before = window.before ?? [0, 0, 0];
    window.before = [x, y, scale];
    return window.before.every((value, k) => Math.abs(value - before[k]) < 1e-3);
})()"""
ARRIVED_ON_SCREEN = """live.chains[0].shown.every(
    ({ x }, i) => Math.abs(x - live.chains[0].units[i][0]) < 1e-6)"""
LEAST = 44  # pixels that a finger needs


@pytest.fixture
def phone(server, browser):
    """The page on a phone, paused, with one chain of 6 units."""
    with watched(browser, server, **PHONE) as page:
        until(page, "live.connected && live.policy && !live.loading && live.chains.length")
        page.evaluate("live.send('pause', {on: true})")
        until(page, "live.paused")
        restart(page, 6)
        until(page, "live.frames > 3")
        until(page, AT_REST)
        settle(page)
        yield page


class Fingers:
    """Fingers on the glass, as Chromium gets them from a real screen."""

    def __init__(self, page):
        self._page = page
        self._channel = page.context.new_cdp_session(page)

    def put(self, kind, *places):
        points = [{"x": float(x), "y": float(y), "id": k} for k, (x, y) in enumerate(places)]
        self._channel.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def drag(self, *ways, steps=8):
        """Each finger goes along its way, all at once; they come down one after the other."""
        for count in range(1, len(ways) + 1):
            self.put("touchStart", *[way[0] for way in ways[:count]])
        for share in np.linspace(0, 1, steps + 1)[1:]:
            at = [way[0] + share * np.subtract(way[1], way[0]) for way in ways]
            self.put("touchMove", *at)
        self._page.wait_for_timeout(150)  # at rest: lifted in a hurry, they would fling, and
        self.put("touchMove", *at)  # Chromium takes the next tap for what stops the fling
        self.put("touchEnd")
        self._page.wait_for_timeout(400)


def tap(page, selector):
    box = page.locator(selector).bounding_box()
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def choose(page, tool):
    tap(page, f"[data-tool={tool}]")
    until(page, f"live.tool === '{tool}'")


def target_of(page):
    return np.array(page.evaluate("live.chains[0].target"))


def bends(target):
    """Angle (rad) between each chord of a target and the next."""
    bearing = np.arctan2(*np.diff(target, axis=0).T[::-1])
    return np.mod(np.diff(bearing) + np.pi, 2 * np.pi) - np.pi


SHAPES = {
    "1": lambda bend: np.abs(bend).max() < 0.01,  # line
    "2": lambda bend: np.ptp(bend) < 0.05 and 1.2 < abs(bend.sum()) < 2,  # arc
    "3": lambda bend: bend.min() < -0.3 and bend.max() > 0.3,  # wave
    "4": lambda bend: np.ptp(bend) < 0.3 and abs(bend.sum()) > 4,  # ring
    "5": lambda bend: np.abs(bend).min() < 0.01 and np.abs(bend).max() > 0.5,  # hook
}


@pytest.mark.parametrize("key", SHAPES)
def test_every_shape_of_a_target_is_a_tap_away(phone, key):
    before = phone.evaluate("JSON.stringify(live.chains[0].target)")
    tap(phone, f"#shapes [data-key='{key}']")
    until(phone, f"JSON.stringify(live.chains[0].target) !== {json.dumps(before)}")
    assert SHAPES[key](bends(target_of(phone)))


def test_a_target_is_turned_by_tap_by_its_knob_and_with_two_fingers(phone):
    turn = "live.chains[0].turn"
    tap(phone, "#shapes [data-key=q]")
    until(phone, f"Math.abs({turn} - Math.PI / 18) < 1e-3")
    tap(phone, "#shapes [data-key=e]")
    until(phone, f"Math.abs({turn}) < 1e-3")
    fingers, centre = Fingers(phone), middle_of(phone, "target")
    around = np.array(on_screen(phone, centre))
    knob = np.array(on_screen(phone, phone.evaluate("Tools.knob(live, live.chains[0])")))
    arm = knob - around
    fingers.drag((knob, np.add(around, (arm[1], -arm[0]))))
    until(phone, f"Math.abs({turn} - Math.PI / 2) < 0.1")
    settle(phone)
    scale, before = phone.evaluate("live.camera.scale"), phone.evaluate(turn)
    ends = [np.array(on_screen(phone, point)) for point in target_of(phone)[[0, 5]]]
    middle = (ends[0] + ends[1]) / 2
    turned = [middle + np.array([a[1], -a[0]]) for a in (end - middle for end in ends)]
    fingers.drag(*zip(ends, turned, strict=True), steps=12)
    until(phone, f"Math.abs({turn} - {before} - Math.PI / 2) < 0.1")
    np.testing.assert_allclose(middle_of(phone, "target"), centre, atol=0.02)
    assert phone.evaluate("live.camera.scale") == scale  # it was no zoom


def test_two_fingers_on_the_water_zoom_and_leave_the_target_alone(phone):
    before, target = phone.evaluate("live.camera.scale"), target_of(phone)
    box = phone.locator("#water").bounding_box()
    low = box["y"] + box["height"] - 90
    Fingers(phone).drag(((150, low), (40, low)), ((240, low), (350, low)))
    until(phone, f"live.camera.scale > 1.5 * {before}")
    np.testing.assert_array_equal(target_of(phone), target)


def test_a_finger_drags_the_target_and_draws_one(phone):
    fingers, before = Fingers(phone), middle_of(phone, "target")
    start = np.array(on_screen(phone, target_of(phone)[2]))
    fingers.drag((start, np.add(start, (30, -20))))
    until(phone, f"Math.abs(Tools.middle(live.chains[0].target)[0] - {before[0]}) > 0.01")
    choose(phone, "draw")
    until(phone, "document.getElementById('shapes').hidden")
    first = target_of(phone)[0]
    box = phone.locator("#water").bounding_box()
    x, y = 60.0, box["y"] + box["height"] / 2
    fingers.drag(((x, y), (x + 270, y)), steps=12)
    until(phone, f"live.chains[0].target[0][0] !== {first[0]}")
    assert np.abs(bends(target_of(phone))).max() < 0.02


def test_cut_push_and_thruster_obey_a_finger(phone):
    choose(phone, "thruster")
    unit = on_screen(phone, phone.evaluate("live.chains[0].units[1].slice(0, 2)"))
    phone.touchscreen.tap(*unit)
    until(phone, "live.chains[0].units[1][4] === 0")
    choose(phone, "push")
    before, side = phone.evaluate("live.chains[0].units[1][0]"), 1 if unit[0] < 195 else -1
    Fingers(phone).drag((unit, (195 + 185 * side, unit[1])))  # to the farther edge
    tap(phone, "#step")
    until(phone, f"{side} * (live.chains[0].units[1][0] - {before}) > 0.005")
    choose(phone, "cut")
    until(phone, ARRIVED_ON_SCREEN)
    link = phone.evaluate(
        "[0, 1].map((k) => (live.chains[0].units[2][k] + live.chains[0].units[3][k]) / 2)"
    )
    phone.touchscreen.tap(*on_screen(phone, link))
    until(phone, "live.chains.length === 2")


def test_every_button_is_large_enough_and_in_sight(phone):
    for width, height in ((390, 844), (360, 640), (844, 390)):
        phone.set_viewport_size({"width": width, "height": height})
        settle(phone)
        assert phone.evaluate("document.documentElement.scrollWidth") <= width
        assert phone.evaluate("document.documentElement.scrollHeight") <= height
        controls = phone.locator("button:visible, select:visible").all()
        assert len(controls) >= 24
        for control in controls:
            box = control.bounding_box()
            assert box["width"] >= LEAST - 0.01 and box["height"] >= LEAST - 0.01, control
            assert box["x"] >= 0 and box["x"] + box["width"] <= width + 0.5, control
            assert box["y"] >= 0 and box["y"] + box["height"] <= height + 0.5, control


def test_help_begins_at_its_top_and_names_keys_only_where_there_are_some(phone):
    phone.set_viewport_size({"width": 360, "height": 480})  # so that it is longer than the window
    tap(phone, "#keys")
    until(phone, "document.getElementById('help').open")
    assert phone.evaluate("document.getElementById('help').scrollTop") == 0
    inside = phone.evaluate("document.querySelector('#help h2').getBoundingClientRect().top")
    assert inside >= phone.locator("#help").bounding_box()["y"]
    assert phone.locator("#help kbd:visible").count() == 0
    assert phone.is_visible("#help form button")  # Close is in sight, however long the help
    shoot(phone, "live-phone-help")
    tap(phone, "#help form button")
    until(phone, "!document.getElementById('help').open")
    phone.keyboard.press("Shift")  # somebody has put a keyboard to it
    tap(phone, "#keys")
    until(phone, "document.getElementById('help').open")
    assert phone.locator("#help kbd:visible").count() > 20


def test_after_arrival_a_new_target_is_a_tap_away_and_the_chain_sets_off(phone):
    phone.evaluate("""() => {
        const [a] = live.chains[0].units, [cos, sin] = [Math.cos(a[2]), Math.sin(a[2])];
        const points = live.chains[0].units.map(([x, y]) => [x - 0.2 * sin, y + 0.2 * cos]);
        live.send('draw', {chain: live.chains[0].name, points});
        live.send('pace', {speed: 4});
        live.send('pause', {on: false});
    }""")
    assert not phone.is_visible("#arrived")
    until(phone, "live.chains[0].arrived !== null")
    until(phone, "!document.getElementById('arrived').hidden")
    assert "Arrived in" in phone.inner_text("#arrived")
    assert "new target" in phone.inner_text("#arrived")
    shoot(phone, "live-phone-arrived")
    phone.evaluate("live.send('pause', {on: true})")
    until(phone, "live.paused")
    old = target_of(phone)
    tap(phone, "#again")
    until(phone, "live.chains[0].arrived === null")
    assert np.abs(target_of(phone) - old).max() > 0.05
    assert not phone.is_visible("#arrived") and phone.evaluate("live.following")
    before = phone.evaluate("live.chains[0].distance")
    phone.evaluate("live.send('pause', {on: false})")
    until(phone, f"live.chains[0].distance < 0.8 * {before}")
