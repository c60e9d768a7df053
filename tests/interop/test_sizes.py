"""Batches and chains of the smallest and largest size, in every bridge and export."""

import jax
import numpy as np
import onnxruntime
import pytest
import torch

from salpchain.errors import InputError
from salpchain.interop.benchmarl import benchmarl_task
from salpchain.interop.brax import SalpBraxEnv, wrap
from salpchain.interop.export import export
from salpchain.interop.gymnasium import SalpVectorEnv
from salpchain.interop.network import load_torch
from salpchain.interop.pettingzoo import SalpParallelEnv
from salpchain.interop.stable_baselines3 import SalpVecEnv
from salpchain.interop.steer import steering
from salpchain.interop.torchrl import SalpTorchEnv
from salpchain.interop.vmas import make_env, make_torchrl_env
from tests.interop.policies import fresh

torch.set_num_threads(1)


def gymnasium(envs, **task):
    env = SalpVectorEnv(envs, **task)
    env.reset(seed=0)
    return env.step(np.ones(env.action_space.shape, np.float32))[0]


def stable_baselines3(envs, **task):
    env = SalpVecEnv(envs, **task)
    env.reset()
    return env.step(np.ones((envs, task["length"], 1), np.float32))[0]


def pettingzoo(envs, **task):
    """Of one chain only."""
    env = SalpParallelEnv(**task)
    env.reset(seed=0)
    obs, *_ = env.step({agent: np.ones(1, np.float32) for agent in env.agents})
    return np.stack([np.stack(list(obs.values()))] * envs)


def brax(envs, **task):
    env = wrap(SalpBraxEnv(**task), episode_length=9)
    state = jax.jit(env.reset)(jax.random.split(jax.random.key(0), envs))
    state = jax.jit(env.step)(state, np.ones((envs, env.action_size), np.float32))
    return np.reshape(state.obs, (envs, task["length"], -1))


def torchrl(envs, **task):
    return SalpTorchEnv(envs, **task).rollout(1)["next", "observation"][:, 0].numpy()


def vmas(envs, **task):
    env = make_env(num_envs=envs, **task)
    env.reset()
    obs, *_ = env.step([torch.ones(envs, 1)] * task["length"])
    return torch.stack(obs, 1).numpy()


def vmas_in_torchrl(envs, **task):
    steps = make_torchrl_env(envs, **task).rollout(1)
    return steps["next", "unit", "observation"][:, 0].numpy()


def benchmarl(envs, **task):
    env = benchmarl_task(**task).get_env_fun(envs, True, 0, "cpu")()
    return env.rollout(1)["next", "unit", "observation"][:, 0].numpy()


JAX = [gymnasium, stable_baselines3, torchrl, brax]
ALL = [*JAX, vmas, vmas_in_torchrl, benchmarl]
TASK = {"length": 2, "contact": False}


@pytest.mark.parametrize("envs", [1, 2])
@pytest.mark.parametrize("bridge", ALL)
def test_a_bridge_steps_one_chain_and_two(bridge, envs):
    obs = bridge(envs, **TASK)
    assert obs.shape == (envs, 2, 22) and np.isfinite(obs).all()


@pytest.mark.parametrize("bridge", ALL)
def test_a_batch_of_none_is_refused(bridge):
    with pytest.raises(InputError, match=r"num_envs must be 1 to|at least one chain"):
        bridge(0, **TASK)


@pytest.mark.parametrize("bridge", [gymnasium, brax])
def test_a_bridge_steps_the_longest_chain(bridge):
    obs = bridge(1, length=1024, contact=False)
    assert obs.shape == (1, 1024, 22) and np.isfinite(obs).all()


@pytest.mark.parametrize("bridge", [*ALL, pettingzoo])
@pytest.mark.parametrize("length", [1, 1025])
def test_a_chain_that_is_too_short_or_too_long_is_refused(bridge, length):
    with pytest.raises(InputError, match="length must be 2 to 1024 units"):
        bridge(1, length=length)


@pytest.mark.parametrize("model", ["gcn", "gatv2", "gt"])
def test_exports_and_steering_take_any_batch_and_agree(model, tmp_path):
    policy = fresh(model)
    export(policy, tmp_path / "policy.onnx", "onnx")
    export(policy, tmp_path / "policy.safetensors", "torch")
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    module = load_torch(tmp_path / "policy.safetensors")
    for envs, length in ((0, 2), (1, 2), (2, 2), (0, 512), (1, 512)):
        obs = np.random.default_rng(0).normal(size=(envs, length, 22)).astype(np.float32)
        expected = steering(policy, length=length)(obs)
        assert expected.shape == (envs, length, 1)
        (action,) = session.run(["action"], {"observation": obs})
        for other in (action, module(torch.from_numpy(obs)).numpy()):
            np.testing.assert_allclose(other, expected, atol=1e-4)
