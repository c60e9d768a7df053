"""What a forked worker can ask of the package; run by `test_forks` as programs of their own.

Each prints one line of JSON for each question.
"""

import json
import multiprocessing
import subprocess
import sys
import tempfile
import warnings
from functools import partial
from pathlib import Path

PATIENCE = 30.0  # s for a worker, that a test which would wait for ever fails instead
FORK = multiprocessing.get_context("fork")
TASK = {"length": 2, "contact": False}


def answered(pipe, work):
    try:
        work()
        pipe.send("worked")
    except Exception as error:
        pipe.send(f"{type(error).__name__}: {error}")


def asked(name, work, context=FORK):
    """Prints how a worker fared with this work."""
    here, there = FORK.Pipe()
    worker = context.Process(target=answered, args=(there, work))
    worker.start()
    print(json.dumps([name, here.recv() if here.poll(PATIENCE) else "hangs"]), flush=True)
    worker.kill()


def start_jax():
    import jax

    jax.numpy.ones(3).sum().block_until_ready()


def core():
    """What the package itself is asked for, after JAX has started."""
    import jax

    import salpchain
    from salpchain.interop.steer import steering

    env, policy = salpchain.SCLD(salpchain.TaskConfig(**TASK)), salpchain.load("any-length")
    key, settings = jax.random.key(0), {**TASK, "observation": policy.card.observation}
    state, steer, folder = jax.jit(env.reset)(key), steering(policy, **settings), temporary()
    config = salpchain.TrainConfig(task=env.config)
    for name, work in {
        "load": partial(salpchain.load, "any-length"),
        "domain": lambda: salpchain.SCLD().reset(jax.random.key(0)),
        "reset": partial(env.reset, key),
        "jitted reset": partial(jax.jit(lambda key: env.reset(key)), key),
        "step": partial(env.step, state, state.thrust[:, None]),
        "act": partial(policy.act, state),
        "greedy": partial(salpchain.Greedy().act, state),
        "approach": partial(salpchain.Approach().act, state),
        "plan": partial(salpchain.MPC().begin, state),
        "steering": partial(steer, state.obs),
        "evaluate": partial(salpchain.evaluate, policy, [2], 1, "fixed", 0),
        "run_suite": partial(salpchain.run_suite, policy, "sea", [2], 1),
        "record": partial(salpchain.record, policy, [2]),
        "train": partial(salpchain.train, config, folder / "run"),
    }.items():
        asked(name, work)
    assert not list(folder.iterdir())


def temporary():
    return Path(tempfile.mkdtemp())


def bridges():
    """What the bridges are asked for."""
    import jax
    import numpy as np

    from salpchain.interop.brax import SalpBraxEnv
    from salpchain.interop.gymnasium import SalpEnv, SalpVectorEnv
    from salpchain.interop.pettingzoo import SalpParallelEnv
    from salpchain.interop.stable_baselines3 import SalpVecEnv
    from salpchain.interop.torchrl import SalpTorchEnv
    from salpchain.interop.vmas import make_env

    begun = SalpVectorEnv(2, **TASK)
    begun.reset(seed=0)
    key = jax.random.key(0)
    for name, work in {
        "Gymnasium": lambda: SalpEnv(**TASK).reset(),
        "Gymnasium, vector": lambda: SalpVectorEnv(2, **TASK).reset(),
        "Gymnasium, begun": lambda: begun.step(np.zeros((2, 2, 1), np.float32)),
        "Stable-Baselines3": lambda: SalpVecEnv(2, **TASK).reset(),
        "PettingZoo": lambda: SalpParallelEnv(**TASK).reset(),
        "TorchRL": lambda: SalpTorchEnv(2, **TASK).reset(),
        "Brax": lambda: SalpBraxEnv(**TASK).reset(key),
        "VMAS": lambda: make_env(num_envs=2, **TASK).reset(),
    }.items():
        asked(name, work)


def made():
    import gymnasium

    return gymnasium.make("salpchain.interop.gymnasium:salpchain/SCLD-v0", **TASK)


def others():
    """Other people's pools of workers, by fork."""
    import torch
    from gymnasium.vector import AsyncVectorEnv
    from stable_baselines3.common.vec_env import SubprocVecEnv

    class Observed(torch.utils.data.IterableDataset):
        def __iter__(self):
            yield made().reset()[0]

    for name, work in {
        "AsyncVectorEnv": lambda: AsyncVectorEnv([made] * 2, context="fork").reset(),
        "SubprocVecEnv": lambda: SubprocVecEnv([made] * 2, start_method="fork").reset(),
        "DataLoader": lambda: next(iter(torch.utils.data.DataLoader(Observed(), num_workers=1))),
    }.items():
        try:
            work()
            print(json.dumps([name, "worked"]))
        except (Exception, EOFError) as error:
            print(json.dumps([name, f"{type(error).__name__}: {error}"]))


def stepped():
    env = made()
    env.reset(seed=0)
    env.step(env.action_space.sample())


def spawned():
    """Workers that are started as they should be."""
    from gymnasium.vector import AsyncVectorEnv

    envs = AsyncVectorEnv([made] * 2, context="spawn")
    print(json.dumps(["AsyncVectorEnv", str(envs.reset(seed=0)[0].shape)]))
    envs.close()


def early():
    """Workers that were forked before JAX started, and programs that are started after."""
    import salpchain  # noqa: F401

    asked("forked before", stepped)
    start_jax()
    asked("forked after", stepped)
    code = "import salpchain; print(salpchain.load('any-length').card.name)"
    program = [sys.executable, "-c", code]
    done = subprocess.run(program, capture_output=True, text=True, preexec_fn=lambda: None)
    print(json.dumps(["program", done.stdout.strip()]))
    stepped()
    print(json.dumps(["here", "worked"]))


def late():
    """The package imported in the worker alone."""
    start_jax()
    assert "salpchain" not in sys.modules
    asked("late", lambda: __import__("salpchain").load("any-length"))


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # JAX's own, at each fork
    which = sys.argv[1]
    if which not in ("early", "late"):
        start_jax()
    globals()[which]()
