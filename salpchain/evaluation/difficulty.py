"""How hard an episode is, told from its start: what physics allows, and what the task asks."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from salpchain.checks import LONGEST
from salpchain.dynamics.robot import scale_of
from salpchain.evaluation.limits import WHOLE, Means, fewest_steps, reachable, steps_to_turn
from salpchain.physics.state import Chain, Scalar, wrap
from salpchain.tasks.config import STEPS_PER_UNIT
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from salpchain.world.current import Shear, Uniform, Vortex, Wandering, parts_of
from salpchain.world.world import World

MOST_STEPS = STEPS_PER_UNIT * LONGEST  # control steps, of the longest chain's scaled limit


class Start(eqx.Module):
    """What is known of a trial before its first step."""

    origin: Float[Array, "2"]  # m, centroid of the units
    reachable: Float[Array, ""]  # closed fraction that no controller can exceed
    fewest_steps: Int[Array, ""]  # control steps before which no controller can be at the goal
    known: Bool[Array, ""]  # whether these two are; they are not where the water changes by chance
    possible: Bool[Array, ""]  # whether they allow the goal within the time limit; true if unknown
    turn_steps: Int[Array, ""]  # before which no chain that stays straight has turned as far
    far: Float[Array, ""]  # mean distance to the target points, in lengths of the chain
    turn: Float[Array, ""]  # rad, 0 to pi, from the chain's direction to the target's
    bend: Float[Array, ""]  # rad, sum of all turns along the target


def start_of(env: Task, state: State) -> Start:
    """The difficulty of an episode that has just begun."""
    chain, target, length = state.chain, state.target, state.length
    limit = env.step_limit(length)
    tolerance = env.config.tolerance * scale_of(env.physics)
    turn, bend = _turn_and_bend(chain, target)
    world = env.world_of(state)
    physics, (means, known) = world.dynamics, _means(world, chain)
    fewest = fewest_steps(physics, chain, target, tolerance, MOST_STEPS, means)
    return Start(
        origin=centroid(chain),
        reachable=reachable(physics, chain, target, limit, means, MOST_STEPS),
        fewest_steps=fewest,
        known=known,
        possible=~known | (fewest <= limit),
        turn_steps=steps_to_turn(physics, length, turn, tolerance, MOST_STEPS),
        far=state.start_distance / (length * physics.link_length),
        turn=turn,
        bend=bend,
    )


def _means(world: World, chain: Chain) -> tuple[Means, Bool[Array, ""]]:
    """What moves the chain in a world, and whether that bounds what it can do.

    Thrusters may fail, lag and push one way: the chain can do no more than with those that live at
    first. Nothing is known of water that changes by chance, or grows without a bound.
    """
    thrust: Scalar = 1.0
    if world.thrusters is not None:
        gains = world.thrusters.working(jnp.int32(0), chain.units.angle)
        thrust = jnp.where(chain.present, gains, 0.0).sum() / chain.present.sum()
    flow, stir, known = jnp.zeros(2), jnp.zeros(()), jnp.ones((), bool)
    for part in parts_of(world.current):
        match part:
            case Uniform():
                flow = flow + part.velocity
            case Vortex():
                stir = stir + jnp.abs(part.speed)
            case Shear():
                known &= jnp.asarray(part.rate) == 0
            case Wandering():
                flow, known = flow + part.mean, known & (jnp.asarray(part.deviation) == 0)
            case _:
                known = jnp.zeros((), bool)
    if world.current is None:
        return (WHOLE if world.thrusters is None else Means(thrust)), known
    return Means(thrust, flow, stir), known


def centroid(chain: Chain) -> Float[Array, "2"]:
    """The centroid of the present units (m)."""
    present = chain.present[:, None]
    return jnp.where(present, chain.units.position, 0.0).sum(axis=0) / present.sum()


def _turn_and_bend(
    chain: Chain, target: Float[Array, "unit 2"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    joined = chain.joined[:, None]
    chords = jnp.where(joined, target[1:] - target[:-1], 0.0)
    along = jnp.where(joined, chain.units.position[1:] - chain.units.position[:-1], 0.0)
    apart = wrap(_direction(chords.sum(axis=0)) - _direction(along.sum(axis=0)))
    turns = wrap(_direction(chords[1:]) - _direction(chords[:-1]))
    both = chain.joined[1:] & chain.joined[:-1]
    return jnp.abs(apart), jnp.where(both, jnp.abs(turns), 0.0).sum()


def _direction(vector: Float[Array, "*rows 2"]) -> Float[Array, "*rows"]:
    return jnp.arctan2(vector[..., 1], vector[..., 0])
