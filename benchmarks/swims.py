"""Speed in real swims: chains as controllers leave them, with contact and without, beside VMAS.

python -m benchmarks.swims [--ours] [--name NAME] [--overwrite]

`swims`: 64 chains swim for a while; then the next 100 control steps, the controller's own part
included, are timed with contact and, from the same states, without, in turn. `vmas`: from the
states of swims, each engine under the thrust of that moment, held: ours as the whole environment
step, VMAS its `World.step` alone, each at its best batch size.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable, Iterator
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
BATCHES, VMAS_STEPS = (16, 64, 256, 1024), 3


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


def _random(state: State, key: Array) -> Array:
    return jr.uniform(key, (state.thrust.size, 1), minval=-1)


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


def beside_vmas(controller: str, length: int, before: int) -> dict[str, Any]:
    """Chain-steps per second of both engines from the same states, each at its best batch size."""
    from benchmarks.vmas_world import steps_per_second_from

    task, _, drive = tasks(Swim(controller, length, before))
    swim = eqx.filter_jit(lambda states, steps: swum(task, drive, states, steps)[0])
    ours, theirs = {}, {}
    for chains in BATCHES:
        states = jax.jit(jax.vmap(task.reset))(jr.split(jr.key(0), chains))
        states = swim(states, jnp.int32(before))
        action = jax.jit(jax.vmap(drive))(states, jr.split(jr.key(2), chains))
        ours[chains] = _environment_rate(task, states, action)
        theirs[chains] = steps_per_second_from(states.chain, action[..., 0], VMAS_STEPS)
    best = {name: max(rates, key=rates.__getitem__) for name, rates in (("o", ours), ("v", theirs))}
    fast, slow = ours[best["o"]], theirs[best["v"]]
    return {
        **Swim(controller, length, before)._asdict(),
        "chains": best["o"],
        "environment_steps_per_second": fast,
        "vmas_chains": best["v"],
        "vmas_world_steps_per_second": slow,
        "ratio": fast / slow,
        "same_batch_ratios": {chains: ours[chains] / theirs[chains] for chains in BATCHES},
    }


def _environment_rate(task: Task, states: State, action: Array) -> float:
    @jax.jit
    def run(states: State, steps: Array) -> State:
        move = jax.vmap(task.step)
        return jax.lax.fori_loop(0, steps, lambda _, moved: move(moved, action), states)

    jax.block_until_ready(run(states, jnp.int32(VMAS_STEPS)))
    rates = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        jax.block_until_ready(run(states, jnp.int32(VMAS_STEPS)))
        rates.append(len(action) * VMAS_STEPS / (time.perf_counter() - started))
    return statistics.median(rates)


def rows(vmas: bool) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every comparison, with the name of its list, as it is made."""
    yield from (("swims", timed(swim)) for swim in SWIMS)
    if vmas:
        for length, before in ((8, 60), (64, 600)):
            for controller in ("any-length", "greedy", "random"):
                yield "vmas", beside_vmas(controller, length, before)


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ours", action="store_true", help="without VMAS")
    add_options(parser)
    options = parser.parse_args()
    devices = use_devices()
    path, record = begun("swims", options, ours=options.ours)
    record["devices"] = devices
    for part, row in rows(not options.ours):
        print(f"{part}: {json.dumps(row)}", flush=True)
        record[part] = [*record.get(part, []), row]
        write_json(path, record)  # after each, so that a run cut short leaves what it saw


if __name__ == "__main__":
    main()
