"""Planning on the engine: better than its first guess, better than greedy, with a memory."""

import dataclasses

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.controllers.mpc import MPC
from salpchain.controllers.policy import Planner, act, begin
from salpchain.controllers.storage import load
from salpchain.evaluation.trials import run_trials
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

SMALL = MPC(samples=32, elites=4, rounds=2, knots=6, every=5)
ENV = SCLD(TaskConfig(length=3))


@pytest.fixture(scope="module")
def state():
    return jax.jit(ENV.reset)(jr.key(3))


def test_a_refined_plan_is_never_worse_than_the_one_it_came_from(state):
    best = MPC(samples=16, elites=1, knots=3, every=4)
    plans = 0.3 * jr.normal(jr.key(0), (8, best.horizon, 3))
    keys = jr.split(jr.key(1), 8)
    refine = jax.jit(jax.vmap(lambda plan, key: best._refine(state, plan, 0.5, key)))
    cost = jax.jit(jax.vmap(lambda plan: best._cost(state, plan)))
    before, after = np.asarray(cost(plans)), np.asarray(cost(refine(plans, keys)))
    assert (after <= before).all() and (after < before).any()


def test_thrusts_between_knots_lie_on_straight_lines():
    knots = jnp.array([[0.0, 1.0], [0.5, -1.0], [1.0, 0.0]])
    thrusts = MPC(knots=3, every=4)._between(knots)
    expected = np.stack([np.interp(np.arange(8), [0, 4, 8], knot) for knot in knots.T], axis=1)
    np.testing.assert_allclose(thrusts, expected, atol=1e-6)


def test_a_guide_is_followed_where_no_better_plan_is_found(state):
    still = MPC(guide=Greedy(), samples=1, elites=1, rounds=1, knots=3, every=5)  # tries no other
    thrust, plan = jax.jit(lambda s: still.plan(s, still.begin(s)))(state)
    np.testing.assert_allclose(thrust, Greedy().act(state), atol=1e-6)
    after = jax.jit(ENV.step)(state, thrust)
    np.testing.assert_allclose(plan.thrusts[0], Greedy().act(after)[:, 0], atol=1e-5)


@pytest.mark.slow
def test_a_released_policy_can_guide_and_its_plan_is_never_worse_than_what_it_would_do():
    guide = load("any-length")
    planner = MPC.guided(guide)
    task = guide.card.task(length=3)
    assert planner.card.task(length=3) == task
    state = jax.jit(SCLD(task).reset)(jr.key(4))
    small = dataclasses.replace(planner, samples=16, rounds=1, knots=4, every=5)
    cost = jax.jit(lambda s: small._cost(s, small._guided(guide, s)))
    best = jax.jit(lambda s: small.plan(s, small.begin(s)))
    thrust, plan = best(state)
    assert thrust.shape == (3, 1)
    # without its first step and with its last twice: what `plan` hands on
    planned = jnp.concatenate([thrust.T, plan.thrusts[:-1]])
    assert float(small._cost(state, planned)) <= float(cost(state)) + 1e-4


@pytest.mark.slow
def test_a_plan_is_kept_from_step_to_step_and_greedy_remembers_nothing(state):
    assert isinstance(SMALL, Planner) and not isinstance(Greedy(), Planner)
    assert begin(Greedy(), state) == ()
    first, memory = jax.jit(lambda s: act(SMALL, s, begin(SMALL, s)))(state)
    np.testing.assert_allclose(first, jax.jit(SMALL.act)(state), atol=1e-5)
    assert float(jnp.abs(memory.thrusts).max()) > 0.1  # what it goes on from
    again, _ = jax.jit(SMALL.plan)(state, memory)
    assert float(jnp.abs(again - first).max()) > 1e-3


@pytest.mark.slow
def test_planning_reaches_more_targets_than_greedy_and_sooner_from_the_same_starts():
    (ours,), (theirs,) = (run_trials([c], 3, 6, "fixed", 5) for c in (SMALL, Greedy()))
    assert ours.success.mean() > theirs.success.mean()
    assert ours.steps.median() < 0.5 * theirs.steps.median()


@pytest.mark.parametrize("action", ["thrust", "pair"])
def test_a_planner_speaks_either_action(state, action):
    planner = MPC(samples=4, elites=1, rounds=1, knots=2, every=2, action=action)
    env = SCLD(TaskConfig(length=3, action=action))
    thrust = env.thrust(state.chain, jax.jit(planner.act)(state))
    plain = MPC(samples=4, elites=1, rounds=1, knots=2, every=2)
    spoken = ENV.thrust(state.chain, jax.jit(plain.act)(state))
    np.testing.assert_allclose(thrust, spoken, atol=1e-6)
