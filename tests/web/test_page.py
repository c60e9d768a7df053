"""The live page in a real browser, as a person uses it: one server, one browser for all."""

import signal

import numpy as np
import pytest

from salpchain.report.shapes import jet_size
from tests.web.browser import live_server, shoot, until, watched


@pytest.fixture
def page(server, browser):
    """The page, swimming, with one chain of 3 units."""
    with watched(browser, server) as page:
        until(page, "live.connected && live.policy && !live.loading && live.chains.length")
        page.evaluate("live.send('pace', {speed: 4}); live.send('pause', {on: false})")
        page.evaluate("live.send('flow', {x: 0, y: 0})")
        restart(page, 3)
        until(page, "live.frames > 3")
        yield page


def restart(page, length):
    """A new chain, which has a new name; an order to the one before would go astray."""
    old = page.evaluate("live.chains[0].name")
    page.evaluate("(length) => live.send('reset', {length})", length)
    until(page, f"live.chains.length === 1 && live.chains[0].name !== {old}")
    assert page.evaluate("live.chains[0].units.length") == length


def settle(page):
    """Lets the camera come at once to where it glides, and stay there."""
    two_frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    page.evaluate("live.frames = 0")  # as when the page opens
    page.evaluate(two_frames)
    page.evaluate("live.following = false")
    page.evaluate(two_frames)


def on_screen(page, point):
    """Where a point of the world is, in the window."""
    box = page.locator("#water").bounding_box()
    x, y = page.evaluate("(p) => live.camera.toScreen(...p)", list(point))
    return box["x"] + x, box["y"] + y


def middle_of(page, what):
    return page.evaluate(f"Tools.middle(live.chains[0].{what})")


def drag(page, start, end, steps=8):
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=steps)
    page.mouse.up()


def test_a_dragged_target_moves_and_the_chain_arrives(page):
    # a chain at rest beside its target: straight ahead, along the way in which its units push
    page.evaluate("live.send('pause', {on: true})")
    until(page, "live.paused")
    restart(page, 3)
    units = np.array(page.evaluate("live.chains[0].units"))
    angle = units[0, 2]
    shape = units[:, :2] + 0.35 * np.array([-np.sin(angle), np.cos(angle)])
    page.evaluate(
        "(p) => live.send('draw', {chain: live.chains[0].name, points: p})", shape.tolist()
    )
    goal = shape.mean(axis=0)
    until(page, f"Math.hypot(Tools.middle(live.chains[0].target)[0] - {goal[0]}, "
                f"Tools.middle(live.chains[0].target)[1] - {goal[1]}) < 0.05")  # fmt: skip
    settle(page)
    before = middle_of(page, "target")
    start = on_screen(page, page.evaluate("live.chains[0].target[1]"))
    off = 40 * np.array([-np.sin(angle), -np.cos(angle)])
    drag(page, start, (start[0] + off[0], start[1] + off[1]))
    until(page, f"Math.hypot(Tools.middle(live.chains[0].target)[0] - {before[0]}, "
                f"Tools.middle(live.chains[0].target)[1] - {before[1]}) > 0.02")  # fmt: skip
    page.evaluate("live.send('pause', {on: false})")
    until(page, "live.chains[0].arrived !== null")
    until(page, "document.getElementById('success').textContent.includes('reached')")
    shoot(page, "live-arrived")


def test_the_knob_turns_the_target_about_its_middle(page):
    page.evaluate("live.send('pause', {on: true})")
    until(page, "live.paused")
    settle(page)
    before, centre = page.evaluate("live.chains[0].turn"), middle_of(page, "target")
    knob = on_screen(page, page.evaluate("Tools.knob(live, live.chains[0])"))
    around = on_screen(page, centre)
    arm = np.subtract(knob, around)
    drag(page, knob, (around[0] + arm[1], around[1] - arm[0]))  # a quarter turn anticlockwise
    until(page, f"Math.abs(live.chains[0].turn - {before} - Math.PI / 2) < 0.1")
    np.testing.assert_allclose(middle_of(page, "target"), centre, atol=2e-3)


def test_a_line_drawn_by_hand_becomes_a_target_of_one_link_chords(page):
    settle(page)
    page.click("[data-tool=draw]")
    box = page.locator("#water").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    first = page.evaluate("live.chains[0].target[0]")
    drag(page, (x - 150, y), (x + 150, y + 60), steps=12)
    until(page, f"live.chains[0].target[0][0] !== {first[0]}")
    target = np.array(page.evaluate("live.chains[0].target"))
    np.testing.assert_allclose(np.linalg.norm(np.diff(target, axis=0), axis=1), 0.07, atol=3e-4)
    page.click("[data-tool=target]")


def test_the_view_follows_the_chain_and_its_target_wherever_they_go(page):
    page.evaluate("live.send('place', {chain: live.chains[0].name, x: 3, y: -2, turn: 0})")
    until(page, "Math.abs(Tools.middle(live.chains[0].target)[0] - 3) < 1e-3")
    page.click("#fit")
    until(page, MIDDLE_IN_VIEW)
    # what a unit has besides its place (angle, thrust) plays no part in it
    units = [[2.0, 3.0, 1.5, 0.3, 1], [4.0, 5.0, -2.0, 0.1, 1]]
    view = page.evaluate("(units) => new Salp.Camera().whole(units)", units)
    assert (view["x"], view["y"]) == (3.0, 4.0)


MIDDLE_IN_VIEW = """(() => {
    const points = [...live.chains[0].units, ...live.chains[0].target];
    return [live.camera.x, live.camera.y].every((seen, k) => {
        const values = points.map((point) => point[k]);
        return Math.abs((Math.min(...values) + Math.max(...values)) / 2 - seen) < 0.15;
    });
})()"""


def test_one_click_adds_or_removes_a_unit_while_it_swims(page):
    page.click("#grow")
    until(page, "live.chains[0].units.length === 4")
    assert page.inner_text("#length") == "4 units"
    page.click("#shrink")
    page.click("#shrink")
    until(page, "live.chains[0].units.length === 2")
    assert page.is_disabled("#shrink")


def test_a_cut_makes_two_chains_with_targets_of_their_own_and_join_makes_one_again(page):
    restart(page, 8)
    until(page, "live.following && live.frames > 3")
    page.wait_for_timeout(300)
    settle(page)
    page.click("[data-tool=cut]")
    page.evaluate("live.send('pause', {on: true})")
    until(page, "live.paused")
    page.wait_for_timeout(150)
    link = page.evaluate(
        "[0, 1].map((k) => (live.chains[0].units[3][k] + live.chains[0].units[4][k]) / 2)"
    )
    page.mouse.click(*on_screen(page, link))
    until(page, "live.chains.length === 2")
    lengths = "live.chains.map((c) => [c.units.length, c.target.length])"
    assert page.evaluate(lengths) == [[4, 4], [4, 4]]
    page.click("#join")
    until(page, "live.chains.length === 1")
    assert page.evaluate(lengths) == [[8, 8]]
    page.evaluate("live.send('cut', {chain: live.chains[0].name, link: 3})")
    until(page, "live.chains.length === 2")
    page.evaluate("live.send('pause', {on: false})")
    # each chain is steered by itself: only the one whose target moves away follows
    page.evaluate("live.send('place', {chain: live.chains[1].name, x: 1, y: 1, turn: 0})")
    until(page, "live.chains[1].distance > 0.5")
    page.wait_for_timeout(500)
    shoot(page, "live-cut")
    page.click("[data-tool=target]")
    page.evaluate("live.send('push', {chain: live.chains[1].name, unit: 0, x: 3, y: 3})")
    until(
        page,
        """Math.min(...[0, 3].flatMap((i) => [0, 3].map((j) => Math.hypot(
        live.chains[0].units[i][0] - live.chains[1].units[j][0],
        live.chains[0].units[i][1] - live.chains[1].units[j][1])))) > 0.4""",
    )
    page.click("#join")  # now they are too far from each other, and the page says so
    until(page, "document.getElementById('toast').textContent.includes('bring them within')")
    assert page.evaluate("live.chains.length") == 2


def test_push_thruster_and_current_by_mouse(page):
    page.evaluate("live.send('pause', {on: true})")
    until(page, "live.paused")
    page.wait_for_timeout(200)
    settle(page)
    page.click("[data-tool=thruster]")
    unit = on_screen(page, page.evaluate("live.chains[0].units[1].slice(0, 2)"))
    page.mouse.click(*unit)
    until(page, "live.chains[0].units[1][4] === 0")
    page.click("[data-tool=push]")
    before = np.array(page.evaluate("live.chains[0].units[1].slice(0, 2)"))
    drag(page, unit, (unit[0] + 150, unit[1]))
    page.click("#step")
    until(page, f"live.chains[0].units[1][0] > {before[0]} + 0.005")
    page.click("[data-tool=current]")
    drag(page, (500, 300), (500, 200))
    until(page, "live.current[1] > 0.05 && Math.abs(live.current[0]) < 0.03")
    page.click("[data-tool=target]")


def test_the_keyboard_alone_is_enough(page):
    page.keyboard.press("Space")
    until(page, "live.paused")
    before = middle_of(page, "target")
    page.keyboard.press("ArrowRight")
    until(page, f"Math.abs(Tools.middle(live.chains[0].target)[0] - {before[0]} - 0.05) < 1e-3")
    page.keyboard.press("q")
    until(page, "Math.abs(live.chains[0].turn - Math.PI / 18) < 1e-3")
    for _ in range(3):
        page.keyboard.press("+")
    until(page, "live.chains[0].units.length === 6")
    page.keyboard.press("2")  # an arc
    until(page, "live.chains[0].turn === 0")
    for key, condition in (
        (".", "live.unit === 0"), (".", "live.unit === 1"), (".", "live.unit === 2"),
        ("t", "live.chains[0].units[2][4] === 0"), ("x", "live.chains.length === 2"),
        ("n", "live.name === live.chains[1].name"), ("j", "live.chains.length === 1"),
        ("Shift+ArrowUp", "live.current[1] > 0.03"), ("c", "live.current[1] === 0"),
        ("g", "live.chains[0].since < 0.5 && live.chains[0].distance > 0.1"),
        ("]", "live.pacing === 4"), ("[", "live.pacing === 2"), ("Space", "!live.paused"),
        ("r", "live.time < 3"), ("?", "document.getElementById('help').open"),
    ):  # fmt: skip
        page.keyboard.press(key)
        until(page, condition)
    page.keyboard.press("Escape")
    for _ in range(3):  # the controls can be reached with Tab
        page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.tagName") in ("BUTTON", "SELECT", "CANVAS")


def test_the_page_fits_a_phone_in_light_and_says_how_to_use_it(server, browser):
    look = {"viewport": {"width": 360, "height": 640}, "color_scheme": "light", "has_touch": True}
    with watched(browser, server, **look) as page:
        until(page, "live.frames > 10 && live.states > 1")
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        for button in ("#grow", "#shrink", "#pause", "#policy", "[data-tool=draw]"):
            box = page.locator(button).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 360 and box["height"] >= 36
        assert "Drag the ghosts" in page.inner_text("#hint")
        page.wait_for_timeout(500)
        shoot(page, "live-phone")


def test_the_picture_moves_between_two_states_of_the_server(page):
    """Interpolation: more different pictures than states."""
    page.evaluate("live.send('pace', {speed: 0.5})")
    until(page, "live.pacing === 0.5")
    seen = page.evaluate("""async () => {
        const places = new Set(), first = live.states;
        const end = performance.now() + 1200;
        while (performance.now() < end) {
            await new Promise(requestAnimationFrame);
            places.add(live.chains[0].shown[0].x);
        }
        return [places.size, live.states - first];
    }""")
    assert seen[0] > 2 * seen[1]


def test_the_page_draws_jets_by_the_rule_of_the_videos(page):
    thrust = np.array([0.0, 0.004, -0.004, 0.005, 0.01, -0.05, 0.3, -1.0])
    sizes = page.evaluate("(thrusts) => thrusts.map(Salp.jetSize)", thrust.tolist())
    np.testing.assert_allclose(sizes, jet_size(thrust))


def test_policies_can_be_switched_and_an_error_of_the_server_is_shown(page):
    assert page.input_value("#policy") == "greedy"
    page.evaluate("live.send('steer', {policy: '../../etc/passwd'})")
    until(page, "document.getElementById('toast').textContent.includes('no such policy')")


def test_a_server_that_goes_away_is_named_and_found_again(browser):
    with live_server("greedy") as (address, process):
        context = browser.new_context()
        page = context.new_page()
        page.goto(address)
        until(page, "live.connected && live.chains.length")
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=20)[1]
        assert (process.returncode, said.splitlines()[-1]) == (130, "salpchain: interrupted")
        until(page, "document.getElementById('banner').textContent.includes('gone away')")
        assert page.is_visible("#banner")
        shoot(page, "live-away")
    with live_server("greedy", port=int(address.rsplit(":", 1)[1])):
        until(page, "live.connected")
        until(page, "!document.getElementById('banner').textContent.includes('gone away')")
    context.close()
