"""Speed in worlds against that in still water without obstacles, in turn in one run.

python -m benchmarks.worlds [--name NAME] [--overwrite]

The whole environment step in each named world and in `four`: a current, dead thrusters, noise and
delay together. Then the control step alone, with walls and posts against the same without:
`in_sight`: 8 obstacles nearer than 1 m, none touched. `far`: 8 of them 100 m away. `touching`: the
same chains in a room whose walls press on some.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array

from benchmarks.run import add_options, begun
from salpchain.devices import use_devices
from salpchain.evaluation.speed import PAIRS, STILL, ratio
from salpchain.files import write_json
from salpchain.physics.chain import step
from salpchain.physics.obstacles import Obstacles
from salpchain.physics.state import Chain, Physics, at_rest
from salpchain.ranges import Range
from salpchain.world.config import CurrentConfig, SensingConfig, ThrusterConfig, WorldConfig
from salpchain.world.obstacles import make_obstacles, room
from salpchain.world.presets import WORLDS
from salpchain.world.surfaces import nearest_surface, rays

LENGTH, ENVS = 8, 1024  # of the whole environment
FOUR = WorldConfig(
    current=CurrentConfig(speed=Range(0.0, 0.06)),
    thrusters=ThrusterConfig(dead=Range(0.0, 0.5)),
    sensing=SensingConfig(position=Range(0.0, 0.01), angle=Range(0.0, 0.1), delay=Range(0.0, 2.0)),
)
PART = "environment"
SIZES = ((8, 1024), (64, 256))  # units, chains
STEPS, REPEATS = 60, 15  # control steps in a timed run, from rest; runs of each kind


def straight(length: int, envs: int) -> Chain:
    """Chains at rest around the origin, in all directions."""
    turn = 2 * np.pi * np.arange(envs) / envs
    along = (np.arange(length) - (length - 1) / 2) * float(Physics().link_length)
    place = along[None, :, None] * np.stack([np.cos(turn), np.sin(turn)], -1)[:, None]
    angle = np.repeat(turn[:, None], length, 1)
    return jax.vmap(at_rest)(jnp.asarray(place, jnp.float32), jnp.asarray(angle, jnp.float32))


def around(distance: float, size: float = 0.2) -> Obstacles:
    """Five walls and three posts whose surfaces are about so far (m) from the origin."""
    turn = 2 * np.pi * np.arange(8) / 8
    out, aside = (
        np.stack([np.cos(turn), np.sin(turn)], -1),
        np.stack([-np.sin(turn), np.cos(turn)], -1),
    )
    middle = (distance + size / 2) * out
    ends = [
        (tuple(m - size * a), tuple(m + size * a), size) for m, a in zip(middle, aside, strict=True)
    ]
    return make_obstacles(ends[:5], [(tuple(m), size / 2) for m in middle[5:]])


def worlds(length: int) -> dict[str, Obstacles | None]:
    """What is measured: nothing, obstacles in sight, far ones, and a room that chains touch."""
    half = length * float(Physics().link_length) / 2
    tight = 2 * half + 0.05
    return {
        "plain": None,
        "in_sight": around(half + 0.15),
        "far": around(100.0),
        "touching": make_obstacles(room(tight, tight)),
    }


def prepared(
    chains: Chain, advance: Callable[[Chain, Array], Any]
) -> Callable[[], tuple[float, Any]]:
    """A timed run under random thrust: chain-steps per second, and where it ends."""
    envs, length = chains.units.angle.shape

    @jax.jit
    def run(chains: Chain) -> Any:
        def turn(index: Array, chains: Chain) -> Chain:
            push = jr.uniform(jr.fold_in(jr.key(0), index), (envs, length), minval=-1.0)
            return advance(chains, push)

        return jax.lax.fori_loop(0, STEPS, turn, chains)

    jax.block_until_ready(run(chains))

    def again() -> tuple[float, Any]:
        begin = time.perf_counter()
        end = jax.block_until_ready(run(chains))
        return envs * STEPS / (time.perf_counter() - begin), end

    return again


def compared(length: int, envs: int) -> dict[str, Any]:
    """Chain-steps per second of every world, and the median ratio to the plain one of its turn."""
    chains = straight(length, envs)
    ready = {}
    for name, obstacles in worlds(length).items():
        move = partial(step, obstacles=obstacles)
        ready[name] = prepared(chains, jax.vmap(move))
    ready["in_sight_sensed"] = prepared(chains, _sensing(worlds(length)["in_sight"]))
    rates = [{name: again()[0] for name, again in ready.items()} for _ in range(REPEATS)]
    return {
        "length": length,
        "envs": envs,
        "steps_per_second": {name: statistics.median(r[name] for r in rates) for name in ready},
        "ratio": {name: statistics.median(r[name] / r["plain"] for r in rates) for name in ready},
    }


def _sensing(obstacles: Any) -> Callable[[Chain, Array], Chain]:
    """A step whose next thrust hangs on what units sense, so that nothing is left out."""

    def one(chain: Chain, push: Array) -> Chain:
        felt = nearest_surface(chain, obstacles).sum(1) + rays(chain, obstacles).sum(1)
        return step(chain, push + 1e-6 * felt, obstacles=obstacles)

    return jax.vmap(one)


def named(devices: int) -> dict[str, float]:
    """The whole environment's speed in each world, as a ratio to that in still water."""
    others = {name: world for name, world in WORLDS.items() if world != STILL}
    return {
        name: ratio(PART, PART, LENGTH, ENVS, devices, (world, STILL))
        for name, world in {"four": FOUR, **others}.items()
    }


def main() -> None:
    """Measures, prints and writes the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    devices = use_devices()
    settings = {"steps": STEPS, "repeats": REPEATS, "devices": devices, "pairs": PAIRS}
    path, record = begun("worlds", parser.parse_args(), **settings)
    record["environment"] = {"length": LENGTH, "envs": ENVS, "ratio": named(devices)}
    record["obstacles"] = [compared(*sizes) for sizes in SIZES]
    write_json(path, record)
    print(json.dumps({name: record[name] for name in ("environment", "obstacles")}, indent=2))


if __name__ == "__main__":
    main()
