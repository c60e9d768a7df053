"""Worlds: each part does what it says, alone, and the still world is today's to the bit."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
import scipy.stats

import salpchain
from salpchain.evaluation.limits import _sum_of_sums
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from salpchain.ranges import Range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.state import Judgement, Start
from salpchain.tasks.task import Task
from salpchain.world.config import CurrentConfig, SensingConfig, ThrusterConfig, WorldConfig
from salpchain.world.current import Shear, Sum, Uniform, Vortex, Wandering
from salpchain.world.obstacles import make_obstacles
from salpchain.world.presets import WORLDS
from salpchain.world.randomise import draw_world
from salpchain.world.sensing import Sensing
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World

UNITS = 4
PLACES = jnp.arange(UNITS)[:, None] * jnp.array([Physics.link_length, 0.0])
CHAIN = at_rest(PLACES, jnp.zeros(UNITS))


def drift(current, steps=150):
    """The chain after so many control steps without thrust."""
    world = World(current=current)
    body = lambda chain, _: (world.step(chain, jnp.zeros(UNITS)), None)  # noqa: E731
    return jax.jit(lambda chain: jax.lax.scan(body, chain, None, length=steps)[0])(CHAIN)


def test_without_thrust_a_chain_ends_up_drifting_with_a_uniform_current():
    moved = drift(Uniform((0.03, -0.02)))
    every = jnp.concatenate([moved.units.velocity, moved.links.velocity])  # soft joints rattle
    np.testing.assert_allclose(every.mean(axis=0), [0.03, -0.02], atol=1e-5)


def test_a_chain_in_the_middle_of_a_vortex_turns_with_it():
    centre = tuple(PLACES.mean(axis=0))
    vortex = Vortex(speed=0.05, radius=2.0, centre=centre)  # wide: like a solid where the chain is
    spin = float(vortex.flow(jnp.array([centre])).spin[0])
    before, after = drift(vortex, 100), drift(vortex, 300)
    turned = (after.units.angle - before.units.angle).mean()
    assert float(turned) == pytest.approx(20.0 * spin, rel=0.02)
    np.testing.assert_allclose(after.units.position.mean(axis=0), centre, atol=5e-3)


@pytest.mark.parametrize("current", [
    Shear(rate=0.3, angle=0.7, centre=(0.1, 0.2)),
    Vortex(speed=0.05, radius=0.4, centre=(0.3, -0.1)),
    Sum((Uniform((0.1, 0.0)), Shear(rate=-0.2))),
])  # fmt: skip
def test_the_spin_of_a_current_is_half_the_curl_of_its_velocity(current):
    at = lambda point: current.flow(point[None]).velocity[0]  # noqa: E731
    for point in jr.normal(jr.key(0), (20, 2)):
        slope = jax.jacfwd(at)(point)
        curl = float(slope[1, 0] - slope[0, 1])
        assert float(current.flow(point[None]).spin[0]) == pytest.approx(curl / 2, abs=1e-5)


def test_a_vortex_is_fastest_at_its_core():
    vortex, radii = Vortex(speed=0.08, radius=0.3), jnp.linspace(0.01, 2.0, 400)
    speeds = jnp.linalg.norm(vortex.flow(jnp.stack([radii, 0 * radii], axis=1)).velocity, axis=1)
    assert float(speeds.max()) == pytest.approx(0.08, rel=1e-3)
    assert float(radii[speeds.argmax()]) == pytest.approx(0.3, abs=0.01)


def test_a_wandering_current_has_its_deviation_and_forgets_in_its_time():
    start = Wandering(deviation=0.02, relaxation=3.0, mean=(0.01, 0.0))

    def body(current, key):
        after = current.advance(key, 0.1)
        return after, after.now

    _, seen = jax.lax.scan(body, start, jr.split(jr.key(1), 60_000))
    seen = np.asarray(seen[1000:])
    assert seen.std() == pytest.approx(0.02, rel=0.1)
    late = np.mean(seen[30:, 0] * seen[:-30, 0]) / seen[:, 0].var()
    assert late == pytest.approx(np.exp(-1), abs=0.1)
    np.testing.assert_allclose(start.flow(PLACES).velocity, [[0.01, 0.0]] * UNITS)


def test_thrusters_are_weak_dead_fail_lag_and_push_one_way():
    asked, before, now = jnp.array([1.0, -1.0, 0.5, -0.5]), jnp.zeros(UNITS), jnp.int32(7)
    fails = jnp.array([100, 7, 8, 100], jnp.int32)
    given = Thrusters(gain=jnp.array([1.0, 1.0, 0.5, 0.0]), fails_at=fails)
    np.testing.assert_allclose(given.thrust(asked, before, now, 0.1), [1.0, 0.0, 0.25, 0.0])
    one_way = Thrusters(one_sided=True).thrust(asked, before, now, 0.1)
    np.testing.assert_allclose(one_way, [1.0, 0.0, 0.5, 0.0])
    late = Thrusters(lag=0.2)
    thrust = before
    for _ in range(3):
        thrust = late.thrust(asked, thrust, now, 0.1)
    np.testing.assert_allclose(thrust, asked * (1 - np.exp(-0.3 / 0.2)), rtol=1e-5)


def sensed(sensing, steps=400):
    """What is told of a chain whose units are numbered by their x at each step: (step, unit)."""
    start = at_rest(jnp.zeros((UNITS, 2)), jnp.zeros(UNITS))
    senses, told = sensing.start(jr.key(0), start, 1), []
    move = jax.jit(sensing.sense)
    for index in range(1, steps + 1):
        here = at_rest(jnp.full((UNITS, 2), float(index)), jnp.zeros(UNITS))
        senses = move(jr.key(index), here, senses)
        told.append(np.asarray(senses.of(here).units.position[:, 0]))
    return np.array(told)


def test_readings_come_late_by_the_delay():
    np.testing.assert_allclose(sensed(Sensing(delay=3, most_delay=5), 9)[4:, 0], [2, 3, 4, 5, 6])


def test_noise_and_bias_have_their_deviations():
    noisy = sensed(Sensing(position=0.3)) - np.arange(1, 401)[:, None]
    assert noisy.std() == pytest.approx(0.3, rel=0.1)
    biased = sensed(Sensing(position_bias=0.3), 5) - np.arange(1, 6)[:, None]
    assert np.ptp(biased, axis=0).max() < 1e-5 and biased.std() > 0.05


def test_noise_is_gaussian_and_that_of_a_unit_a_coordinate_or_a_step_tells_nothing_of_another():
    sensing = Sensing(position=1.0, angle=1.0, velocity=1.0, turning=1.0)
    senses = sensing.start(jr.key(0), CHAIN, 1)

    def noise(chain, step):
        key = jr.fold_in(jr.key(chain), step)
        told = sensing.sense(key, CHAIN, senses).told
        apart = jax.tree.map(jnp.subtract, told, CHAIN.units)
        return jnp.concatenate([x.reshape(-1) for x in jax.tree.leaves(apart)])

    every = jax.vmap(jax.vmap(noise, (None, 0)), (0, None))(jnp.arange(40), jnp.arange(100))
    columns = np.asarray(every).reshape(4000, 6 * UNITS)
    assert min(scipy.stats.kstest(column, "norm").pvalue for column in columns.T) > 1e-3
    later = np.hstack([columns[:-1], columns[1:]])  # of the next step; or of the next chain
    correlation = np.corrcoef(later.T) - np.eye(12 * UNITS)
    assert abs(correlation).max() < 5 / np.sqrt(4000)


@pytest.mark.parametrize("kind", ["stuck", "dropped"])
def test_a_reading_that_is_stuck_or_dropped_stays_so_for_its_steps(kind):
    told = sensed(Sensing(**{kind: 0.05, f"{kind}_steps": 4}))
    late = np.arange(1, 401)[:, None] - told
    assert (late > 0).mean() == pytest.approx(1 - 0.95 / (0.95 + 0.05 * 4), abs=0.05)
    assert late.max() >= 4 and set(np.unique(late)) <= set(range(41))


def test_an_action_comes_late_and_is_held():
    sensing = Sensing(action_delay=2, most_action_delay=3)
    senses, acted = sensing.start(jr.key(0), CHAIN, 1), []
    for time in range(6):
        action, senses = sensing.given(senses, jnp.full((UNITS, 1), time + 1.0), jnp.int32(time))
        acted.append(float(action[0, 0]))
    assert acted == [0, 0, 1, 2, 3, 4]
    sensing = Sensing(repeat=3, repeats=True)
    senses, acted = sensing.start(jr.key(0), CHAIN, 1), []
    for time in range(7):
        action, senses = sensing.given(senses, jnp.full((UNITS, 1), time + 1.0), jnp.int32(time))
        acted.append(float(action[0, 0]))
    assert acted == [1, 1, 1, 4, 4, 4, 7]


def test_what_is_dropped_is_observed_as_zeros():
    world = WorldConfig(sensing=SensingConfig(dropped=Range(1.0, 1.0)))
    env = salpchain.SCLD(TaskConfig(length=UNITS), world)
    state = env.step(env.reset(jr.key(0)), jnp.ones((UNITS, 1)))
    assert not state.obs.any() and state.chain.units.velocity.any()


@pytest.mark.parametrize("dead", [0.0, 0.25, 0.5, 1.0])
def test_as_many_thrusters_are_dead_as_was_asked_for(dead):
    config = WorldConfig(thrusters=ThrusterConfig(dead=Range(dead, dead), lag=Range(0.1, 0.1)))
    draw = jax.jit(jax.vmap(lambda key: draw_world(config, key, 12, 8, 100).thrusters.gain))
    gains = np.asarray(draw(jr.split(jr.key(0), 50)))
    assert ((gains[:, :8] == 0).sum(axis=1) == round(8 * dead)).all()
    assert dead in (0.0, 1.0) or len(np.unique(gains[:, :8], axis=0)) > 20


def test_numbers_of_a_world_are_drawn_anew_and_evenly():
    config = WorldConfig(current=CurrentConfig(speed=Range(0.02, 0.06)))
    draw = jax.jit(jax.vmap(lambda key: draw_world(config, key, 4, 4, 100).current.velocity))
    velocity = np.asarray(draw(jr.split(jr.key(0), 4000)))
    speed = np.linalg.norm(velocity, axis=1)
    assert 0.02 <= speed.min() < 0.0205 and 0.0595 < speed.max() <= 0.06
    assert np.histogram(speed, 4)[0].min() > 850
    assert np.abs(velocity.mean(axis=0)).max() < 0.002


def operations(env):
    """The operations of a compiled step, without their names."""
    state = jax.eval_shape(env.reset, jr.key(0))
    action = jax.ShapeDtypeStruct((UNITS, 1), jnp.float32)
    lines = jax.jit(env.step).lower(state, action).compile().as_text().splitlines()
    return [line.split(" = ")[1].split("metadata")[0] for line in lines if " = " in line]


def test_a_world_whose_parts_are_none_has_the_operations_of_the_plain_one():
    config = TaskConfig(length=UNITS)
    plain = operations(salpchain.SCLD(config))
    assert plain == operations(salpchain.SCLD(config, "still"))
    assert plain != operations(salpchain.SCLD(config, "failing"))


@pytest.mark.slow
@pytest.mark.parametrize("name", WORLDS)
def test_every_named_world_swims_in_a_batch_of_mixed_lengths(name):
    env = salpchain.SCLD(TaskConfig(length=6), name)
    states = jax.jit(jax.vmap(env.reset))(jr.split(jr.key(0), 3), jnp.array([2, 4, 6]))
    move = jax.jit(jax.vmap(env.step))
    for _ in range(5):
        states = move(states, jnp.ones((3, 6, 1)))
    assert jnp.isfinite(states.obs).all() and not states.invalid.any()
    assert not states.obs[0, 2:].any()


def test_a_chain_with_other_constants_starts_at_rest_with_its_joints_closed():
    env = salpchain.SCLD(TaskConfig(length=4, contact=False), Physics(link_length=0.10))
    state = env.reset(jr.key(0))
    gaps = jnp.linalg.norm(jnp.diff(state.chain.units.position, axis=0), axis=1)
    np.testing.assert_allclose(gaps, 0.10, rtol=1e-5)
    np.testing.assert_allclose(
        jnp.linalg.norm(jnp.diff(state.target, axis=0), axis=1), 0.10, rtol=1e-4
    )
    after = jax.jit(env.step)(state, jnp.zeros((4, 1)))
    assert jnp.abs(after.chain.units.velocity).max() < 1e-5


def farthest(world):
    """The greatest y of a chain that pushes towards +y for 4 s."""
    env = salpchain.SCLD(TaskConfig(length=UNITS), world)
    move = jax.jit(lambda state: env.step(state, jnp.ones((UNITS, 1))))
    state = env.start(CHAIN, PLACES + 1.0, jr.key(0))
    for _ in range(40):
        state = move(state)
    return float(state.chain.units.position[:, 1].max())


@pytest.mark.slow
def test_a_wall_in_the_world_stops_what_swims_against_it():
    wall = make_obstacles(walls=[((-1.0, 0.2), (1.0, 0.2), 0.1)])  # its face is at y = 0.15 m
    assert farthest(World()) > 0.3
    assert farthest(World(obstacles=wall)) < 0.15 - Physics.unit_width / 2 + 2e-3


def test_the_still_world_is_the_bare_step():
    thrust = jnp.linspace(-1.0, 1.0, UNITS)
    one, other = World().step(CHAIN, thrust), step(CHAIN, thrust)
    assert (one.units.position == other.units.position).all()


def test_an_unknown_world_is_refused_with_the_names():
    for use in (salpchain.SCLD, lambda config, world: salpchain.record("greedy", 4, world=world)):
        with pytest.raises(salpchain.InputError, match="world 'choppy': choose one of still"):
            use(TaskConfig(), "choppy")


@pytest.mark.slow
def test_policies_are_tested_and_shown_in_a_world_that_draws_its_physics(tmp_path):
    tested = salpchain.evaluate("greedy", 3, 4, world="rough", out=tmp_path)
    assert tested["world"] == "rough" and 0 <= tested["lengths"][0]["success"]["mean"] <= 1
    with pytest.raises(salpchain.InputError, match="other results of greedy: world rough"):
        salpchain.evaluate("greedy", 3, 4, out=tmp_path)
    (swim,) = salpchain.record("greedy", 3, world="failing")
    assert swim.world == "failing" and np.isfinite(swim.unit_position).all()


def test_the_limits_of_a_world_with_drawn_drag_are_those_of_each_drag():
    swum = lambda drag: _sum_of_sums(1 - drag, 5)  # noqa: E731
    drawn = jax.jit(jax.vmap(swum))(jnp.array([0.0, 0.2, 0.5]))
    naive = [sum(sum((1 - d) ** i for i in range(j)) for j in range(5)) for d in (0.0, 0.2, 0.5)]
    np.testing.assert_allclose(drawn, naive, rtol=1e-5)
    np.testing.assert_allclose([swum(0.0), swum(0.2), swum(0.5)], naive, rtol=1e-9)


@pytest.mark.slow
def test_an_action_of_nan_ends_the_episode_and_nothing_turns_nan_in_any_world():
    for name in WORLDS:
        env = salpchain.SCLD(TaskConfig(length=UNITS), name)
        after = jax.jit(env.step)(env.reset(jr.key(0)), jnp.full((UNITS, 1), jnp.nan))
        assert after.invalid and after.terminated
        floats = [x for x in jax.tree.leaves(after) if jnp.issubdtype(x.dtype, jnp.floating)]
        assert all(jnp.isfinite(x).all() for x in floats)


class Hold(Task):
    """A task of one's own: stay where the chain starts."""

    @property
    def weights(self):
        return {"near": 1.0}

    def begin(self, key, draw_key, length, physics):
        return Start(CHAIN, CHAIN.units.position)

    def judge(self, before, after):
        return Judgement({"near": -after.distances.mean}, jnp.zeros((), bool))


def test_a_task_of_ones_own_swims_in_a_world_and_needs_no_goal():
    env = Hold(TaskConfig(length=UNITS), World(current=Uniform((0.05, 0.0))))
    state = env.reset(jr.key(0))
    for _ in range(3):
        state = env.step(state, jnp.zeros((UNITS, 1)))
    assert float(state.reward) == pytest.approx(-float(state.distances.mean)) != 0
    assert set(state.terms) == {"near"} and not state.goal and not state.terminated
