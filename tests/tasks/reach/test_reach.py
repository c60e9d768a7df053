import functools
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig, step_limit
from salpchain.tasks.follow.config import FollowConfig
from salpchain.tasks.follow.task import Follow
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.renew import renew_done


class Jitted:
    """The domain with its functions compiled, for one chain and for a batch."""

    def __init__(self, **settings):
        self.env = SCLD(TaskConfig(**settings))
        self.reset, self.step = jax.jit(self.env.reset), jax.jit(self.env.step)
        self.reset_all = jax.jit(jax.vmap(self.env.reset))
        self.step_all = jax.jit(jax.vmap(self.env.step))
        self.renew = jax.jit(lambda states: renew_done(self.env, states))


@functools.cache
def env_of(length=4, contact=False, **settings):
    """Without contact, which has tests of its own and takes most of the time to compile."""
    return Jitted(length=length, contact=contact, **settings)


def still(length):
    return jnp.zeros((length, 1))


def near_goal(env, offset):
    """An episode whose target is the chain itself, shifted by `offset` metres."""
    state = env.reset(jr.key(0))
    target = state.chain.units.position + jnp.array([0.0, offset])
    return env.env.start(state.chain, target, jr.key(1))


def test_the_reward_is_the_decrease_of_the_mean_distance_and_one_at_the_goal():
    env = env_of()
    state = env.reset(jr.key(0))
    total = 0.0
    for key in jr.split(jr.key(1), 20):
        before = np.linalg.norm(state.target - state.chain.units.position, axis=-1).mean()
        state = env.step(state, jr.uniform(key, (4, 1), minval=-1, maxval=1))
        after = np.linalg.norm(state.target - state.chain.units.position, axis=-1).mean()
        assert float(state.reward) == pytest.approx(before - after, abs=2e-6)
        total += float(state.reward)
    closed = float(state.start_distance) * float(state.closed_fraction)
    assert total == pytest.approx(closed, abs=1e-5)


@pytest.mark.parametrize(("task", "config"), [(SCLD, TaskConfig), (Follow, FollowConfig)])
def test_a_control_step_costs_the_time_weight_whatever_the_task(task, config):
    rewards = []
    for weight in (0.0, 0.25):
        env = task(config(length=4, contact=False, time_weight=weight))
        state = jax.jit(env.reset)(jr.key(0))
        rewards.append(float(jax.jit(env.step)(state, still(4)).reward))
    assert rewards[1] == pytest.approx(rewards[0] - 0.25, abs=1e-6)


@pytest.mark.parametrize(("offset", "goal"), [(0.0512, True), (0.0514, False)])
def test_the_goal_is_where_exp_of_minus_the_frechet_distance_is_at_least_095(offset, goal):
    assert np.exp(-GOAL_LIMIT) == pytest.approx(0.95)
    env = env_of()
    state = env.step(near_goal(env, offset), still(4))
    assert bool(state.goal) == bool(state.terminated) == goal
    assert float(state.reward) == pytest.approx(1.0 if goal else 0.0, abs=1e-5)
    assert not bool(state.truncated)


def test_the_time_limit_truncates_and_does_not_terminate():
    env = env_of()
    state = eqx.tree_at(lambda s: s.time, env.reset(jr.key(0)), jnp.int32(510))
    state = env.step(state, still(4))
    assert not bool(state.done)
    state = env.step(state, still(4))
    assert bool(state.truncated) and not bool(state.terminated)


@pytest.mark.parametrize(("limit", "length", "steps"), [
    ("fixed", 64, 512), ("scaled", 8, 512), ("scaled", 16, 512), ("scaled", 64, 2048),
])  # fmt: skip
def test_the_scaled_limit_grows_beyond_16_units(limit, length, steps):
    assert step_limit(limit, length) == steps
    assert int(env_of(length, time_limit=limit).env.step_limit(length)) == steps


def test_the_fence_stops_the_chain_and_ends_the_episode():
    env = env_of(4, fence=True)
    state = env.reset(jr.key(0))
    for _ in range(200):
        state = env.step(state, jnp.ones((4, 1)))
        if bool(state.done):
            break
    assert bool(state.terminated) and not bool(state.goal)
    reach = np.abs(state.chain.units.position).max()
    assert reach == pytest.approx(4 * 0.25)


def test_the_papers_action_pair_is_forward_minus_backward_each_from_0_to_1():
    env = env_of(4, action="pair")
    chain = env.reset(jr.key(0)).chain
    action = jnp.array([[1.0, -1.0], [-1.0, 1.0], [3.0, 3.0], [0.5, -9.0]])
    np.testing.assert_allclose(env.env.thrust(chain, action), [1.0, -1.0, 0.0, 0.75], atol=1e-6)


@pytest.mark.slow
def test_renewing_finished_episodes_leaves_the_others_bit_identical():
    env = env_of(4)
    states = env.reset_all(jr.split(jr.key(0), 40))
    states = env.step_all(states, jr.normal(jr.key(1), (40, 4, 1)))
    done = np.zeros(40, bool)
    done[[0, 7, 8, 9, 10, 11, 12, 13, 39]] = True
    ended = eqx.tree_at(lambda s: s.truncated, states, jnp.asarray(done))
    after = env.renew(ended)
    for old, new in zip(jax.tree.leaves(ended), jax.tree.leaves(after), strict=True):
        if jnp.issubdtype(old.dtype, jax.dtypes.prng_key):
            old, new = jr.key_data(old), jr.key_data(new)
        np.testing.assert_array_equal(np.asarray(old)[~done], np.asarray(new)[~done])
    assert (np.asarray(after.time)[done] == 0).all() and not np.asarray(after.truncated).any()


def test_no_start_comes_twice():
    env = env_of(4)
    states = env.reset_all(jr.split(jr.key(0), 6))
    seen = [np.asarray(states.target[:, 0])]
    for _ in range(5):
        ended = eqx.tree_at(lambda s: s.truncated, states, jnp.ones(6, bool))
        states = env.renew(ended)
        seen.append(np.asarray(states.target[:, 0]))
    assert len(np.unique(np.concatenate(seen), axis=0)) == 36


def test_renewing_keeps_each_chains_length():
    env = env_of(8)
    lengths = jnp.array([2, 5, 8, 3])
    states = env.reset_all(jr.split(jr.key(0), 4), lengths)
    ended = eqx.tree_at(lambda s: s.truncated, states, jnp.ones(4, bool))
    np.testing.assert_array_equal(env.renew(ended).length, lengths)


@pytest.mark.parametrize("length", [2, 1024])
def test_the_shortest_and_the_longest_chain_swim(length):
    env = env_of(length, contact=True, observation="table1", action="pair")
    state = env.reset(jr.key(0))
    state = env.step(state, jr.normal(jr.key(1), (length, 2)))
    assert all(np.isfinite(x).all() for x in (state.obs, state.reward, state.chain.units.position))


@pytest.mark.parametrize("settings", [
    {"length": 1}, {"length": 1025}, {"observation": "sonar"},
    {"action": "push"}, {"time_limit": "never"}, {"fine_weight": -1.0},
    {"fine_weight": float("inf")}, {"fine_weight": float("nan")}, {"tolerance": 0.0},
    {"most_steps": -1}, {"most_steps": True}, {"time_weight": -0.1}, {"time_weight": float("nan")},
])  # fmt: skip
def test_a_task_that_cannot_be_is_refused_with_one_line(settings):
    with pytest.raises(InputError) as error:
        TaskConfig(**settings)
    assert "\n" not in str(error.value)


def test_settings_of_a_wrong_type_are_refused_with_one_line():
    """In a process of its own: here, the types of all arguments are checked by beartype."""
    program = """
from salpchain import InputError, TaskConfig
for wrong in ({"fence": "no"}, {"contact": None}, {"fence": 3}, {"length": "8"},
              {"fine_weight": "a"}, {"fine_weight": None}, {"tolerance": "x"}):
    try:
        TaskConfig(**wrong)
    except InputError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    said = done.stdout.splitlines()
    assert len(said) == 7 and said[0] == "fence must be True or False, got 'no'"


@pytest.mark.slow
def test_mixed_lengths_in_one_batch_are_what_each_is_alone():
    slotted, keys = env_of(6), jr.split(jr.key(2), 2)
    lengths = [3, 6]
    together = slotted.reset_all(keys, jnp.array(lengths))
    push = jr.uniform(jr.key(3), (10, 6, 1), minval=-1, maxval=1)
    alone = [env_of(n).reset(k) for n, k in zip(lengths, keys, strict=True)]
    for thrust in push:
        together = slotted.step_all(together, jnp.stack([thrust, thrust]))
        alone = [env_of(n).step(s, thrust[:n]) for n, s in zip(lengths, alone, strict=True)]
    for row, (n, state) in enumerate(zip(lengths, alone, strict=True)):
        np.testing.assert_allclose(
            together.chain.units.position[row, :n], state.chain.units.position, atol=5e-4
        )
        assert float(together.distances.mean[row]) == pytest.approx(
            float(state.distances.mean), abs=5e-4
        )


@pytest.mark.slow
@pytest.mark.parametrize(("anywhere", "on_target"), [(0.0, 0.0), (0.3, 0.0), (0.2, 0.4)])
def test_a_share_of_the_episodes_starts_folded_and_a_share_stalled(anywhere, on_target):
    env = env_of(length=8, folded=anywhere, stalled=on_target)
    states = env.reset_all(jr.split(jr.key(0), 1000))
    bent = np.ptp(np.asarray(states.chain.links.angle), axis=1) > 1e-3
    apart = np.asarray(states.chain.units.position - states.target)
    there = np.linalg.norm(apart, axis=-1).min(axis=1) < 1e-3
    assert abs(bent.mean() - anywhere - on_target) < 0.05
    assert abs((bent & there).mean() - on_target) < 0.05
    straight = env_of(length=8).reset_all(jr.split(jr.key(0), 1000))
    np.testing.assert_array_equal(states.target, straight.target)


@pytest.mark.parametrize(
    ("shares", "word"),
    [
        ({"folded": -0.1}, "folded must be a share"),
        ({"stalled": 1.5}, "stalled must be a share"),
        ({"folded": 0.6, "stalled": 0.6}, "at most 1 together, got 0.6 [+] 0.6"),
    ],
)
def test_shares_of_starts_that_cannot_be_are_refused(shares, word):
    with pytest.raises(InputError, match=word):
        env_of(length=8, **shares)
