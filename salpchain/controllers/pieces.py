"""Pieces of a chain that came apart: where each is, and a law that brings it exactly in place."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from salpchain.physics.state import Chain, wrap

# All chosen
HOLD, CORRECTION = 5.0, 2.0  # N for each m/s: against drag, and of what a unit is too slow
FORWARD, TURNING, SHAPING = 2.0, 1.5, 2.0  # 1/s, speed for each metre, rate for each radian off
FASTEST = 0.15  # m/s, of a piece and of its ends
TILT, MOST_TILT = 8.0, 0.35  # rad for each metre that a piece is off its line; rad, at most
CLOSE = 0.01  # m, nearer than this it does not tilt any more


def ends(rank: Array, present: Array) -> tuple[Array, Array]:
    """The slots of the first and the last unit of each piece; 0 of empty ones."""
    slot, num = jnp.arange(len(rank)), len(rank)
    first = jax.ops.segment_min(jnp.where(present, slot, num), rank, num)
    last = jax.ops.segment_max(jnp.where(present, slot, -1), rank, num)
    return jnp.clip(first, 0, num - 1) * (last >= 0), jnp.maximum(last, 0)


def means(points: Array, rank: Array, present: Array) -> Float[Array, "piece 2"]:
    """The mean over the units of each piece."""
    weight = present.astype(points.dtype)
    number = jax.ops.segment_sum(weight, rank, len(rank))
    total = jax.ops.segment_sum(points * weight[:, None], rank, len(rank))
    return total / jnp.maximum(number, 1.0)[:, None]


def along(points: Array, ends: tuple[Array, Array]) -> Float[Array, " piece"]:
    """The direction (rad) from the first to the last of a piece's points."""
    x, y = (points[jnp.minimum(ends[1], len(points) - 1)] - points[ends[0]]).T
    return jnp.arctan2(y, x)


class Lie(NamedTuple):
    """How each unit's piece lies, and how far it is from its target points."""

    axis: Float[Array, "unit 2"]  # along the piece
    ahead: Float[Array, "unit 2"]  # across it, where it swims
    forward: Float[Array, " unit"]  # m, to the target, that way
    aside: Float[Array, " unit"]  # m, along the piece
    turn: Float[Array, " unit"]  # rad
    arm: Float[Array, "unit 2"]  # m, from the piece's middle
    shape: Float[Array, "unit 2"]  # m, what is left when the piece is there


def steered(
    chain: Chain, aim: Float[Array, "unit 2"], rank: Int[Array, " unit"]
) -> Float[Array, " unit"]:
    """Thrusts (N) that bring every piece to its target points (m), once it is near them.

    As a boat follows a line: a piece goes across its axis, turns into its final direction, and
    tilts while it goes on to make up for what it is off along its axis, where it has no thrust.
    """
    lie, units = _lie(chain, aim, rank), chain.units
    tilt = -jnp.clip(TILT * lie.aside, -MOST_TILT, MOST_TILT) * jnp.tanh(lie.forward / CLOSE)
    reach = jax.ops.segment_max(jnp.linalg.norm(lie.arm, axis=-1), rank, len(rank))[rank]
    most = FASTEST / jnp.maximum(reach, 0.02)
    rate = jnp.clip(TURNING * (lie.turn + tilt), -most, most)
    speed = jnp.clip(FORWARD * lie.forward, -FASTEST, FASTEST)
    heading = units.heading
    place = jnp.sum(lie.arm * lie.axis, axis=-1)
    straight = jnp.sum(lie.ahead * heading, axis=-1)
    bending = SHAPING * jnp.sum(lie.shape * heading, axis=-1)
    wanted = (speed + rate * place) * straight + bending
    now = jnp.sum(units.velocity * heading, axis=-1)
    hold = _against_drag(chain, lie, rank, speed, rate) * straight + HOLD * bending
    return jnp.where(chain.present, jnp.clip(hold + CORRECTION * (wanted - now), -1.0, 1.0), 0.0)


def _lie(chain: Chain, aim: Float[Array, "unit 2"], rank: Int[Array, " unit"]) -> Lie:
    units, present = chain.units, chain.present
    error, outer = aim - units.position, ends(rank, present)
    off, middle = (means(x, rank, present)[rank] for x in (error, units.position))
    alone = (outer[1] == outer[0])[rank]
    lies = jnp.where(alone, units.angle, along(units.position, outer)[rank])
    turn = jnp.where(alone, 0.0, wrap(along(aim, outer)[rank] - lies))
    axis = jnp.stack([jnp.cos(lies), jnp.sin(lies)], axis=-1)
    ahead = jnp.stack([-axis[:, 1], axis[:, 0]], axis=-1)
    forward, aside = (jnp.sum(off * x, axis=-1) for x in (ahead, axis))
    arm = units.position - middle
    across = jnp.stack([-arm[:, 1], arm[:, 0]], axis=-1)
    return Lie(axis, ahead, forward, aside, turn, arm, error - off - turn[:, None] * across)


def _against_drag(
    chain: Chain, lie: Lie, rank: Int[Array, " unit"], speed: Array, rate: Array
) -> Float[Array, " unit"]:
    """Thrusts (N) that hold a piece at a speed (m/s) and a rate of turn (rad/s).

    With the link that hangs on its end, by which its centre of mass is not its middle.
    """
    middle = chain.units.position - lie.arm
    place = jnp.sum(lie.arm * lie.axis, axis=-1)
    link = jnp.sum((chain.links.position - middle[:-1]) * lie.axis[:-1], axis=-1)

    def total(units: Array, links: Array) -> Array:
        both = jnp.where(chain.present, units, 0.0).at[:-1].add(jnp.where(chain.held, links, 0.0))
        return jax.ops.segment_sum(both, rank, len(rank))[rank]

    one = jnp.ones_like(place)
    number = jax.ops.segment_sum(chain.present.astype(place.dtype), rank, len(rank))[rank]
    mass, first, second = total(one, one[1:]), total(place, link), total(place**2, link**2)
    force = mass * speed + first * rate
    torque = first * speed + second * rate
    spread = jax.ops.segment_sum(jnp.where(chain.present, place**2, 0.0), rank, len(rank))[rank]
    return HOLD / 2 * (force / jnp.maximum(number, 1.0) + place * torque / (spread + 1e-4))
