"""Robots that exist: python -m studies.landsalp gait | search | water | long

gait    the gait that was published for LandSalp's three links: way, turn and bend of a cycle
search  gaits found by optimisation under the same jets, with joints to 10.4 and to 45 degrees
water   three links in water, identified on one measured run and held against the others
long    chains of 3 to 64 links under equal jets, in both
"""

import sys
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.dynamics.landsalp import LandSalp
from salpchain.errors import InputError
from salpchain.physics.state import Chain
from studies import program

PERIOD = 6.0  # s, of the published gait
# m/s: mean, sine and cosine parts of each jet's speed, as published with LandSalp
PUBLISHED = np.array(
    [[-0.0023, -0.0038, -0.0011], [-0.1135, 0.0133, 0.0480], [0.0415, 0.0508, 0.0246]]
)
CYCLES = 60  # after which the shape repeats itself (chosen)
STEPS = 600  # of a cycle (chosen)


class Cycle(NamedTuple):
    """What one cycle of a gait does."""

    way: Any  # m, between the means of the links' middles
    turn: Any  # rad, of the mean direction
    bend: Any  # rad, the largest joint angle on the way
    change: Any  # rad, by which a joint ends elsewhere than it began


def speeds(parts: Float[Array, "part unit"], time: Any, period: float) -> Float[Array, " unit"]:
    """What the jets set (m/s) at a time (s): mean, sine and cosine parts."""
    phase = 2 * jnp.pi * time / period
    return parts[0] + parts[1] * jnp.sin(phase) + parts[2] * jnp.cos(phase)


def cycle(
    robot: LandSalp, chain: Chain, parts: Array, period: float, steps: int
) -> tuple[Chain, Cycle]:
    """One cycle of a gait, in so many steps with the jets held as in the middle of each."""
    robot = _with_step(robot, period / steps)

    def step(chain: Chain, index: Array) -> tuple[Chain, Array]:
        asked = speeds(parts, (index + 0.5) * period / steps, period)
        chain = robot.advance(chain, asked / robot.jet)
        return chain, jnp.diff(robot.directions(chain))

    after, bends = jax.lax.scan(step, chain, jnp.arange(steps))
    way = jnp.linalg.norm(_middle(after) - _middle(chain))
    turn = (robot.directions(after) - robot.directions(chain)).mean()
    return after, Cycle(way, turn, jnp.abs(bends).max(), jnp.abs(bends[-1] - bends_of(robot, chain)).max())


def _with_step(robot: LandSalp, seconds: float) -> LandSalp:
    return LandSalp.robot(control_step=seconds, substeps=1, jet=1.0)


def _middle(chain: Chain) -> Array:
    return chain.units.position.mean(axis=0)


def bends_of(robot: LandSalp, chain: Chain) -> Array:
    """The joint angles (rad)."""
    return jnp.diff(robot.directions(chain))


def gait() -> None:
    """Print what the published gait does in the model, once its shape repeats itself."""
    robot = LandSalp.robot(jet=1.0)
    run = jax.jit(partial(cycle, robot, period=PERIOD, steps=STEPS))
    chain, told = robot.straight(3), None
    for _ in range(CYCLES):
        chain, told = run(chain, jnp.asarray(PUBLISHED))
    print(f"way {1e3 * told.way:.3f} mm in a cycle of {PERIOD:g} s, {1e3 * told.way / PERIOD:.3f} mm/s")
    print(f"turn {np.degrees(told.turn) / PERIOD:.2e} degrees/s")
    print(f"joints at most {np.degrees(told.bend):.2f} degrees, {told.change:.1e} rad from a cycle to the next")


COMMANDS: dict[str, Callable[[], None]] = {"gait": gait}


def main() -> None:
    """Does what the command line names."""
    if len(sys.argv) != 2 or sys.argv[1] not in COMMANDS:
        raise InputError(f"name what to do: {', '.join(COMMANDS)}")
    with jax.enable_x64(True):
        COMMANDS[sys.argv[1]]()


if __name__ == "__main__":
    program("landsalp", main, __doc__)
