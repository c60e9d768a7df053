"""How many chain-steps per second this machine does: compile time apart, median of several."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as Spec
from jaxtyping import Array, Int, PRNGKeyArray

from salpchain.devices import AXIS, mesh_of
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.renew import renew_done
from salpchain.tasks.state import State
from salpchain.world.config import WorldConfig
from salpchain.world.randomise import as_world
from salpchain.world.world import World

TARGET_SECONDS = 0.4  # of one timed run (chosen)
FIRST_STEPS = 8  # of the run that tells how many fill the target (chosen)
REPEATS = 5
STILL = WorldConfig()
PAIRS = 15  # of runs whose ratio is taken (chosen)


@dataclass(frozen=True)
class Speed:
    """One measurement."""

    part: str  # physics, physics without contact, environment, environment without contact
    length: int  # units
    envs: int  # chains at once, over all devices
    devices: int
    steps_per_second: float  # chain-steps
    compile_seconds: float


Advance = Callable[[SCLD, State, Array], Any]


def environment(env: SCLD, states: State, action: Array) -> State:
    """The whole step: thrust, physics, contact, observation, reward, goal, auto-reset."""
    return renew_done(env, jax.vmap(env.step)(states, action))


def physics(env: SCLD, states: State, action: Array) -> State:
    """The physics alone."""
    move = partial(World(env.physics).step, contact=env.config.contact)
    chain = jax.vmap(move)(states.chain, action[..., 0])
    return eqx.tree_at(lambda s: s.chain, states, chain)


PARTS: dict[str, tuple[Advance, bool]] = {
    "environment": (environment, True),
    "environment without contact": (environment, False),
    "physics": (physics, True),
    "physics without contact": (physics, False),
}


def measure(
    part: str, length: int, envs: int, devices: int = 1, world: WorldConfig = STILL
) -> Speed:
    """The speed of a part under random thrust, `envs` chains shared out over the devices.

    In a world other than still water each chain has its own; the physics alone knows none.
    """
    ready = prepare(part, length, envs, devices, world=world)
    rate = statistics.median(ready.again() for _ in range(REPEATS))
    return Speed(part, length, ready.envs, devices, rate, ready.compile_seconds)


def ratio(
    one: str,
    other: str,
    length: int,
    envs: int,
    devices: int = 1,
    worlds: tuple[WorldConfig, WorldConfig] = (STILL, STILL),
) -> float:
    """How many times faster one part is than another: the median over runs in turn.

    In turn, because a machine that others share has slow spells; every run from the same straight
    chains at rest, because chains under random thrust fold in time and touch.
    """
    parts = [
        prepare(part, length, envs, devices, onward=False, world=world)
        for part, world in zip((one, other), worlds, strict=True)
    ]
    pairs = [[part.again() for part in parts] for _ in range(PAIRS)]
    return statistics.median(first / second for first, second in pairs)


@dataclass(frozen=True)
class Ready:
    """A part that is compiled and warm."""

    envs: int
    compile_seconds: float
    again: Callable[[], float]  # one more timed run: chain-steps per second


def prepare(
    part: str,
    length: int,
    envs: int,
    devices: int,
    onward: bool = True,
    world: WorldConfig = STILL,
) -> Ready:
    """The part, compiled, with so many steps in a run that it takes the target time.

    A run goes on where the one before ended if it is to go `onward`, else from the start.
    """
    advance, contact = PARTS[part]
    env = SCLD(TaskConfig(length=length, contact=contact), as_world(world))
    mesh = mesh_of(devices)
    envs -= envs % devices
    states = jax.jit(jax.vmap(env.reset))(jr.split(jr.key(0), envs))
    states = jax.device_put(states, NamedSharding(mesh, Spec(AXIS)))
    started = time.perf_counter()
    run = _compiled(env, advance, mesh, states)
    compile_seconds = time.perf_counter() - started
    _, first = _timed(run, states, FIRST_STEPS)
    steps = max(FIRST_STEPS, int(FIRST_STEPS * TARGET_SECONDS / first))

    def again() -> float:
        nonlocal states
        after, seconds = _timed(run, states, steps)
        states = after if onward else states
        return envs * steps / seconds

    return Ready(envs, compile_seconds, again)


def _compiled(env: SCLD, advance: Advance, mesh: Mesh, states: State) -> Any:
    def run(states: State, key: PRNGKeyArray, steps: Int[Array, ""]) -> State:
        key = jr.fold_in(key, jax.lax.axis_index(AXIS))
        shape = (states.time.shape[0], env.config.length, env.action_size)

        def turn(index: Array, states: State) -> State:
            action = jr.uniform(jr.fold_in(key, index), shape, minval=-1.0, maxval=1.0)
            return advance(env, states, action)

        return jax.lax.fori_loop(0, steps, turn, states)

    spread = jax.shard_map(
        run, mesh=mesh, in_specs=(Spec(AXIS), Spec(), Spec()), out_specs=Spec(AXIS), check_vma=False
    )
    return jax.jit(spread).lower(states, jr.key(1), jnp.int32(0)).compile()


def _timed(run: Any, states: State, steps: int) -> tuple[State, float]:
    started = time.perf_counter()
    after = jax.block_until_ready(run(states, jr.key(1), jnp.int32(steps)))
    return after, time.perf_counter() - started


def best(part: str, length: int, batches: tuple[int, ...], devices: int = 1) -> Speed:
    """The fastest of several batch sizes."""
    speeds = [measure(part, length, envs, devices) for envs in batches]
    return max(speeds, key=lambda speed: speed.steps_per_second)
