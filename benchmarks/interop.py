"""What the bridges cost, beside the bare compiled step; the record goes to results/.

python -m benchmarks.interop [--name NAME] [--overwrite] [--policy RUN]

The vector environment of Gymnasium and the bare compiled step (the whole environment with
auto-reset, called from Python with NumPy actions, its observations and rewards waited for) take
turns, as other work may slow the machine. The VMAS scenario steps in VMAS itself. ONNX sessions run
on one core, one chain at a time.
"""

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.random as jr
import numpy as np

from benchmarks.run import add_options, begun
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import load
from salpchain.files import write_json
from salpchain.interop.batch import programs
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import FIXED_LIMIT, TaskConfig
from salpchain.tasks.reach.task import SCLD

ENVS, UNITS = 1024, 8
STEPS, TURNS = 40, 9  # in a turn; turns
PACKAGES = ("gymnasium", "pettingzoo", "stable-baselines3", "brax", "onnx", "onnxruntime")
PACKAGES += ("vmas", "benchmarl", "torchrl", "tensordict", "torch")


def gymnasium_share() -> dict[str, Any]:
    """Throughput of the vector environment, of the bare step, and their ratio."""
    import gymnasium

    import salpchain.interop.gymnasium  # noqa: F401

    task = {"num_envs": ENVS, "length": UNITS}
    env = gymnasium.make_vec("salpchain/SCLD-v0", autoreset_mode="SameStep", **task)
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (ENVS, UNITS, 1)).astype(np.float32)
    bare = _bare(actions)
    pairs = [(_rate(lambda: env.step(actions)), _rate(bare)) for _ in range(TURNS + 1)][1:]
    ours, theirs = (statistics.median(rates) for rates in zip(*pairs, strict=True))
    return {
        "envs": ENVS,
        "length": UNITS,
        "vector_env_steps_per_second": ours,
        "bare_steps_per_second": theirs,
        "share": statistics.median(one / other for one, other in pairs),
    }


def _bare(actions: np.ndarray) -> Callable[[], None]:
    parts = programs(SCLD(TaskConfig(length=UNITS)), FIXED_LIMIT)
    states = parts.reset(jr.split(jr.key(0), ENVS))

    def step() -> None:
        nonlocal states
        states, outcome = parts.step(states, actions)
        jax.block_until_ready(outcome)

    return step


def _rate(step: Callable[[], Any]) -> float:
    """Chain-steps per second."""
    begun = time.perf_counter()
    for _ in range(STEPS):
        step()
    return ENVS * STEPS / (time.perf_counter() - begun)


def onnx_speed(policy: Policy, units: int = 64) -> dict[str, Any]:
    """Size of the file, and milliseconds for one observation on one core."""
    import onnxruntime

    from salpchain.interop.onnx import export_onnx

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        export_onnx(policy, path)
        size = path.stat().st_size
        session = onnxruntime.InferenceSession(path, options)
    features = session.get_inputs()[0].shape[2]
    obs = np.random.default_rng(0).normal(size=(1, units, features)).astype(np.float32)
    times = []
    for _ in range(300):
        begun = time.perf_counter()
        session.run(["thrust"], {"observation": obs})
        times.append(time.perf_counter() - begun)
    name, milliseconds = policy.card.name, 1e3 * statistics.median(times)
    return {"policy": name, "length": units, "megabytes": size / 1e6, "milliseconds": milliseconds}


def vmas_speed(envs: int = 256, steps: int = 100) -> dict[str, Any]:
    """Environment steps per second of the VMAS scenario under random actions.

    The original study's scenario ran about 110 at 256 environments of 8 units on 2 cores.
    """
    import torch

    from salpchain.interop.vmas import make_env

    env = make_env(num_envs=envs, length=UNITS, seed=0)
    env.reset()
    actions = [2 * torch.rand(envs, env.get_agent_action_size(unit)) - 1 for unit in env.agents]
    env.step(actions)
    begun = time.perf_counter()
    for _ in range(steps):
        env.step(actions)
    rate = envs * steps / (time.perf_counter() - begun)
    return {"envs": envs, "length": UNITS, "steps_per_second": rate, "against_original": rate / 110}


def fresh(model: str, graph: str) -> Policy:
    """A policy with fresh weights: as large and as fast as a trained one."""
    card = PolicyCard(name=f"{model}-{graph}", control=ControlConfig(model=model, graph=graph))
    return Policy(actor_critic(jr.key(0), card.control, 22, 1, card.length), card)


def main() -> None:
    """Measures, prints and adds to the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--policy", default="", help="a run folder or policy file to export too")
    options = parser.parse_args()
    path, record = begun("interop", options, policy=options.policy)
    record["packages"] = {name: version(name) for name in PACKAGES}
    record["gymnasium"] = gymnasium_share()
    record["vmas"] = vmas_speed()
    policies = [fresh(m, g) for m in ("gcn", "gatv2", "gt") for g in ("mixed", "full")]
    policies += [load(options.policy)] if options.policy else []
    record["onnx"] = [onnx_speed(policy) for policy in policies]
    print(json.dumps(record, indent=2))
    write_json(path, record)


if __name__ == "__main__":
    main()
