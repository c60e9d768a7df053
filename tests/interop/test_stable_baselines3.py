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
    assert env.env_method("get_attr", "note") == [["hello"] * ENVS] * ENVS
    assert env.env_is_wrapped(object) == [False] * ENVS


def test_a_reset_of_some_chains_leaves_the_others_as_they_were():
    env = SalpVecEnv(ENVS, **TASK)
    with pytest.raises(InputError, match="never reset"):
        env.env_method("reset", indices=[1])
    before = env.reset()
    env.step(np.full((ENVS, 2, 1), 0.5, np.float32))
    went_on = np.array(env._batch.states.obs)
    (first, info), (last, _) = env.env_method("reset", indices=[1, -1], seed=7)
    now = np.array(env._batch.states.obs)
    np.testing.assert_array_equal(now[[0, 2]], went_on[[0, 2]])
    np.testing.assert_array_equal(now[[1, 3]], [first, last])
    assert env._batch.states.time.tolist() == [1, 0, 1, 0] and info == {}
    env.seed(7)
    np.testing.assert_allclose(env.reset()[[1, 3]], [first, last], atol=1e-5)
    assert not np.array_equal(before, now)


def test_what_all_chains_share_is_not_done_for_some_alone():
    env = SalpVecEnv(ENVS, **TASK)
    with pytest.raises(InputError, match=r"cannot set the attribute note for chains \[1\] alone"):
        env.set_attr("note", "hello", indices=[1])
    assert not hasattr(env, "note")
    env.set_attr("note", "hello", indices=range(ENVS))
    with pytest.raises(InputError, match=r"cannot call seed for chains \[0, 2\] alone"):
        env.env_method("seed", 3, indices=[0, 2])
    for ask in (env.get_attr, env.env_is_wrapped):
        with pytest.raises(InputError, match="no chain 4: there are 0 to 3"):
            ask("note", indices=[0, 4])
    with pytest.raises(InputError, match="unknown option 'start' of reset"):
        env.set_options({"start": 1})


def test_pictures_are_given_in_their_mode_alone():
    env = SalpVecEnv(ENVS, render_mode="rgb_array", **TASK)
    env.reset()
    pictures = env.get_images()
    np.testing.assert_array_equal(env.env_method("render", indices=2), pictures[2:3])
    assert len(pictures) == ENVS and pictures[0].shape == (480, 480, 3)
    assert SalpVecEnv(ENVS, **TASK).get_images() == [None] * ENVS
    with pytest.raises(InputError, match="unknown render mode 'human'"):
        SalpVecEnv(ENVS, render_mode="human", **TASK)
