"""Derivatives of a step and of whole swims: forward, backward, and as finite differences have them.

A derivative of many steps is compared with how much a swim changes under a change of thrust that is
large against the chatter of the joints (see docs/gradients.md), so its tolerance is a few percent.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.named import load
from salpchain.physics.chain import step
from salpchain.physics.state import Physics
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS
from salpchain.tasks.reach.task import SCLD
from tests.physics.poses import in_double_precision, lively, thrusts

LENGTHS = (2, 7, 64)


@functools.cache
def start(length, **settings):
    settings = {"contact": False, "fine_weight": 0.5, **settings}
    env = SCLD(TaskConfig(length=length, **settings))
    return env, jax.jit(env.reset)(jr.key(0))


def swim(env, state, actions):
    """Sum of rewards, and how far the chain has come and turned, after these actions."""
    state, rewards = jax.lax.scan(
        lambda state, action: (after := env.step(state, action), after.reward), state, actions
    )
    units = state.chain.units
    return jnp.stack([rewards.sum(), units.position[0, 0], units.position[:, 1].mean()])


def random_actions(seed, steps, length):
    """Actions and a direction in which they change, the same in every step."""
    here, there = jr.split(jr.key(seed))
    actions = jr.uniform(here, (steps, length, 1), minval=-0.6, maxval=0.6)
    change = jr.uniform(there, (length, 1), minval=-1, maxval=1)
    return actions, jnp.broadcast_to(change, actions.shape)


def difference(function, x, change, size):
    """The central finite difference along a change, of this size."""
    return (function(x + size * change) - function(x - size * change)) / (2 * size)


def slope(function, x, change):
    """The forward derivative along a change."""
    return jax.jvp(function, (x,), (change,))[1]


@pytest.mark.parametrize("length", LENGTHS)
def test_derivatives_through_32_steps_are_what_a_change_of_the_thrust_does(length):
    env, state = start(length)
    run = functools.partial(swim, env, state)
    size = 0.03 if length == 2 else 0.1  # N
    both = jax.jit(lambda x, change: (slope(run, x, change), difference(run, x, change, size)))
    given = [both(*random_actions(seed, 32, length)) for seed in range(6)]
    ours, theirs = np.array(given).swapaxes(0, 1)
    error = np.sqrt(((ours - theirs) ** 2).mean(0) / (theirs**2).mean(0))
    assert (error < 0.05).all(), error


@pytest.mark.parametrize(("length", "steps"), [(64, 1), (7, 32)])
def test_the_backward_derivative_is_the_forward_one(length, steps):
    env, state = start(length)
    run = functools.partial(swim, env, state)
    actions, change = random_actions(0, steps, length)
    forward = jax.jit(functools.partial(slope, run))(actions, change)
    backward = jax.jit(jax.grad(lambda x: run(x) @ jnp.ones(3)))(actions)
    assert float((backward * change).sum()) == pytest.approx(float(forward.sum()), rel=2e-3)


@in_double_precision
def exact_errors(contact):
    """Largest relative errors of exact one-step derivatives, and which chains touched."""
    rng = np.random.default_rng(0)
    chains, push, change = (
        lively(rng, 5, bend=2.6, batch=24),
        thrusts(rng, 24, 5),
        thrusts(rng, 24, 5),
    )
    move = functools.partial(step, physics=Physics(joint_derivative="exact"), contact=contact)

    def place(chain, thrust):
        units = move(chain, thrust).units
        return jnp.concatenate([units.position.ravel(), units.angle])

    def both(chain, thrust, change):
        along = functools.partial(place, chain)
        backward = jax.grad(lambda t: along(t).sum())(thrust) @ change
        return slope(along, thrust, change), difference(along, thrust, change, 1e-6), backward

    ours, finite, backward = jax.jit(jax.vmap(both))(chains, push, change)
    np.testing.assert_allclose(backward, ours.sum(1), rtol=1e-9)
    error = np.abs(ours - finite).max(1) / np.abs(finite).max(1)
    return error, np.asarray(jax.jit(jax.vmap(move))(chains, push).touching)


@pytest.mark.slow
@pytest.mark.parametrize("contact", [False, True])
def test_exact_derivatives_of_a_step_are_its_finite_differences_where_units_touch_too(contact):
    error, touching = exact_errors(contact)
    assert error.max() < 1e-4
    assert touching.sum() > 4 if contact else not touching.any()


@pytest.mark.parametrize("length", LENGTHS)
def test_exact_derivatives_of_the_reward_of_a_step_are_its_finite_differences(length):
    with jax.enable_x64(True):
        env = SCLD(TaskConfig(length=length, contact=False), Physics(joint_derivative="exact"))
        run = functools.partial(swim, env, jax.jit(env.reset)(jr.key(0)))
        actions, change = random_actions(0, 1, length)
        ours = jax.jit(functools.partial(slope, run))(actions, change)
        theirs = jax.jit(functools.partial(difference, run))(actions, change, 1e-6)
        np.testing.assert_allclose(ours, theirs, rtol=2e-3)


@pytest.mark.parametrize("observation", ["table1", "proximity"])
def test_no_derivative_is_nan_at_rest_with_dead_slots(observation):
    env = SCLD(TaskConfig(length=6, contact=True, fine_weight=0.5, observation=observation))
    state = jax.jit(env.reset)(jr.key(0), 4)

    def total(action, place, target, physics):
        where = lambda s: (s.chain.units.position, s.target)  # noqa: E731
        after = SCLD(env.config, physics).step(eqx.tree_at(where, state, (place, target)), action)
        return after.reward + after.obs.sum() + after.chain.links.velocity.sum()

    physics = jax.tree.map(jnp.float32, env.physics)
    given = (jnp.zeros((6, 1)), state.chain.units.position, state.target, physics)
    slopes = jax.jit(jax.grad(total, (0, 1, 2, 3)))(*given)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(slopes))
    assert float(jnp.abs(slopes[0]).max()) > 0 and (np.asarray(slopes[0])[4:] == 0).all()


@in_double_precision
def test_observations_change_as_their_derivatives_say():
    rng = np.random.default_rng(1)
    chain, change = lively(rng, 5), jnp.asarray(rng.normal(size=(5, 2)))
    for observation in OBSERVATIONS:
        env = SCLD(TaskConfig(length=5, observation=observation))

        def seen(place, env=env):
            moved = eqx.tree_at(lambda c: c.units.position, chain, place)
            return env.observe(moved, jnp.ones((5, 2)), jnp.ones((5, 2)))

        place = chain.units.position
        theirs = difference(seen, place, change, 1e-6)
        np.testing.assert_allclose(slope(seen, place, change), theirs, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["paper-gt-8", "approach"])
def test_controllers_in_the_loop_have_derivatives_of_both_modes(name):
    controller = load(name)
    env = SCLD(controller.card.task(8, contact=False))
    state = jax.jit(env.reset)(jr.key(0))

    def left(target):
        aimed = env.start(state.chain, target, jr.key(0))
        act = lambda now, _: (env.step(now, controller.act(now)), None)  # noqa: E731
        return jax.lax.scan(act, aimed, None, length=2)[0].distances.mean

    change = jr.normal(jr.key(2), state.target.shape)
    both = jax.jit(lambda x: (slope(left, x, change), (jax.grad(left)(x) * change).sum()))
    forward, backward = both(state.target)
    assert float(backward) == pytest.approx(float(forward), rel=1e-2)


def test_a_batch_has_the_derivatives_of_each_chain():
    env, state = start(7)
    actions = jr.uniform(jr.key(3), (4, 7, 1), minval=-1, maxval=1)
    one = jax.jit(jax.grad(lambda action: env.step(state, action).reward))
    both = jax.jit(jax.vmap(one))(actions)
    np.testing.assert_allclose(both, np.stack([one(a) for a in actions]), rtol=1e-3, atol=1e-7)


def test_a_sum_over_a_batch_with_contact_has_a_backward_derivative():
    env, _ = start(3, contact=True)
    states = jax.vmap(env.reset)(jr.split(jr.key(4), 3))

    def total(actions):
        return jax.vmap(env.step)(states, actions).reward.sum()

    traced = jax.eval_shape(jax.grad(total), jnp.zeros((3, 3, 1)))
    assert traced.shape == (3, 3, 1)
