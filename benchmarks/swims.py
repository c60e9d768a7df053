"""Speed in real swims: chains as controllers leave them, with contact and without, beside VMAS.

python -m benchmarks.swims [--quick] [--ours] [--name NAME] [--overwrite]

`swims`: 64 chains swim for a while; then the next 100 control steps, the controller's own part
included, are timed with contact and, from the same states, without, in turn. `batches`: from states
of swims at other lengths, the whole environment step without a controller, and VMAS's `World.step`
alone. `at_best`: the ratio of the two, each at its best batch size.
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
BATCHES = (16, 64, 256, 1024)
SEEN = ((8, 60), (16, 150), (32, 300), (64, 600), (128, 1000), (256, 2000))  # units, steps before
BETWEEN = 20  # control steps between the states that are taken of a swim
HELD = 3  # control steps under one thrust
VMAS_UNITS = 2**15  # VMAS needs minutes for more


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
        return "body", "thrust", _random
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


def seen(controller: str, length: int, before: int) -> tuple[Task, State, Array]:
    """States of swims, as many as the largest batch, and the actions in them.

    64 chains swim; they are taken at 16 times, `BETWEEN` control steps apart.
    """
    task, _, drive = tasks(Swim(controller, length, before))
    swim = eqx.filter_jit(lambda states, steps: swum(task, drive, states, steps)[0])
    states = jax.jit(jax.vmap(task.reset))(jr.split(jr.key(0), CHAINS))
    taken = [swim(states, jnp.int32(before))]
    while len(taken) * CHAINS < BATCHES[-1]:
        taken.append(swim(taken[-1], jnp.int32(BETWEEN)))
    every = jax.tree.map(lambda *x: jnp.concatenate(x), *taken)
    return task, every, jax.jit(jax.vmap(drive))(every, jr.split(jr.key(2), BATCHES[-1]))


def compared(controller: str, length: int, before: int, vmas: bool) -> Iterator[dict[str, Any]]:
    """For each batch size, chain-steps per second of the environment step with contact and without,
    and of VMAS's `World.step`, from the same states under the thrust of that moment, held."""
    task, every, actions = seen(controller, length, before)
    passing = type(task)(replace(task.config, contact=False))
    for chains in BATCHES:
        # those of one moment first; then others of the same chains
        states, action = jax.tree.map(lambda x, n=chains: x[:n], (every, actions))
        row = {**Swim(controller, length, before)._asdict(), "chains": chains}
        row["with_contact"] = _environment_rate(task, states, action)
        row["without"] = _environment_rate(passing, states, action)
        if vmas and chains * length <= VMAS_UNITS:
            from benchmarks.vmas_world import steps_per_second_from

            rate = steps_per_second_from(states.chain, action[..., 0], HELD)
            row["vmas_world"], row["ratio"] = rate, row["with_contact"] / rate
        yield row


def at_best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How many times as fast ours is as VMAS, each at its best batch size."""
    ours = max(rows, key=lambda row: row["with_contact"])
    theirs = max(rows, key=lambda row: row.get("vmas_world", 0.0))
    ratio = ours["with_contact"] / theirs["vmas_world"]
    named = {name: ours[name] for name in Swim._fields}
    return {**named, "chains": ours["chains"], "vmas_chains": theirs["chains"], "ratio": ratio}


def _environment_rate(task: Task, states: State, action: Array) -> float:
    @jax.jit
    def run(states: State, steps: Array) -> State:
        move = jax.vmap(task.step)
        return jax.lax.fori_loop(0, steps, lambda _, moved: move(moved, action), states)

    jax.block_until_ready(run(states, jnp.int32(HELD)))
    rates = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        jax.block_until_ready(run(states, jnp.int32(HELD)))
        rates.append(len(action) * HELD / (time.perf_counter() - started))
    return statistics.median(rates)


def parts(quick: bool, vmas: bool) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every comparison, with the name of its list, as it is made."""
    yield from (("swims", timed(swim)) for swim in SWIMS)
    for length, before in () if quick else SEEN:
        for controller in ("any-length", "greedy", "random"):
            rows = []
            for row in compared(controller, length, before, vmas):
                rows.append(row)
                yield "batches", row
            if vmas:
                yield "at_best", at_best(rows)


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the swims alone")
    parser.add_argument("--ours", action="store_true", help="without VMAS")
    add_options(parser)
    options = parser.parse_args()
    devices = use_devices()
    path, record = begun("swims", options, quick=options.quick, ours=options.ours)
    record["devices"] = devices
    for part, row in parts(options.quick, not options.ours):
        print(f"{part}: {json.dumps(row)}", flush=True)
        record[part] = [*record.get(part, []), row]
        write_json(path, record)  # after each, so that a run cut short leaves what it saw


if __name__ == "__main__":
    main()
