"""That PPO of Brax trains on it and improves, `test_docs` shows with the page's program."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.interop.brax import SalpBraxEnv, wrap
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

TASK = {"length": 2, "contact": False, "fine_weight": 0.5}


def test_a_step_gives_what_ours_gives():
    env, ours = SalpBraxEnv(**TASK, action="pair"), SCLD(TaskConfig(**TASK, action="pair"))

    @jax.jit
    def both(rng, action):
        plain = ours.reset(jax.random.wrap_key_data(rng))
        late = eqx.tree_at(lambda plain: plain.time, plain, jnp.int32(511))
        state = replace(env.reset(rng), pipeline_state=late)
        return env.step(state, action), ours.step(late, action.reshape(2, 2))

    state, plain = both(jax.random.PRNGKey(4), jnp.array([1.0, -1.0, 0.5, 0.2]))
    assert state.obs.shape == (env.observation_size,) and env.action_size == 4
    np.testing.assert_allclose(state.obs, plain.obs.ravel(), atol=1e-6)
    np.testing.assert_allclose(state.reward, plain.reward, atol=1e-6)
    np.testing.assert_allclose(state.metrics["distance"], plain.distances.mean, atol=1e-6)
    assert plain.truncated and not state.done  # time limits are Brax's


def test_a_wrapped_batch_truncates_at_the_time_limit_and_begins_elsewhere():
    env = wrap(SalpBraxEnv(**TASK), episode_length=3)
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), 4))
    starts, step = [state.pipeline_state.target], jax.jit(env.step)
    for turn in range(1, 7):
        state = step(state, jnp.zeros((4, 2)))
        assert bool(state.done.all()) == (turn % 3 == 0) == bool(state.info["truncation"].all())
        if turn % 3 == 0:
            starts.append(state.pipeline_state.target)
            np.testing.assert_array_equal(state.pipeline_state.time, 0)
    first, second, third = (np.asarray(target) for target in starts)
    assert not np.array_equal(first, second) and not np.array_equal(second, third)


def test_the_last_observation_of_an_episode_is_in_info():
    env, plain = wrap(SalpBraxEnv(**TASK), episode_length=3), SCLD(TaskConfig(**TASK))
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), 4))
    np.testing.assert_array_equal(state.info["final_obs"], state.obs)
    advance, step = jax.jit(jax.vmap(plain.step)), jax.jit(env.step)
    for turn in range(1, 5):
        expected = advance(state.pipeline_state, jnp.full((4, 2, 1), 0.5)).obs.reshape(4, -1)
        state = step(state, jnp.full((4, 2), 0.5))
        np.testing.assert_allclose(state.info["final_obs"], expected, atol=1e-5)
        assert np.array_equal(state.info["final_obs"], state.obs) == (turn != 3)


def test_random_keys_of_either_kind_start_a_wrapped_batch():
    env = wrap(SalpBraxEnv(**TASK), episode_length=3)
    old = env.reset(jax.random.split(jax.random.PRNGKey(0), 2))
    new = env.reset(jax.random.split(jax.random.key(0), 2))
    np.testing.assert_array_equal(old.obs, new.obs)
    assert new.info["steps"].shape == (2,)
    with pytest.raises(InputError, match="randomization_fn"):
        wrap(SalpBraxEnv(**TASK), episode_length=3, randomization_fn=lambda system: system)


def test_an_action_of_another_size_is_refused_and_not_broadcast():
    env = SalpBraxEnv(**TASK)
    with pytest.raises(InputError, match=r"action must have shape \(2,\), got \(1,\)"):
        env.step(env.reset(jax.random.key(0)), jnp.ones(1))


def test_a_wrong_setting_is_named():
    with pytest.raises(InputError, match="length must be"):
        SalpBraxEnv(length=1)
