"""Speed in real swims: chains as controllers leave them, with contact and without.

python -m benchmarks.swims [--rows NAME,..] [--ours] [--name NAME] [--overwrite]

For each controller, length and time: 64 chains swim that long, then the next 100 whole control
steps, the controller's own included, are timed with contact and, from the same states, without,
in turn. Beside them: the physics alone from states of many swims, ours and VMAS's `World.step`.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array

import salpchain
from benchmarks.run import add_options, begun
from salpchain.controllers.policy import Controller
from salpchain.devices import use_devices
from salpchain.files import write_json
from salpchain.tasks.state import State
from salpchain.tasks.task import Task

CHAINS, STEPS, REPEATS = 64, 100, 7


class Swim(NamedTuple):
    """Which chains are timed."""

    controller: str
    length: int
    before: int  # control steps that they have swum


SWIMS = (
    Swim("greedy", 8, 60),
    Swim("greedy", 8, 500),
    Swim("greedy", 32, 300),
    Swim("greedy", 32, 900),
    Swim("greedy", 128, 1500),
    Swim("any-length", 8, 60),
    Swim("any-length", 32, 300),
    Swim("any-length", 128, 1000),
)

Drive = Callable[[State, Array], Array]  # the action of one chain in this step


def driven(name: str) -> tuple[str, str, Drive]:
    """What a controller observes, its actions' name, and its actions; `random` draws thrusts."""
    if name == "random":
        return (
            "body",
            "thrust",
            lambda state, key: jr.uniform(key, (state.thrust.size, 1), minval=-1),
        )
    controller: Controller = salpchain.load(name)
    return controller.card.observation, controller.card.action, lambda s, _: controller.act(s)


def swum(task: Task, drive: Drive, states: State, steps: Array) -> tuple[State, Array]:
    """The states after so many control steps, and the share of chains that touched in them."""

    def turn(index: Array, carry: tuple[State, Array]) -> tuple[State, Array]:
        states, touched = carry
        keys = jr.split(jr.fold_in(jr.key(1), index), states.time.size)
        states = jax.vmap(lambda s, key: task.step(s, drive(s, key)))(states, keys)
        return states, touched + states.chain.touching.mean()

    states, touched = jax.lax.fori_loop(0, steps, turn, (states, jnp.zeros(())))
    return states, touched / jnp.maximum(steps, 1)


def tasks(swim: Swim) -> tuple[Task, Task, Drive]:
    """The task with contact and without, and who steers."""
    observation, action, drive = driven(swim.controller)
    config = salpchain.TaskConfig(
        length=swim.length, observation=observation, action=action, time_limit="scaled"
    )
    return salpchain.SCLD(config), salpchain.SCLD(replace(config, contact=False)), drive


def timed(swim: Swim, chains: int = CHAINS) -> dict[str, Any]:
    """Chain-steps per second with contact and without, the ratio, and how many chains touch."""
    touching, passing, drive = tasks(swim)
    states = jax.jit(jax.vmap(touching.reset))(jr.split(jr.key(0), chains))
    runs = [eqx.filter_jit(lambda *x, t=task: swum(t, drive, *x)) for task in (touching, passing)]
    states, _ = runs[0](states, jnp.int32(swim.before))
    touched = float(runs[0](states, jnp.int32(STEPS))[1])
    jax.block_until_ready(runs[1](states, jnp.int32(STEPS)))
    seconds = [[_seconds(run, states) for run in runs] for _ in range(REPEATS)]
    rates = [chains * STEPS / statistics.median(column) for column in zip(*seconds, strict=True)]
    return {
        **swim._asdict(),
        "chains": chains,
        "with_contact": rates[0],
        "without": rates[1],
        "ratio": statistics.median(off / on for on, off in seconds),
        "touching": touched,
    }


def _seconds(run: Any, states: State) -> float:
    started = time.perf_counter()
    jax.block_until_ready(run(states, jnp.int32(STEPS)))
    return time.perf_counter() - started


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    options = parser.parse_args()
    devices = use_devices()
    path, record = begun("swims", options)
    record["devices"] = devices
    record["swims"] = []
    for swim in SWIMS:
        row = timed(swim)
        print(json.dumps(row), flush=True)
        record["swims"].append(row)
        write_json(path, record)


if __name__ == "__main__":
    main()
