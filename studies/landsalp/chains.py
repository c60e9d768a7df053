"""Chains under constant jets: three links in water held against measured runs, and long ones."""

import time
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.dynamics.landsalp import LandSalp
from salpchain.dynamics.robot import Dynamics, Part
from salpchain.dynamics.water import Water
from salpchain.physics.state import Chain, Physics, at_rest
from salpchain.world.world import World

SECONDS = 118.0  # of the measured run that turns on the spot
# Jets of the tail, the middle and the front that push, and what public tracks of a three-unit chain
# in water come to, at an assumed 30 frames/s: m/s, and degrees in that time. None: not told.
RUNS = {
    "all": ((1.0, 1.0, 1.0), 0.033, None),
    "front alone": ((0.0, 0.0, 1.0), 0.026, None),
    "middle alone": ((0.0, 1.0, 0.0), 0.019, None),
    "back alone": ((1.0, 0.0, 0.0), None, -274.0),
}
# What is not told of that chain: where its jets push. Two guesses: as LandSalp's, and along the
# links, each where LandSalp's is, so a little beside the link's middle.
PUSHES = {
    "jets as LandSalp's": Water.parts,
    "jets along the links": tuple(replace(part, jet=0.0) for part in Water.parts),
    "and in their middles": tuple(replace(part, jet=0.0, at=(0.0, 0.0)) for part in Water.parts),
}
STRONGEST = 1.0  # N, of a jet that is looked for
LENGTHS = (3, 4, 6, 8, 10, 12, 16, 24, 32, 64)
STEPS = 200  # control steps of a long chain
BATCH, TIMED = 256, 10  # chains, and control steps, of a measured time (chosen)
CROOKED = 0.02  # rad, standard deviation of its joints at first


class Swim(NamedTuple):
    """How a chain swims in the second half of its time."""

    speed: Array  # m/s, of its middle along its way
    straight: Array  # m/s, of its middle from where it was to where it is
    turn: Array  # rad, of its mean direction in the whole time
    spread: Array  # distance of its ends over its length


def swim(robot: Dynamics, chain: Chain, thrust: Float[Array, " unit"], steps: int) -> Swim:
    """What constant thrusts (-1 to 1) do to a chain in so many control steps."""
    here, num = chain.present, chain.present.sum()

    def middle(chain: Chain) -> Array:
        return jnp.where(here[:, None], chain.units.position, 0.0).sum(axis=0) / num

    def step(chain: Chain, _: None) -> tuple[Chain, Array]:
        chain = robot.advance(chain, thrust)
        return chain, middle(chain)

    ended, path = jax.lax.scan(step, chain, None, length=steps)
    late = path[steps // 2 :]
    ways, time = jnp.diff(late, axis=0), (len(late) - 1) * robot.control_step
    turns = robot.directions(ended) - robot.directions(chain)
    ends = ended.units.position[num - 1] - ended.units.position[0]
    return Swim(
        jnp.linalg.norm(ways, axis=1).sum() / time,
        jnp.linalg.norm(late[-1] - late[0]) / time,
        jnp.where(here, turns, 0.0).sum() / num,
        jnp.linalg.norm(ends) / ((num - 1) * robot.link_length),
    )


def in_water() -> None:
    """Print the speed and turn of each measured run beside what the model says.

    Its one constant that is fitted, the push of a jet, is that of the first run.
    """
    for name, parts in PUSHES.items():
        _held_against(name, parts)


def _held_against(name: str, parts: tuple[Part, ...]) -> None:
    steps = round(SECONDS / float(Water().control_step))

    @jax.jit
    def run(jet: Array, thrust: Array) -> Swim:
        water = Water(jet=jet, parts=parts)
        crooked = water.straight(3, jnp.array([CROOKED, -CROOKED]))
        return swim(water, crooked, thrust, steps)

    jets, measured, _ = RUNS["all"]
    low, high = 0.0, STRONGEST
    for _ in range(24):
        jet = (low + high) / 2
        low, high = (jet, high) if run(jet, jnp.array(jets)).speed < measured else (low, jet)
    print(f"{name}: {jet:.4f} N each, from the run with all")
    for name, (jets, measured, turned) in RUNS.items():
        told = run(jet, jnp.array(jets))
        speeds = f"{told.speed:.4f} m/s on its way, {told.straight:.4f} straight"
        print(f"{name:14} {speeds}, measured {measured or 'not told'}; turn"
              f" {np.degrees(told.turn):.0f} degrees, measured {turned or 'not told'}")  # fmt: skip


def long() -> None:
    """Print how chains of many lengths swim under equal jets, on the ground and in water."""
    for name, robot in (("ground", LandSalp(angle_stiffness=0.0)), ("water", Water())):
        slots = max(LENGTHS)
        bends = CROOKED * jax.random.normal(jax.random.key(0), (slots - 1,))
        chain = robot.straight(slots, bends)

        def of(length: Array, robot: Any = robot, chain: Chain = chain) -> Swim:
            present = jnp.arange(len(chain.present)) < length
            own = eqx.tree_at(lambda c: (c.present, c.linked), chain, (present, present[1:]))
            return swim(robot, own, jnp.ones(len(present)), STEPS)

        told = jax.jit(jax.vmap(of))(jnp.array(LENGTHS))
        seconds = STEPS * float(robot.control_step)
        print(f"{name}: equal jets for {seconds:.0f} s from nearly straight")
        for length, *row in zip(LENGTHS, *told, strict=True):
            speed, straight, turn, spread = map(float, row)
            print(f"{length:3} links {speed:.4f} m/s, {straight:.4f} straight, turned"
                  f" {np.degrees(turn):7.0f} degrees, ends {spread:.2f} lengths apart")  # fmt: skip


def cost() -> None:
    """Print the processor time of a control step of chains of several lengths.

    Time of this process on all cores, so that other programs count for nothing.
    """
    for length in (16, 64, 128):
        for name, physics in (("vmas", Physics()), ("landsalp", LandSalp()), ("water", Water())):
            step = jax.jit(jax.vmap(partial(World(physics).step, contact=False)))
            thrust = jax.random.uniform(jax.random.key(0), (BATCH, length), minval=-1.0)
            one = _straight(physics, length)
            chains = jax.tree.map(lambda x: jnp.broadcast_to(x, (BATCH, *x.shape)), one)
            for _ in range(2):  # the second time its arrays are as the step gives them
                chains = jax.block_until_ready(step(chains, thrust))
            each = min(_processor_time(step, chains, thrust) for _ in range(3))
            print(f"{length:3} units, {name:8} {1e6 * each:6.1f} us a chain and step", flush=True)


def _processor_time(step: Any, chains: Chain, thrust: Array) -> float:
    """Of one control step of one chain (s)."""
    begun = time.process_time()
    for _ in range(TIMED):
        chains = step(chains, thrust)
    jax.block_until_ready(chains)
    return (time.process_time() - begun) / (TIMED * BATCH)


def _straight(physics: Physics, length: int) -> Chain:
    if isinstance(physics, Dynamics):
        return physics.straight(length)
    along = physics.link_length * jnp.arange(length)
    return at_rest(jnp.stack([along, 0 * along], axis=1), jnp.zeros(length))
