"""Functions of the bridges with arguments that are right, for the sweep of `wrong_arguments`."""

import jax
import jax.numpy as jnp
import numpy as np
import torch

from salpchain.interop import torch as tensors
from salpchain.interop.benchmarl import benchmarl_task
from salpchain.interop.brax import SalpBraxEnv, wrap
from salpchain.interop.gymnasium import SalpEnv, SalpVectorEnv
from salpchain.interop.network import load_torch
from salpchain.interop.pettingzoo import SalpParallelEnv
from salpchain.interop.stable_baselines3 import SalpVecEnv
from salpchain.interop.torchrl import SalpTorchEnv
from salpchain.interop.vmas import make_env, make_torchrl_env

TASK = {"length": 3, "observation": "proximity", "action": "thrust", "contact": False}
TASK |= {
    "tolerance": 0.1,
    "fine_weight": 0.5,
    "time_weight": 0.01,
    "time_limit": "scaled",
    "world": "current",
}
PLAIN = {"length": 3, "observation": "proximity", "contact": False}


class Untouched:
    """Programs that nobody needs to compile: what reaches them was accepted."""

    def __init__(self, work):
        self._work = work

    def __getattr__(self, name):
        return self._work


def begun(env, states, work):
    """The environment, as if its episodes had begun."""
    env._batch.states = states
    env._batch._programs = Untouched(work)
    return env


def traced(function):
    def call(**given):
        jax.eval_shape(lambda: (function(**given), None)[1])

    return call


def functions(two, one, work):
    """By name; `two` is a batch of states of three units, `one` an unbatched one; `work` replaces
    all that would be compiled."""
    single = jax.tree.map(lambda leaf: leaf[None], one)
    alone, vector = (
        begun(SalpEnv(**PLAIN), single, work),
        begun(SalpVectorEnv(2, **PLAIN), two, work),
    )
    baselines, units = (
        begun(SalpVecEnv(2, **PLAIN), two, work),
        begun(SalpParallelEnv(**PLAIN), single, work),
    )
    units.agents = list(units.possible_agents)
    rl, brax = begun(SalpTorchEnv(2, **PLAIN), two, work), SalpBraxEnv(**PLAIN)
    state = jax.tree.map(
        lambda x: jnp.ones(x.shape, x.dtype) if x.dtype != one.key.dtype else one.key,
        jax.eval_shape(brax.reset, one.key),
    )
    vmas = make_env(2, **PLAIN)
    pushes, each = np.zeros((2, 3, 1), np.float32), {f"unit_{i}": np.zeros(1) for i in range(3)}
    return {
        "SalpEnv": (SalpEnv, {"render_mode": None, **TASK}),
        "SalpEnv.reset": (alone.reset, {"seed": 0, "options": None}),
        "SalpEnv.step": (alone.step, {"action": pushes[0]}),
        "SalpVectorEnv": (
            SalpVectorEnv,
            {"num_envs": 2, "autoreset_mode": "SameStep", "max_episode_steps": 3, **TASK},
        ),
        "SalpVectorEnv.reset": (vector.reset, {"seed": 0, "options": None}),
        "SalpVectorEnv.step": (vector.step, {"actions": pushes}),
        "SalpVecEnv": (SalpVecEnv, {"num_envs": 2, "render_mode": None, **TASK}),
        "SalpVecEnv.seed": (baselines.seed, {"seed": 0}),
        "SalpVecEnv.set_options": (baselines.set_options, {"options": None}),
        "SalpVecEnv.step": (baselines.step, {"actions": pushes}),
        "SalpVecEnv.env_method": (
            baselines.env_method,
            {"method_name": "reset", "indices": [0], "seed": 0, "options": None},
        ),
        "SalpParallelEnv": (SalpParallelEnv, {"render_mode": None, **TASK}),
        "SalpParallelEnv.reset": (units.reset, {"seed": 0}),
        "SalpParallelEnv.step": (units.step, {"actions": each}),
        "SalpParallelEnv.action_space": (units.action_space, {"agent": "unit_0"}),
        "SalpParallelEnv.observation_space": (units.observation_space, {"agent": "unit_0"}),
        "SalpTorchEnv": (SalpTorchEnv, {"num_envs": 2, "device": "cpu", **TASK}),
        "SalpTorchEnv.set_seed": (rl.set_seed, {"seed": 0}),
        "SalpBraxEnv": (SalpBraxEnv, TASK),
        "SalpBraxEnv.reset": (traced(brax.reset), {"rng": one.key}),
        "SalpBraxEnv.step": (traced(brax.step), {"state": state, "action": jnp.zeros(3)}),
        "brax.wrap": (
            wrap,
            {"env": brax, "episode_length": 9, "action_repeat": 1, "randomization_fn": None},
        ),
        "make_env": (make_env, {"num_envs": 2, "device": "cpu", "seed": 0, **TASK}),
        "make_env.step": (vmas.step, {"actions": list(torch.zeros(3, 2, 1))}),
        "make_torchrl_env": (
            make_torchrl_env,
            {"num_envs": 2, "device": "cpu", "seed": 0, "max_steps": 9, **TASK},
        ),
        "benchmarl_task": (benchmarl_task, {"max_steps": 9, **TASK}),
        "load_torch": (load_torch, {"path": "p.safetensors"}),
        "to_torch": (tensors.to_torch, {"array": jnp.zeros(3)}),
        "to_jax": (tensors.to_jax, {"tensor": torch.zeros(3)}),
        "as_tensors": (tensors.as_tensors, {"tree": one}),
    }
