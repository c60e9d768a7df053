"""That its PPO trains on it and improves, `test_docs` shows with the page's program."""

import equinox as eqx
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.interop.batch import Batch
from salpchain.interop.stable_baselines3 import SalpVecEnv

ENVS = 4  # as in `test_batch`: the same compiled program
TASK = {"length": 2, "contact": False}


def test_the_end_of_an_episode_is_told_as_stable_baselines3_has_it():
    env = SalpVecEnv(ENVS, **TASK)
    env.seed(3)
    first = env.reset()
    plain = Batch(env._batch.config, ENVS)
    np.testing.assert_array_equal(first, plain.reset(3))
    time = np.array([3, 3, 511, 3], np.int32)
    env._batch.states = eqx.tree_at(lambda states: states.time, env._batch.states, time)
    actions = np.full((ENVS, 2, 1), 0.5, np.float32)
    obs, reward, done, infos = env.step(actions)
    outcome = plain.step(actions)
    np.testing.assert_array_equal(done, [False, False, True, False])
    np.testing.assert_allclose(reward, outcome.reward)
    np.testing.assert_allclose(obs[:2], outcome.obs[:2])
    assert infos[0] == {} and infos[2]["TimeLimit.truncated"] and not infos[2]["is_success"]
    np.testing.assert_allclose(infos[2]["terminal_observation"], outcome.obs[2])
    assert not np.allclose(obs[2], outcome.obs[2])
    assert not np.array_equal(env.reset(), first)


def test_attributes_and_methods_are_there_once_for_each_chain():
    env = SalpVecEnv(ENVS, **TASK)
    assert env.get_attr("num_envs", indices=[0, 2]) == [ENVS] * 2
    env.set_attr("note", "hello")
    assert env.env_method("get_attr", "note", indices=0) == [["hello"] * ENVS]
    assert env.env_is_wrapped(object) == [False] * ENVS


def test_pictures_are_given_in_their_mode_alone():
    env = SalpVecEnv(ENVS, render_mode="rgb_array", **TASK)
    env.reset()
    pictures = env.get_images()
    assert len(pictures) == ENVS and pictures[0].shape == (480, 480, 3)
    assert SalpVecEnv(ENVS, **TASK).get_images() == [None] * ENVS
    with pytest.raises(InputError, match="unknown render mode 'human'"):
        SalpVecEnv(ENVS, render_mode="human", **TASK)
