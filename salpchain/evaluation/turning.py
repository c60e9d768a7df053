"""Fewest steps to a target with turning counted: of any chain, and of one that stays straight.

Units push across themselves alone. Before a chain has turned, by bending or as a whole, it cannot
push along itself. What is proven, and of what: docs/bounds.md.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from salpchain.evaluation.limits import (
    MOST_THRUST,
    acceleration,
    angle_turned,
    least_way,
)
from salpchain.physics.state import Chain, Physics, Scalar


def mean_turn(physics: Physics, steps: int | Array) -> Scalar:
    """Largest mean angle (rad) by which the units of a chain turn from rest in so many steps.

    However it bends: what turns units is the work that thrusters, at most 1 N each, have done on
    them by moving them, and what has gone into spin moves no unit (docs/bounds.md has the proof).
    Joints and angle constraints store energy and give it back; drag takes some. Half a substep is
    added for the engine's order of velocities and places.
    """
    time = steps * physics.control_step
    substep = physics.control_step / physics.substeps
    growth = MOST_THRUST / (physics.unit_mass * physics.unit_inertia) ** 0.5
    return growth * time * (time + substep) / jnp.pi


def fewest_steps_turning(
    physics: Physics, chain: Chain, target: Float[Array, "unit 2"], tolerance: float, most: int
) -> Int[Array, ""]:
    """Control steps before which the chain, at rest, cannot have taken the target.

    `limits.fewest_steps`, with the thrust that units cannot give along the way while they have not
    turned towards it. For any chain in still water that touches neither itself nor a wall, however
    it bends; exact for substeps without end (see docs/bounds.md). At most `most`.
    """
    way, ahead = least_way(physics, chain, target, tolerance)
    askew = jnp.where(chain.present, _askew(chain.units.angle, ahead), jnp.inf).min()
    turned = jax.vmap(partial(mean_turn, physics))(jnp.arange(most))
    return _first(physics, chain, _share(askew - turned), way)


def fewest_steps_straight(
    physics: Physics, chain: Chain, target: Float[Array, "unit 2"], tolerance: float, most: int
) -> Int[Array, ""]:
    """Control steps before which a chain that stays straight, its units square to it, cannot have
    taken the target: shifting and turning together, from its direction to the target's.

    No bound for a chain that bends: it says how much bending saves. At most `most`.
    """
    length = chain.present.sum()
    way, ahead = least_way(physics, chain, target, tolerance)
    steps = jnp.arange(most)
    turned = jnp.asarray(jax.vmap(partial(angle_turned, physics, length))(steps))
    begun = _share(_askew(chain.units.angle[0], ahead) - turned)
    chord = jnp.take(target, length - 1, axis=0) - target[0]
    own = (length - 1) * physics.link_length  # m, from end to end
    slack = jnp.arcsin(jnp.minimum(2 * tolerance / own, 1.0))  # both ends off by the tolerance
    end = _askew(jnp.arctan2(chord[1], chord[0]), ahead) - slack
    fastest = turned[-1] - turned[-2]  # in a step

    def reaches(count: Array) -> Array:
        to_come = (count - steps) * fastest  # from any spin
        share = jnp.minimum(begun, _share(end - to_come))
        return _covered(physics, length, jnp.where(steps < count, share, 0.0))[count - 1] >= way

    there = jax.lax.map(reaches, jnp.arange(1, most))
    return jnp.where(there.any(), 1 + jnp.argmax(there), most).astype(jnp.int32)


def _askew(angle: Array, ahead: Float[Array, "2"]) -> Array:
    """Angle (rad), 0 to pi/2, between the line in which a unit pushes and a direction."""
    across = jnp.abs(-jnp.sin(angle) * ahead[0] + jnp.cos(angle) * ahead[1])
    return jnp.arccos(jnp.clip(across, 0.0, 1.0))


def _share(askew: Array) -> Array:
    """Share of a thrust that acts along the way, at an angle (rad) to it; all where negative."""
    return jnp.cos(jnp.maximum(askew, 0.0))


def _first(physics: Physics, chain: Chain, share: Array, way: Array) -> Int[Array, ""]:
    """The first control step after which the way (m) is covered."""
    covered = _covered(physics, chain.present.sum(), share)
    there = covered[:-1] >= way
    return jnp.where(there.any(), 1 + jnp.argmax(there), len(share)).astype(jnp.int32)


def _covered(physics: Physics, length: Array | int, share: Float[Array, " step"]) -> Array:
    """Farthest (m) from rest after each control step, if such a share of the thrust acts in it."""
    keep, time = 1 - physics.drag, physics.control_step
    gain = acceleration(physics, length) * time * share
    ramp = (physics.substeps + 1) / (2 * physics.substeps)

    def advance(speed: Array, gain: Array) -> tuple[Array, Array]:
        return keep * speed + gain, time * (keep * speed + gain * ramp)

    return jnp.cumsum(jax.lax.scan(advance, jnp.zeros(()), gain)[1])
