"""Worlds on the live page: chains swim as the task does in them, and edits mind the walls."""

from dataclasses import fields

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.errors import InputError
from salpchain.evaluation.suites import SUITES
from salpchain.evaluation.surroundings import Surroundings
from salpchain.physics.state import at_rest
from salpchain.ranges import Range
from salpchain.report.recorded import recording_page
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.web import swimmer
from salpchain.web.pool import Pool
from salpchain.web.recorder import Recorder
from salpchain.web.swimmer import ANGLE, LINK, NEVER
from salpchain.web.tank import MOST_UNITS
from salpchain.web.troubles import LENGTH, TROUBLES, poured
from salpchain.web.world import HARDEST_KICK, World
from salpchain.world.config import (
    CurrentConfig,
    ObstacleConfig,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)
from salpchain.world.presets import world_config
from salpchain.world.thrusters import Thrusters
from tests.interop.policies import fresh
from tests.web.browser import live_server, open_browser, until, watched

POOL = Pool()


def fixed(value):
    return Range(value, value)


ALL = WorldConfig(
    "all",
    current=CurrentConfig(vortex=fixed(0.05)),
    thrusters=ThrusterConfig(dead=fixed(0.34), gain=Range(0.7, 0.9), lag=fixed(0.2)),
    sensing=SensingConfig(delay=fixed(2.0), action_delay=fixed(1.0)),
    obstacles=ObstacleConfig(room=fixed(0.2), walls=fixed(1.0), posts=fixed(2.0)),
)


@pytest.fixture
def world():
    world = World(seed=2, config=ALL)
    world.reset(6)
    return world


def only(world):
    (one,) = world.swimmers
    return one


def swim(world, steps=1):
    for _ in range(steps):
        world.advance(POOL, Greedy())


def deepest(world):
    """How far the corners and sides of any unit are inside a surface (m)."""
    x, y, angle = np.vstack([one.units[:, :3] for one in world.swimmers]).T
    depths = []
    for along, across in [(0.02, 0.025), (0.02, 0.0), (0.0, 0.025)]:
        for a, b in [(along, across), (along, -across), (-along, across), (-along, -across)]:
            turned = a * np.cos(angle) - b * np.sin(angle), a * np.sin(angle) + b * np.cos(angle)
            depths.append(-world.tank.gap(np.stack([x + turned[0], y + turned[1]], 1)).min())
    return max(depths)


def test_a_chain_swims_as_it_would_in_the_task_in_that_world(world):
    """Current, weak, dead and failing thrusters, lag, late readings and actions, obstacles."""
    fails_at = np.where(np.arange(6) == np.flatnonzero(only(world).works)[0], 4, NEVER)
    world.swimmers = [swimmer.replace(only(world), fails_at=fails_at)]
    x, y = only(world).units[:, :2].mean(axis=0)
    world.place(only(world).name, x, y + 2.0, 0.0)
    one, there = only(world), world.tank.world
    assert one.works.sum() == 4 and one.gain[one.works].max() < 0.9 < one.gain[~one.works].min()
    made = Thrusters(
        jnp.asarray(one.gain * one.works, jnp.float32), jnp.asarray(fails_at, jnp.int32),
        there.thrusters.lag,
    )  # fmt: skip
    env = SCLD(TaskConfig(6), eqx.tree_at(lambda w: w.thrusters, there, made))
    env = eqx.tree_at(lambda e: e.world, env, swimmer.replace(env.world, drawn_from=None))
    chain = at_rest(jnp.asarray(one.units[:, :2]), jnp.asarray(one.units[:, ANGLE]))
    state = env.start(chain, jnp.asarray(one.target), jr.key(0))
    step = eqx.filter_jit(lambda state: env.step(state, Greedy().act(state)))
    for _ in range(25):
        state = step(state)
        swim(world)
        np.testing.assert_allclose(only(world).units[:, :2], state.chain.units.position, atol=5e-4)
    assert only(world).works.sum() == 3  # one has failed by now
    assert np.abs(only(world).units[:, :2] - one.units[:, :2]).max() > 0.1


def test_a_policy_that_sees_several_steps_swims_as_it_would_in_the_task():
    """Two chains, so that each is shown its own."""
    policy = fresh(observation="jets*3")
    world = World(seed=5)
    world.reset(9)
    world.cut(only(world).name, 3)
    states = []
    for one in world.swimmers:
        env = SCLD(TaskConfig(one.length, "jets*3"))
        chain = at_rest(jnp.asarray(one.units[:, :2]), jnp.asarray(one.units[:, ANGLE]))
        states.append((env, env.start(chain, jnp.asarray(one.target), jr.key(0))))
    for _ in range(3):  # from then on, what the joints give sets them apart
        shown = [state.obs for _, state in states]
        states = [(env, env.step(state, policy.act(state))) for env, state in states]
        world.advance(POOL, policy)
    for one, obs, (_, state) in zip(world.swimmers, shown, states, strict=True):
        np.testing.assert_allclose(one.units[:, :2], state.chain.units.position, atol=2e-3)
        as_if_always = np.tile(obs[:, : obs.shape[1] // 3], 3)
        assert np.mean(np.abs(one.seen - obs)) < np.mean(np.abs(as_if_always - obs)) / 4
    world.grow(world.swimmers[0].name)
    assert world.swimmers[0].seen is None is not world.swimmers[1].seen
    world.advance(POOL, policy)
    world.advance(POOL, Greedy())  # who is shown nothing again
    assert all(one.seen is None for one in world.swimmers)


def test_no_unit_enters_a_wall_whatever_is_done(world):
    """Its target is far outside the room; it is cut, kicked and joined on the way."""
    recorder, far = Recorder(0.1, "all"), [5.0, 1.0]
    world.place(only(world).name, *far, 0.0)
    for step in range(90):
        if step == 30:
            world.cut(only(world).name, 2)
        if 35 <= step < 55:
            for one in world.swimmers:
                world.place(one.name, *far, 0.0)
                for unit in range(one.length):
                    world.push(one.name, unit, HARDEST_KICK, 0.0)
        if step == 60:
            world.flow(0.2, 0.0)
        if step == 75:
            world.reset(5)
            world.place(only(world).name, *far, 0.0)
        before, around = world.swimmers, world.tank.around
        swim(world)
        recorder.keep(before, world.swimmers, world.current, "greedy", around)
        assert deepest(world) < 2e-3
    recording = recorder.recording()
    walls = [around.walls for _, around in recording.around]
    assert recording.around[0][0] == 0 and not np.array_equal(walls[0], walls[-1])
    begins = [step for step, _ in recording.around]
    assert 75 in begins and len(begins) <= 12  # the new walls at once, water once a second
    assert ", world all" in recording_page(recording)


def test_a_new_world_is_clear_of_chain_and_target_at_every_length():
    world = World(seed=1, config=world_config("posts"))
    seen = []
    for length in (2, 9, MOST_UNITS):
        world.reset(length)
        one = only(world)
        assert world.tank.has_obstacles
        assert world.tank.gap(np.vstack([one.units[:, :2], one.target])).min() > LINK - 1e-4
        seen.append(world.tank.around.posts)
    assert not np.array_equal(seen[0][0], seen[1][0])
    again = World(seed=1, config=world_config("posts")).tank.around.posts
    np.testing.assert_array_equal(again, World(1, config=world_config("posts")).tank.around.posts)


def walled(world, *walls, posts=()):
    """Stands these walls and posts in a world, in place of its own."""
    walls, posts = np.reshape(walls, (-1, 5)), np.reshape(posts, (-1, 3))
    world.tank.around = Surroundings(walls=walls.astype(float), posts=posts.astype(float))


def test_edits_mind_the_walls():
    """A straight chain along x: a wall ahead of its last unit, then one before another chain."""
    target = np.stack([LINK * np.arange(4), np.ones(4)], 1)
    one = swimmer.straight(1, 4, np.array([1.5 * LINK, 0.0]), 0.0, target)
    world = World(swimmers=[one])
    end = one.units[-1, 0]
    walled(world, (end + 0.06, -0.5, end + 0.06, 0.01, 0.04))
    world.grow(1)
    new = only(world).units[-1, :2]
    assert new[1] > 0.03 and world.tank.gap(new[None])[0] > 0.03  # it leans away
    walled(world, *[(end + x, -0.5, end + x, 0.5, 0.04) for x in (0.02, 0.13)])
    with pytest.raises(InputError, match="no room"):
        world.grow(1)
    other = swimmer.straight(2, 3, np.array([end + 0.2 + LINK, 0.0]), 0.0, target[:3])
    world.swimmers = [one, other]
    walled(world, (end + 0.1, -0.5, end + 0.1, 0.5, 0.04))
    with pytest.raises(InputError, match="in the way"):
        world.join(1, 2)
    assert world.swimmers == [one, other]
    walled(world, posts=[(0.1, 0.4, 0.3), (0.1, -0.4, 0.3)])
    for _ in range(5):
        world.retarget(1)
        assert world.tank.gap(world.swimmers[0].target).min() > LINK
    world.join(1, 2)


def test_gaps_are_those_to_boxes_and_circles():
    world = World()
    walled(world, (0.0, 0.0, 2.0, 0.0, 0.2), posts=[(0.0, 5.0, 1.0)])
    points = np.array([[1.0, 0.5], [3.0, 1.1], [1.0, 0.04], [0.0, 3.0], [0.0, 5.5]])
    np.testing.assert_allclose(world.tank.gap(points), [0.4, 2**0.5, -0.06, 1.0, -0.5], atol=1e-9)


@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize("grade", [0, 2])
def test_a_trouble_is_that_of_the_suite_and_leaves_the_rest_still(trouble, grade):
    which = {name: jnp.int32((1 + grade) * (name == trouble)) for name in TROUBLES}
    world = poured(WorldConfig(), which)
    meant = SUITES["sea"].troubles[trouble](grade, LENGTH)
    meant = [meant["changing"]] if trouble == "current" else list(meant.values())
    wanted = {path: value for one in meant for path, value in one.changes(WorldConfig()).items()}
    assert wanted or (trouble, grade) == ("repeat", 0)
    for part in ("dynamics", "current", "thrusters", "sensing", "obstacles"):
        for one in fields(getattr(world, part)):
            value, still = (getattr(getattr(x, part), one.name) for x in (world, WorldConfig()))
            right = wanted.get(f"{part}.{one.name}", still)
            if isinstance(right, Range):
                value = [float(value.low), float(value.high)]
            assert value == pytest.approx(right), one.name


def test_troubles_poured_on_a_chain_take_hold_at_once_and_nothing_else_changes():
    world = World(seed=2, config=WorldConfig(obstacles=ALL.obstacles))
    world.reset(6)
    world.place(only(world).name, 0.0, 2.0, 0.0)
    before, walls = only(world), world.tank.world.obstacles
    world.pour(["delay", "repeat"], "hard")
    same = [only(world).units, only(world).works, world.tank.world.obstacles.posts.radius]
    for one, other in zip(same, [before.units, before.works, walls.posts.radius], strict=True):
        np.testing.assert_array_equal(one, other)
    sensing = world.tank.world.sensing
    assert [int(x) for x in (sensing.delay, sensing.action_delay, sensing.repeat)] == [3, 3, 3]
    swim(world, 3)
    assert not only(world).thrust.any()  # the first action is on its way
    swim(world, 2)
    assert only(world).thrust.any()
    world.pour(["one-sided", "dead"], "medium")
    assert not int(world.tank.world.sensing.delay) and bool(world.tank.world.thrusters.one_sided)
    assert (~only(world).works).sum() == 2 and (only(world).gain == 1).all()
    swim(world, 5)
    assert (only(world).thrust > -0.1).all()  # what the lag leaves of thrusts backwards
    dead = only(world).works
    world.pour(["one-sided", "dead", "noise"], "medium")
    np.testing.assert_array_equal(only(world).works, dead)
    world.pour([], "medium")
    assert only(world).works.all()
    sizes = len(POOL._compiled)
    world.reset(4)
    world.pour(TROUBLES, "easy")
    swim(world, 2)
    assert len(POOL._compiled) == sizes and np.isfinite(only(world).units).all()


def test_a_thruster_fails_after_it_was_doomed_and_not_before():
    world = World(seed=3)
    swim(world, 40)
    world.pour(["failing"], "hard")
    doomed = only(world).fails_at < NEVER
    assert doomed.sum() == 6 and (only(world).fails_at[doomed] >= 40).all()
    assert only(world).works.all()


@pytest.mark.parametrize(
    ("names", "grade", "said"),
    [
        (["sharks"], "easy", "unknown trouble 'sharks': choose of delay, noise"),
        (["delay"], "wild", "unknown grade 'wild': choose one of easy, medium, hard"),
    ],
)
def test_a_trouble_that_there_is_not_changes_nothing(world, names, grade, said):
    before = world.tank.world
    with pytest.raises(InputError, match=said):
        world.pour(names, grade)
    assert world.tank.world is before and not world.tank.troubles


def stone(page, camera, where):
    """Whether the colour of a wall is at a point of the world."""
    return page.evaluate(
        """([x, y]) => { const at = CAMERA.toScreen(x, y), ratio = window.devicePixelRatio;
        const [r, g, b] = document.getElementById("water").getContext("2d")
          .getImageData(at[0] * ratio, at[1] * ratio, 1, 1).data;
        return "#" + [r, g, b].map((v) => v.toString(16).padStart(2, "0")).join("")
          === Salp.theme().stone; }""".replace("CAMERA", camera),
        [float(value) for value in where],
    )


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


def test_walls_are_drawn_in_a_recording(world, browser, tmp_path):
    recorder, before = Recorder(0.1, "all"), world.swimmers
    recorder.keep(before, before, world.current, "greedy", world.tank.around)
    (tmp_path / "swim.html").write_text(recording_page(recorder.recording()))
    with watched(browser, (tmp_path / "swim.html").as_uri()) as page:
        until(page, "replay.swims[0].camera.scale > 60")
        walls = world.tank.around.walls
        camera = "replay.swims[0].camera"
        assert all(stone(page, camera, (wall[:2] + wall[2:4]) / 2) for wall in walls)
        assert not stone(page, camera, only(world).target.mean(axis=0))


@pytest.mark.slow
def test_troubles_are_poured_on_from_the_page_and_taken_away(browser):
    with live_server("greedy", "--seed", "1") as (address, _), watched(browser, address) as page:
        until(page, "live.frames > 3 && live.policy && !live.loading")
        assert page.is_hidden("#troubles")
        page.click("#trouble")
        page.click("[data-trouble=dead]")
        until(page, "live.troubles.includes('dead')", patience=60)
        page.select_option("#grade", "hard")
        until(page, "live.chains[0].units.filter((unit) => !unit[4]).length === 6")
        page.click("[data-trouble='one-sided']")
        until(page, "live.troubles.length === 2 && live.grade === 'hard'")
        time = page.evaluate("live.time")
        until(page, f"live.time > {time} + 0.5")
        assert page.evaluate("live.chains[0].units.every((unit) => unit[3] >= 0)")
        assert page.inner_text("#trouble") == "Trouble (2)"
        assert page.get_attribute("[data-trouble=dead]", "aria-pressed") == "true"
        page.click("#calm")
        until(page, "!live.troubles.length && live.chains[0].units.every((unit) => unit[4])")
        page.keyboard.press("m")
        assert page.is_hidden("#troubles")


def test_posts_are_drawn_on_the_page_clear_of_the_chain(browser):
    asked = "greedy", "--world", "posts", "--seed", "1"
    with live_server(*asked) as (address, _), watched(browser, address) as page:
        until(page, "live.around && live.frames > 3 && live.chains.length")
        page.keyboard.press("Space")
        until(page, "live.paused")
        epoch = page.evaluate("live.epoch")
        page.keyboard.press("r")  # and stands where it begins
        until(page, f"live.paused && live.epoch > {epoch} && live.chains.length")
        posts = page.evaluate("live.around.posts")
        seen = [post for post in posts if in_view(page, post)]
        assert len(posts) >= 3 and seen and page.evaluate("live.world") == "posts"
        assert all(stone(page, "live.camera", post[:2]) for post in seen)
        units = np.array(page.evaluate("live.chains[0].units"))[:, :2]
        assert min(np.hypot(*(units - post[:2]).T).min() - post[2] for post in posts) > 0.06


def in_view(page, post):
    return page.evaluate(
        "(p) => { const [x, y] = live.camera.toScreen(p[0], p[1]);"
        " return x > 0 && y > 110 && x < live.camera.box[2] && y < live.camera.box[3] - 60; }",
        post,
    )
