"""Tensors without copies, and our environment in the real TorchRL."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import check_env_specs

from salpchain.errors import InputError
from salpchain.interop.gymnasium import SalpVectorEnv
from salpchain.interop.torch import as_tensors, to_jax, to_torch
from salpchain.interop.torchrl import SalpTorchEnv
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

torch.set_num_threads(1)

LENGTH, ENVS = 3, 4


def seeded(seed=0):
    env = SalpTorchEnv(num_envs=ENVS, length=LENGTH, action="pair")
    env.set_seed(seed)
    return env


def test_tensors_share_the_memory_of_arrays_and_arrays_that_of_tensors():
    array = jnp.arange(64.0).reshape(8, 8) + 1
    tensor = to_torch(array)
    assert tensor.data_ptr() == array.unsafe_buffer_pointer()
    again = to_jax(tensor)
    assert again.unsafe_buffer_pointer() == tensor.data_ptr()
    np.testing.assert_array_equal(again, array)
    np.testing.assert_array_equal(to_jax(torch.ones(3, requires_grad=True)), np.ones(3))


def test_a_state_becomes_tensors_by_the_names_of_its_fields():
    state = jax.jit(SCLD(TaskConfig(length=LENGTH)).reset)(jax.random.key(0))
    tensors = as_tensors(state)
    np.testing.assert_array_equal(tensors["chain.units.position"], state.chain.units.position)
    assert tensors["terminated"].dtype == torch.bool and "key" not in tensors
    assert len(tensors) == len(jax.tree.leaves(state)) - 1


def test_it_passes_torchrl_s_checker():
    check_env_specs(seeded())


def test_it_steps_as_the_gymnasium_batch_does():
    env, other = seeded(5), SalpVectorEnv(ENVS, length=LENGTH, action="pair")
    record, (obs, _) = env.reset(), other.reset(seed=5)
    rng = np.random.default_rng(0)
    for _ in range(5):
        np.testing.assert_array_equal(record["observation"], obs)
        action = rng.uniform(-1, 1, (ENVS, LENGTH, 2)).astype(np.float32)
        stepped, record = env.step_and_maybe_reset(record.set("action", torch.tensor(action)))
        obs, reward, *_ = other.step(action)
        np.testing.assert_array_equal(stepped["next", "reward"][:, 0], reward)


def test_an_episode_over_is_renewed_and_the_rollout_goes_on():
    steps = seeded().rollout(520, break_when_any_done=False)
    done = steps["next", "done"][..., 0]
    np.testing.assert_array_equal(done.sum(dim=1), np.ones(ENVS))
    assert steps["next", "truncated"].sum() == ENVS
    np.testing.assert_array_equal(steps["closed_fraction"][:, 512, 0], np.zeros(ENVS))


def test_a_partial_reset_leaves_the_others_as_they_are():
    env = seeded()
    record = env.reset()
    before = record["observation"].clone()
    which = torch.tensor([[False], [True], [False], [False]])
    after = env.reset(record.clone().set("_reset", which))["observation"]
    changed = (before != after).flatten(1).any(dim=1)
    np.testing.assert_array_equal(changed, which[:, 0])


def test_a_seed_is_for_the_next_reset_of_all_and_a_partial_one_touches_no_other():
    env = seeded()
    with pytest.raises(InputError, match="never reset"):
        env.reset(TensorDict({"_reset": torch.arange(ENVS)[:, None] == 1}, [ENVS]))
    first = env.reset()["observation"].clone()
    env.step(env.rand_action())
    before = to_torch(env._batch.states.obs).clone()
    env.set_seed(0)
    which = torch.tensor([[False], [True], [False], [False]])
    env.reset(TensorDict({"_reset": which}, [ENVS]))
    after = to_torch(env._batch.states.obs)
    assert not np.array_equal(after[1], before[1])
    np.testing.assert_array_equal(after[[0, 2, 3]], before[[0, 2, 3]])
    np.testing.assert_array_equal(env.reset()["observation"], first)
    with pytest.raises(InputError, match="unknown option 'seed' of reset"):
        env.reset(seed=3)


def test_a_nan_is_named_with_its_environment_and_moves_nothing():
    env = seeded()
    record = env.reset()
    before = np.array(env._batch.states.chain.units.position)
    action = torch.zeros(ENVS, LENGTH, 2)
    action[3, 0, 1] = torch.nan
    with pytest.raises(InputError, match=r"environment 3, unit 0, holds nan"):
        env.step(record.set("action", action))
    np.testing.assert_array_equal(env._batch.states.chain.units.position, before)
