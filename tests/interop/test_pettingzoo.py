import equinox as eqx
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from salpchain.errors import InputError
from salpchain.interop.pettingzoo import SalpParallelEnv

TASK = {"length": 2, "contact": False}


def test_pettingzoos_own_tests_pass():
    parallel_api_test(SalpParallelEnv(**TASK), num_cycles=30)
    parallel_seed_test(lambda: SalpParallelEnv(**TASK), num_cycles=10)


def test_every_unit_gets_its_own_observation_and_the_chains_reward():
    env = SalpParallelEnv(observation="table1", **TASK)
    obs, _ = env.reset(seed=1)
    assert obs["unit_1"][0] == 1 and obs["unit_0"][0] == 0  # the lowest bit of its number
    np.testing.assert_array_equal(np.stack(list(obs.values())), env.state())
    obs, reward, *_ = env.step({agent: np.ones(1, np.float32) for agent in env.agents})
    assert reward["unit_0"] == reward["unit_1"] != 0
    np.testing.assert_array_equal(np.stack(list(obs.values())), env.state())


def test_all_units_end_together_and_nothing_is_stepped_after():
    env = SalpParallelEnv(**TASK)
    env.reset(seed=0)
    batch = env._batch
    batch.states = eqx.tree_at(lambda s: s.time, batch.states, np.array([511], np.int32))
    actions = {agent: np.zeros(1, np.float32) for agent in env.agents}
    *_, terminated, truncated, _ = env.step(actions)
    assert truncated == {"unit_0": True, "unit_1": True} and not any(terminated.values())
    assert env.agents == []
    with pytest.raises(InputError, match=r"call reset\(\)"):
        env.step(actions)


def test_bad_input_is_named_with_the_unit():
    env = SalpParallelEnv(**TASK)
    with pytest.raises(InputError, match=r"call reset\(\)"):
        env.step({})
    env.reset(seed=0)
    good = np.zeros(1, np.float32)
    for bad, word in (
        ({"unit_0": good}, "unit_1 is missing"),
        ({"unit_0": good, "unit_1": good, "unit_9": good}, "unknown unit 'unit_9'"),
        ({"unit_0": good, "unit_1": np.zeros(2)}, r"unit_1 must have shape \(1,\), got \(2,\)"),
        ({"unit_0": good, "unit_1": good * np.nan}, r"unit 1 holds nan"),
    ):
        with pytest.raises(InputError, match=word):
            env.step(bad)
    with pytest.raises(InputError, match="render mode"):
        SalpParallelEnv(render_mode="ascii")
