import functools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS, observation_size
from salpchain.tasks.observations import observe
from salpchain.tasks.reach.task import SCLD
from tests.physics.poses import along, resting


@functools.cache
def compiled(slots, observation):
    env = SCLD(TaskConfig(length=slots, observation=observation, contact=False))
    return jax.jit(env.reset), jax.jit(env.step)


def swum(length, slots=None, observation="body", seed=0, steps=15):
    """A state some steps after a reset, under random thrust.

    Few swims are compiled: of most observations the last state of one with `body` is observed.
    """
    own = observation == "body" or (observation == "table1" and slots is None)
    reset, step = compiled(slots or length, observation if own else "body")
    state = reset(jr.key(seed), length)
    for n in range(steps):
        key = jr.fold_in(jr.key(seed + 1), n)
        state = step(state, jr.uniform(key, (slots or length, 1), minval=-1, maxval=1))
    return state if own else replace(state, obs=seen(observation, state))


@functools.partial(jax.jit, static_argnums=0)
def seen(observation, state):
    env = SCLD(TaskConfig(length=len(state.target), observation=observation, contact=False))
    return env.observe(state.chain, state.target, state.force)


def by_hand(before, state, i):
    """Table 1 of the paper for unit i, a number at a time; the forces acted a step before."""
    units = jax.tree.map(np.asarray, state.chain.units)
    target, thrust = np.asarray(state.target), np.asarray(state.thrust)
    n, p, a = len(thrust), units.position, units.angle

    def wrapped(x):
        return (x + np.pi) % (2 * np.pi) - np.pi

    def bearing(j):
        if not 0 <= j < n:
            return 0.0
        dx, dy = p[j] - p[i]
        return wrapped(np.arctan2(dy, dx) - a[i])

    def force(j):
        if not 0 <= j < n:
            return [0.0, 0.0]
        up = (
            np.asarray(before.chain.units.angle)[j] + np.pi / 2
        )  # a positive thrust pushes along the unit's angle + 90 degrees
        return [thrust[j] * np.cos(up), thrust[j] * np.sin(up)]

    return np.array(
        [
            *[(i % 16) // 2**bit % 2 for bit in range(4)],
            *p[i],
            *units.velocity[i],
            wrapped(a[i]),
            units.angular_velocity[i],
            *(units.velocity[i] - units.velocity.mean(0)),
            *(p[i] - p.mean(0)),
            *(p[i] - target.mean(0)),
            *(target[i] - p[i]),
            bearing(i - 1),
            bearing(i + 1),
            *force(i - 1),
            *force(i + 1),
        ]
    )


@pytest.mark.parametrize("length", [2, 8, 20])
def test_table1_is_the_papers_table_read_number_by_number(length):
    before, state = (swum(length, observation="table1", steps=steps) for steps in (14, 15))
    expected = np.stack([by_hand(before, state, i) for i in range(length)])
    np.testing.assert_allclose(state.obs, expected, atol=2e-5)


def moved(state, turn, shift):
    """The same situation seen from elsewhere: everything turned about the origin and shifted."""
    rotation = jnp.array([[jnp.cos(turn), -jnp.sin(turn)], [jnp.sin(turn), jnp.cos(turn)]])
    units = state.chain.units
    chain = eqx.tree_at(
        lambda c: (c.units.position, c.units.angle, c.units.velocity),
        state.chain,
        (units.position @ rotation.T + shift, units.angle + turn, units.velocity @ rotation.T),
    )
    return chain, state.target @ rotation.T + shift


def test_body_does_not_depend_on_where_the_world_has_its_origin_and_axes():
    state = swum(8)
    chain, target = moved(state, 1.1, jnp.array([5.0, -3.0]))
    np.testing.assert_allclose(observe("body", chain, target, state.force), state.obs, atol=5e-5)


def test_table1_does_depend_on_the_origin():
    state = swum(8, observation="table1")
    chain, target = moved(state, 0.0, jnp.array([5.0, -3.0]))
    assert np.abs(observe("table1", chain, target, state.force) - state.obs).max() > 1


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_a_chain_in_more_slots_observes_what_it_observes_alone_and_dead_slots_nothing(name):
    alone, slotted = swum(5, observation=name), swum(5, slots=9, observation=name)
    np.testing.assert_allclose(slotted.obs[:5], alone.obs, atol=5e-5)
    assert not np.asarray(slotted.obs[5:]).any()


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_a_batch_observes_what_each_chain_observes_alone(name):
    states = [swum(5, observation=name, seed=seed) for seed in range(3)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *states)
    seen = jax.vmap(lambda c, t, f: observe(name, c, t, f))(batch.chain, batch.target, batch.force)
    assert seen.shape == (3, 5, observation_size(name))
    np.testing.assert_allclose(seen, jnp.stack([s.obs for s in states]), atol=1e-5)


def test_body_shows_the_ends_of_a_long_chain_as_it_does_those_of_a_short_one():
    ends = []
    for length in (8, 128):
        chain = along(np.zeros((1, length - 1)))
        chain = jax.tree.map(lambda x: x[0], resting(*chain))
        obs = observe("body", chain, chain.units.position + 0.1, jnp.zeros((length, 2)))
        ends.append(np.asarray(obs)[[0, -1]])
    np.testing.assert_allclose(*ends, atol=0.3)


def test_body_keeps_far_targets_in_the_range_of_near_ones():
    state = swum(8)
    far = observe("body", state.chain, state.target + 50.0, state.force)
    assert np.abs(far).max() < 8


def test_variants_of_proximity_leave_the_place_out_or_give_what_is_far_in_metres():
    state = swum(8)
    seen = (state.chain, state.target, state.force)
    whole, anonymous, metric = (observe(x, *seen) for x in ("proximity", "anonymous", "metric"))
    np.testing.assert_array_equal(anonymous, np.delete(whole, 21, axis=1))
    np.testing.assert_allclose(whole[:, 21], np.linspace(-1, 1, 8), atol=1e-6)
    far = slice(16, 20)
    np.testing.assert_array_equal(np.delete(metric, far, axis=1), np.delete(whole, far, axis=1))
    error = np.asarray(state.target - state.chain.units.position)
    apart = np.linalg.norm(np.asarray(metric[:, 16:18]), axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(error, axis=1), rtol=1e-5)


def nearest_by_hand(points, joined, i):
    """Of unit i, in world axes, one pair at a time."""

    def neighbour(j):
        return abs(i - j) == 1 and joined[min(i, j)]

    others = [j for j in range(len(points)) if j != i and not neighbour(j)]
    if not others:
        return np.zeros(2)
    offsets = [points[j] - points[i] for j in others]
    offset = min(offsets, key=np.linalg.norm)
    apart = np.linalg.norm(offset)
    return offset / apart * 2 * max(0.0, 1 - apart / 0.2)


@pytest.mark.parametrize("cut", [None, 3])
def test_proximity_is_body_and_what_a_naive_search_finds_nearest(cut):
    state = swum(9, observation="proximity", steps=60)
    linked = np.ones(8, bool)
    if cut is not None:
        linked[cut] = False
    chain = eqx.tree_at(lambda c: c.linked, state.chain, jnp.asarray(linked))
    seen = observe("proximity", chain, state.target, state.force)
    body = observe("body", chain, state.target, state.force)
    np.testing.assert_allclose(seen[:, :22], body, atol=1e-6)
    points, angle = np.asarray(chain.units.position), np.asarray(chain.units.angle)
    for i in range(9):
        x, y = nearest_by_hand(points, linked, i)
        cosine, sine = np.cos(angle[i]), np.sin(angle[i])
        expected = [cosine * x + sine * y, cosine * y - sine * x]
        np.testing.assert_allclose(seen[i, 22:], expected, atol=1e-4)
    assert np.abs(seen[:, 22:]).max() > 0.1


def test_a_pair_has_no_unit_but_neighbours_to_be_near():
    assert not np.asarray(swum(2, slots=9, observation="proximity").obs[:, 22:]).any()
