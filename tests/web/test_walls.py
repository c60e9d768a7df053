"""Walls drawn on the live page: they stand at once, and `caravan` passes the one that opens."""

import numpy as np
import pytest

from salpchain.controllers.caravan import Caravan
from salpchain.controllers.greedy import Greedy
from salpchain.errors import InputError
from salpchain.report.recorded import recording_page
from salpchain.web import swimmer
from salpchain.web.pool import Pool
from salpchain.web.recorder import Recorder
from salpchain.web.swimmer import LINK
from salpchain.web.walls import MOST_WALLS, NARROWEST, Gate
from salpchain.web.world import World
from salpchain.world.presets import world_config
from tests.web.browser import live_server, open_browser, until, watched

POOL = Pool()
LENGTH = 4


def across(x, length=LENGTH):
    """A target along y, as a chain along y is."""
    return np.stack([np.full(length, x), LINK * (np.arange(length) - (length - 1) / 2)], 1)


@pytest.fixture
def world():
    """A chain 80 cm before the y axis, its target as far behind it."""
    one = swimmer.straight(1, LENGTH, np.array([-0.8, 0.0]), np.pi / 2, across(0.8))
    return World(seed=1, swimmers=[one])


def swim(world, controller, until=lambda one: False, most=900):
    """Whether it came about, and how many links were cut at most."""
    cut = 0
    for _ in range(most):
        world.advance(POOL, controller)
        (one,) = world.swimmers
        cut = max(cut, int(one.cuts.sum()))
        if until(one):
            return True, cut
    return False, cut


def test_a_wall_stands_at_once_and_goes_at_once(world):
    world.build((-0.5, -3.0), (-0.5, 3.0))
    assert world.tank.around.walls.shape == (1, 5) and world.tank.has_obstacles
    swim(world, Greedy(), most=80)
    assert world.swimmers[0].units[:, 0].max() < -0.5
    programs = len(POOL._compiled)
    world.build((3.0, 3.0), (4.0, 3.0))
    world.clear((-0.4, 1.0))
    np.testing.assert_allclose(world.tank.around.walls[:, :4], [[3.0, 3.0, 4.0, 3.0]])
    swim(world, Greedy(), most=60)
    assert world.swimmers[0].units[:, 0].max() > 0
    assert len(POOL._compiled) == programs  # walls are data
    world.clear()
    assert not world.tank.has_obstacles
    world.build((3.0, 3.0), (4.0, 3.0))
    world.reset(3)
    assert not world.tank.has_obstacles


def test_walls_of_a_world_stay_where_drawn_ones_go():
    world = World(seed=1, config=world_config("posts"))
    posts = world.tank.around.posts
    world.build((9.0, 9.0), (9.5, 9.0))
    world.pour(["delay"], "easy")
    assert len(world.tank.around.walls) == 1
    np.testing.assert_array_equal(world.tank.around.posts, posts)
    world.clear()
    assert len(world.tank.around.walls) == 0
    np.testing.assert_array_equal(world.tank.around.posts, posts)


@pytest.mark.parametrize(
    ("begin", "end", "opening", "said"),
    [
        ((0.0, 0.0), (0.01, 0.0), 0.0, "draw a longer wall: at least 5 cm, got 1 cm"),
        ((0.0, 0.0), (0.3, 0.0), 0.5, "draw a longer wall: at least 60 cm, got 30 cm"),
        ((0.0, 0.0), (0.5, 0.0), 0.1, "an opening is at least 14 cm wide, got 10 cm"),
        ((-0.8, -1.0), (-0.8, 1.0), 0.0, "a chain is where the wall would be"),
    ],
)
def test_a_wall_that_cannot_stand_changes_nothing(world, begin, end, opening, said):
    before = world.tank.world
    with pytest.raises(InputError, match=said):
        world.build(begin, end, opening)
    with pytest.raises(InputError, match="no wall was drawn"):
        world.clear((0.0, 0.0))
    assert world.tank.world is before and not world.tank.has_obstacles


def test_there_are_so_many_walls_at_most_and_one_gate(world):
    for k in range(MOST_WALLS):
        world.build((2.0, float(k)), (3.0, float(k)))
    with pytest.raises(InputError, match=f"{MOST_WALLS} walls stand already"):
        world.build((2.0, 9.0), (3.0, 9.0))
    for x in (0.0, 0.4):
        world.build((x, -1.0), (x, 1.0), 0.3)
    gates = world.tank.around.walls[MOST_WALLS:]
    np.testing.assert_allclose(gates[:, :4], [[0.4, -1, 0.4, -0.15], [0.4, 0.15, 0.4, 1]])
    assert world.tank.gap(np.array([[0.4, 0.0]]))[0] == pytest.approx(0.15)
    world.clear((0.4, 0.9))
    assert len(world.tank.around.walls) == MOST_WALLS


def test_the_way_leads_through_the_opening_only_where_the_wall_is_crossed():
    gate, up = Gate((0.0, -1.0), (0.0, 1.0), 0.4), np.array([0.0, 2.0])
    left, right = np.array([[-2.0, 0.5], [2.0, 0.3]])
    for start, goal, first in ((left, right, -0.02), (right, left, 0.02)):
        lane = gate.lane(start, goal)
        assert lane is not None
        np.testing.assert_allclose(lane, [[first, 0], [-first, 0]], atol=1e-9)
    assert gate.lane(left, left / 2) is None
    assert gate.lane(left + up, right + up) is None  # past its end


@pytest.fixture
def parted(world):
    """The chain on its way through an opening that two of its units fit, when it is apart."""
    world.build((0.0, -2.0), (0.0, 2.0), NARROWEST)
    assert swim(world, Caravan(), lambda one: one.is_apart)[0]
    return world


def test_a_chain_takes_itself_apart_to_pass_an_opening_and_joins_again(parted):
    recorder, touched = Recorder(0.1), []

    def arrived(one):
        recorder.keep([before[0]], [one], parted.current, "caravan")
        before[0] = one
        gaps = parted.tank.gap(one.units[:, :2])
        touched.append(gaps.min())
        return one.reached

    before = [parted.swimmers[0]]
    done, cut = swim(parted, Caravan(), arrived)
    (one,) = parted.swimmers
    assert done and cut == 1 and not one.is_apart
    assert one.units[:, 0].min() > 0.7 and min(touched) > 0.019  # half a unit: none was in a wall
    apart = np.linalg.norm(np.diff(one.units[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(apart, LINK, atol=3e-3)
    part = recorder.recording().parts[0]
    assert part.parted[0, 1] and not part.parted[-1].any()
    assert '"cuts"' in recording_page(recorder.recording())
    programs = len(POOL._compiled)
    parted.place(1, -0.8, 0.0, 0.0)  # and back
    assert swim(parted, Caravan(), lambda one: one.is_apart)[0]
    assert swim(parted, Caravan(), lambda one: one.reached)[0]
    assert parted.swimmers[0].units[:, 0].max() < -0.7 and len(POOL._compiled) == programs


def test_pieces_join_in_a_line_where_the_pose_is_too_sharp_and_then_take_it(world):
    """A hook that bends by 50 degrees where the chain is cut."""
    turns = np.radians([90, 90, 140])
    hook = np.vstack([[0, 0], np.cumsum(LINK * np.stack([np.cos(turns), np.sin(turns)], 1), 0)])
    world.draw(1, [tuple(point) for point in hook + np.array([0.8, 0.0])])
    world.build((0.0, -2.0), (0.0, 2.0), NARROWEST)
    done, cut = swim(world, Caravan(), lambda one: one.reached and one.trip is None)
    assert done and cut == 1


def test_edits_of_a_chain_that_is_apart_wait(parted):
    before = parted.swimmers
    edits = [
        lambda: parted.cut(1, 1), lambda: parted.grow(1), lambda: parted.shrink(1),
        lambda: parted.steer_by(Greedy().card),
    ]  # fmt: skip
    for edit in edits:
        with pytest.raises(InputError, match="the chain is apart: wait until it has joined again"):
            edit()
    assert parted.swimmers == before
    parted.place(1, 1.2, 0.5, 0.0)  # taken up once it is one chain again
    goal = parted.swimmers[0].trip.goal
    swim(parted, Caravan(), most=5)
    np.testing.assert_array_equal(parted.swimmers[0].trip.goal, goal)
    done, _ = swim(parted, Caravan(), lambda one: one.reached, most=1500)
    assert done and parted.swimmers[0].units[:, 0].mean() > 1.1
    parted.reset(4)
    assert parted.swimmers[0].trip is None


def test_without_a_wall_to_cross_the_policy_below_steers(world):
    """To the last bit, and no link is cut."""
    other = World(seed=1, swimmers=list(world.swimmers))
    caravan = Caravan()
    assert swim(world, caravan, most=30)[1] == 0
    swim(other, caravan.guide, most=30)
    np.testing.assert_array_equal(world.swimmers[0].units, other.swimmers[0].units)


@pytest.mark.slow
def test_a_gate_is_drawn_on_the_page_and_passed():
    server = live_server("caravan", "--seed", "4")
    with open_browser() as browser, server as (address, _), watched(browser, address) as page:
        until(page, "live.connected && live.policy && !live.loading", patience=120)
        assert page.input_value("#policy") == "caravan"
        page.evaluate("live.send('reset', {length: 4}); live.send('pause', {on: true})")
        until(page, "live.chains[0].units.length === 4")
        page.evaluate("live.send('place', {chain: live.chains[0].name, x: 1.6, y: 0, turn: 0})")
        until(page, "Math.abs(Tools.middle(live.chains[0].target)[0] - 1.6) < 0.01")
        page.wait_for_timeout(500)
        page.click("[data-tool=gate]")
        box = page.locator("#water").bounding_box()
        ends = [page.evaluate(f"live.camera.toScreen(0.8, {y})") for y in (-0.5, 0.5)]
        page.mouse.move(box["x"] + ends[0][0], box["y"] + ends[0][1])
        page.mouse.down()
        page.mouse.move(box["x"] + ends[1][0], box["y"] + ends[1][1], steps=5)
        page.mouse.up()
        until(page, "live.around.walls?.length === 2", patience=240)
        page.evaluate("live.send('pause', {on: false}); live.send('pace', {speed: 4})")
        until(page, "live.chains[0].units.some((unit) => unit[5])", patience=60)
        until(page, "live.chains[0].reached && live.chains.length === 1", patience=120)
        assert page.evaluate("live.chains[0].units.every((unit) => unit[0] > 0.8 && !unit[5])")
        page.click("#unwall")
        until(page, "!live.around.walls?.length")
        page.evaluate("live.send('pause', {on: true})")
        page.evaluate("live.send('place', {chain: live.chains[0].name, x: -1, y: 0, turn: 0})")
        until(page, "Tools.middle(live.chains[0].target)[0] < -0.9")
        page.wait_for_timeout(500)
        page.keyboard.press("w")
        until(page, "live.around.walls?.length === 2")
        page.keyboard.press("Shift+W")
        until(page, "!live.around.walls?.length")
