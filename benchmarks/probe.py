"""What `benchmarks.history` measures of one commit: a line of JSON, seconds by figure.

Run by its path, with the package of any commit on PYTHONPATH: only names that every version has are
used. `benchmarks.history` gives it an environment without compilation cache.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

import salpchain
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

RUNS = 5  # of which the best counts: what others do on the machine only adds time
STEPS = 64  # in one run
SWIMS = ((8, 256), (64, 32))  # units and chains of a batch
TRAINED = 65_536  # chain-steps


def best_of(run: Callable[[], Any]) -> float:
    """Seconds of the quickest run, after one that compiles."""
    jax.block_until_ready(run())
    seconds = []
    for _ in range(RUNS):
        began = time.perf_counter()
        jax.block_until_ready(run())
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def steps(length: int, chains: int, steered: bool) -> float:
    """Seconds of a batch's 64 control steps: under a fixed thrust, or steered by any-length."""
    policy = salpchain.load("any-length")
    env = SCLD(policy.card.task(length) if steered else TaskConfig(length=length))
    begun = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), chains))
    fixed = jnp.full((chains, length, env.action_size), 0.5)

    def advance(states: Any, _: None) -> tuple[Any, None]:
        action = jax.vmap(policy.act)(states) if steered else fixed
        return jax.vmap(env.step)(states, action), None

    swim = jax.jit(lambda states: jax.lax.scan(advance, states, None, STEPS)[0].reward)
    return best_of(lambda: swim(begun))


def command(*words: str) -> float:
    """Seconds of a command in a fresh process."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "salpchain", *words], check=True, capture_output=True)
    return time.perf_counter() - began


def main() -> None:
    """Measures and prints."""
    found = {}
    for length, chains in SWIMS:
        found[f"{STEPS} steps of {chains} x {length} units"] = steps(length, chains, False)
        found[f"{STEPS} steps of {chains} x {length} units, steered"] = steps(length, chains, True)
    with tempfile.TemporaryDirectory() as folder:
        train = ("train", "--length", "8", "--steps", str(TRAINED), "--out", f"{folder}/run")
        found["training of 65,536 steps, cold"] = command(*train)
        os.environ["SALPCHAIN_CACHE"] = f"{folder}/cache"
        swim = ("replay", "any-length", "--length", "24", "--out")
        found["replay of 24 units, cold"] = command(*swim, f"{folder}/a.html")
        found["replay of 24 units, warm"] = command(*swim, f"{folder}/b.html")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
