"""What no controller can beat: how far a chain gets from rest in a given time.

Joints and contact push both bodies alike, so only thrust and drag move the centre of mass of all
units and links. Drag multiplies its velocity by 1 - drag once at the start of a control step; the
thrusts, at most one newton each, then add to it in every substep, before the position moves. Drag
is relative to the water, which carries a chain along.

Other dynamics (`salpchain.dynamics`) tell their own top speed, which bounds the way of the units'
centroid from the first moment on: less sharp, but never too low.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from salpchain.dynamics.robot import Dynamics
from salpchain.physics.state import Chain, Physics, Scalar

MOST_THRUST = 1.0  # N, of a unit


class Means(NamedTuple):
    """What moves a chain: its thrusters and the water."""

    thrust: Scalar = 1.0  # that of all units together, as a share of `MOST_THRUST` for each
    flow: Float[Array, "2"] | None = None  # m/s, of the water everywhere
    stir: Scalar = 0.0  # m/s, that the water may have besides, anywhere and in any direction


WHOLE = Means()


def acceleration(physics: Physics, length: int | Array) -> Scalar:
    """Largest acceleration (m/s2) of a chain's centre of mass: all units thrust one way."""
    return length * MOST_THRUST / _mass(physics, length)


def top_speed(physics: Physics, length: int | Array) -> Scalar:
    """Speed (m/s) of the centre of mass that no chain exceeds: that at the end of a control step.

    v = (1 - drag) v + a T in the steady state, a the acceleration and T the control step.
    Infinite without drag.
    """
    if isinstance(physics, Dynamics):
        return physics.top_speed(length)
    if isinstance(physics.drag, int | float) and physics.drag == 0:
        return float("inf")
    return acceleration(physics, length) * physics.control_step / physics.drag


def cruising_speed(physics: Physics, length: int | Array) -> Scalar:
    """Mean speed (m/s) over a control step in the steady state of full thrust."""
    if isinstance(physics, Dynamics):
        return physics.top_speed(length)
    gain = acceleration(physics, length) * physics.control_step
    return (1 - physics.drag) * top_speed(physics, length) + gain * _mean_of_ramp(physics)


def distance_covered(physics: Physics, length: int | Array, steps: int | Array) -> Scalar:
    """Farthest (m) that the centre of mass gets from rest in so many control steps.

    In step j the velocity starts from (1 - drag) v and grows by a dt in each of S substeps, so
    the chain moves T (1 - drag) v_(j-1) + a T^2 (S + 1) / (2 S), where v_j is a T times the sum
    of (1 - drag)^i over i < j.
    """
    if isinstance(physics, Dynamics):
        return steps * physics.control_step * physics.top_speed(length)
    return _covered(physics, acceleration(physics, length), steps)


def angle_turned(physics: Physics, length: int | Array, steps: int | Array) -> Scalar:
    """Farthest (rad) that a chain which stays straight turns from rest in so many control steps.

    All units thrust one way round its middle. Drag slows turning as it slows swimming, so the
    angle grows as the distance covered does.
    """
    if isinstance(physics, Dynamics):
        return steps * physics.control_step * physics.top_spin(length)
    link, squares = physics.link_length, length * (length**2 - 1) / 12  # of units' places, in links
    torque = MOST_THRUST * link * (length**2 // 4)
    units = length * physics.unit_inertia + physics.unit_mass * link**2 * squares
    between = (length - 1) * length * (length - 2) / 12  # as `squares`, of the links' middles
    links = (length - 1) * physics.link_inertia + physics.link_mass * link**2 * between
    return _covered(physics, torque / (units + links), steps)


def _covered(physics: Physics, acceleration: Scalar, steps: int | Array) -> Scalar:
    """Way from rest in so many control steps under a constant acceleration (1/s2) and drag."""
    step, keep = physics.control_step, 1 - physics.drag
    gain = acceleration * step
    glide = keep * gain * _sum_of_sums(keep, steps)
    return step * (glide + steps * gain * _mean_of_ramp(physics))


def centroid_slack(physics: Physics, length: int | Array) -> Scalar:
    """How far (m) the units' centroid may be from the centre of mass of units and links.

    The end units have one link instead of two, so the centre of mass keeps away from the point
    halfway between them, farthest when the chain is folded like a hairpin: about an eighth of a
    link, at any length.
    """
    if isinstance(physics, Dynamics):
        return 0.0
    hairpin = _bond(physics, length) * ((length - 1) ** 2 // 2) / (2 * length)
    shift = hairpin + (length - 1) * physics.softness
    return physics.link_mass * shift / _mass(physics, length)


def least_distance(
    physics: Physics, chain: Chain, target: Float[Array, "unit 2"], steps: int | Array
) -> Float[Array, ""]:
    """Smallest mean distance (m) to its target points that the chain, at rest, can come to.

    The mean of distances is at least the distance of the means, and the mean of the units moves
    with the centre of mass. For a whole chain: every link between present units is joined.
    """
    length = chain.present.sum()
    apart = jnp.linalg.norm(_mean(chain, target) - centre_of_mass(physics, chain))
    reach = distance_covered(physics, length, steps) + centroid_slack(physics, length)
    return jnp.maximum(apart - reach, 0.0)


def drift(physics: Physics, steps: int | Array) -> Scalar:
    """Way (m) for each m/s of the water that it carries a chain, at rest, in so many control steps.

    Relative to the water the chain is as fast at first as the water, and loses that as all else.
    """
    if isinstance(physics, Dynamics):
        return physics.control_step * steps
    keep = 1 - physics.drag
    lost = jnp.where(keep == 1, 1.0, 1 - keep)
    caught_up = jnp.where(keep == 1, steps, keep * (1 - keep**steps) / lost)
    return physics.control_step * (steps - caught_up)


def reachable(
    physics: Physics,
    chain: Chain,
    target: Float[Array, "unit 2"],
    steps: int | Array,
    means: Means = WHOLE,
    most: int = 0,
) -> Float[Array, ""]:
    """Largest closed fraction that any controller can have within so many control steps after rest.

    `most` bounds the steps where the water flows.
    """
    each = jnp.linalg.norm(target - chain.units.position, axis=-1)
    distance = jnp.where(chain.present, each, 0.0).sum() / chain.present.sum()
    if means is WHOLE:
        return 1.0 - least_distance(physics, chain, target, steps) / distance
    apart, length = _mean(chain, target) - centre_of_mass(physics, chain), chain.present.sum()

    def left(step: Array) -> Array:
        way = apart if means.flow is None else apart - means.flow * drift(physics, step)
        return jnp.linalg.norm(way) - _own_way(physics, length, means, step)

    at = jnp.minimum(jnp.arange(most + 1), steps)
    least = jax.vmap(left)(at).min() - centroid_slack(physics, length)
    return 1.0 - jnp.maximum(least, 0.0) / distance


def _own_way(physics: Physics, length: Any, means: Means, steps: int | Array) -> Scalar:
    """Farthest (m) that thrust and stirred water move the centre of mass in any one direction."""
    if isinstance(physics, Dynamics):
        return distance_covered(physics, length, steps) + means.stir * drift(physics, steps)
    thrust = means.thrust * acceleration(physics, length)
    return _covered(physics, thrust, steps) + means.stir * drift(physics, steps)


def fewest_steps(
    physics: Physics,
    chain: Chain,
    target: Float[Array, "unit 2"],
    tolerance: float,
    most: int,
    means: Means = WHOLE,
) -> Int[Array, ""]:
    """Control steps before which the chain, at rest, cannot have taken the target (`reached`).

    A bound for any way of taking it that the discrete Frechet distance allows, within the tolerance
    (m). Turning and bending, which take time too, are not counted: a folded chain turns as fast as
    it likes (`steps_to_turn` has the time that a straight one takes). At most `most`.
    """
    gap, ahead = least_way(physics, chain, target, tolerance)
    if means is WHOLE:
        return _first(partial(distance_covered, physics, chain.present.sum()), gap, most)

    def covered(step: Array) -> Scalar:
        own = _own_way(physics, chain.present.sum(), means, step)
        return own if means.flow is None else own + drift(physics, step) * (means.flow @ ahead)

    there = jax.vmap(covered)(jnp.arange(1, most)) >= gap
    return jnp.where(there.any(), 1 + jnp.argmax(there), most).astype(jnp.int32)


def least_way(
    physics: Physics, chain: Chain, target: Float[Array, "unit 2"], tolerance: float
) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Shortest way (m) of the centre of mass to where the target may be taken, negative if there,
    and its direction.

    The coupling of the Frechet distance joins the end units with the end points. Any other unit it
    may join with a point that is not its own, but with none that is farther from an end than the
    bonds between it and that end allow. So the way is told from how far ahead, in the direction of
    the whole target, each unit must come at least.
    """
    length, slots = chain.present.sum(), len(target)
    ends = jnp.stack([0, length - 1])[:, None]
    origin = centre_of_mass(physics, chain)
    gap = _mean(chain, target) - origin
    direction = gap / jnp.maximum(jnp.linalg.norm(gap), physics.softness)
    ahead = (target - origin) @ direction
    hops = jnp.abs(jnp.arange(slots) - ends)
    hanging = hops * _bond(physics, length)  # m, (end, unit)
    leash = jnp.where(hops > 0, hanging + 2 * tolerance, 0.0)
    apart = jnp.linalg.norm(target - target[ends], axis=-1)  # m, (end, point)
    near = (apart[:, None, :] <= leash[:, :, None]).all(axis=0) & chain.present  # (unit, point)
    joined = near | jnp.eye(slots, dtype=bool)  # of an end, no other; rounding may not see its own
    nearest = jnp.where(joined, ahead, jnp.inf).min(axis=-1)
    least = jnp.maximum(nearest, (ahead[ends] - hanging).max(axis=0))
    mean = jnp.where(chain.present, least, 0.0).sum() / length
    return mean - tolerance - centroid_slack(physics, length), direction


def steps_to_turn(
    physics: Physics, length: int | Array, turn: Float[Array, ""], tolerance: float, most: int
) -> Int[Array, ""]:
    """Control steps before which a chain that stays straight cannot have turned by `turn` (rad).

    Its end units may be off by the tolerance (m). Unlike `fewest_steps` this is no bound for a
    chain that bends. At most `most`.
    """
    half = (length - 1) * physics.link_length / 2
    left = turn - 2 * jnp.arcsin(jnp.minimum(tolerance / (2 * half), 1.0))
    return _first(partial(angle_turned, physics, length), left, most)


def _first(covered: Callable[[Array], Any], way: Float[Array, ""], most: int) -> Int[Array, ""]:
    """The first control step after which that way is covered, 1 to `most`."""
    return 1 + (jax.vmap(covered)(jnp.arange(1, most)) < way).sum(dtype=jnp.int32)


def centre_of_mass(physics: Physics, chain: Chain) -> Float[Array, "2"]:
    """The centre of mass of all units and links (m)."""
    if isinstance(physics, Dynamics):
        return _mean(chain, chain.units.position)
    present, joined = chain.present[:, None], chain.held[:, None]
    units = physics.unit_mass * jnp.where(present, chain.units.position, 0.0).sum(axis=0)
    links = physics.link_mass * jnp.where(joined, chain.links.position, 0.0).sum(axis=0)
    return (units + links) / _mass(physics, chain.present.sum())


def _mean(chain: Chain, points: Float[Array, "unit 2"]) -> Float[Array, "2"]:
    """Mean over the present units."""
    return jnp.where(chain.present[:, None], points, 0.0).sum(axis=0) / chain.present.sum()


def _bond(physics: Physics, length: int | Array) -> Scalar:
    """Longest (m) that a link gets with its two joints, each pulled by half the chain's thrust."""
    if isinstance(physics, Dynamics):
        return physics.link_length
    give = length * MOST_THRUST / (2 * physics.joint_stiffness) + physics.softness
    return physics.link_length + 2 * give


def _mass(physics: Physics, length: int | Array) -> Scalar:
    return length * physics.unit_mass + (length - 1) * physics.link_mass


def _mean_of_ramp(physics: Physics) -> float:
    """Mean of 1/S, 2/S, ..., 1: the share of a step's gain that its substeps have on average."""
    return (physics.substeps + 1) / (2 * physics.substeps)


def _sum_of_sums(keep: Scalar, count: int | Array) -> Scalar:
    """Sum over j < count of the sum over i < j of keep^i."""
    whole = count * (count - 1) / 2  # without drag
    if isinstance(keep, int | float):
        return whole if keep == 1 else (count - (1 - keep**count) / (1 - keep)) / (1 - keep)
    lost = jnp.where(keep == 1, 1.0, 1 - keep)
    return jnp.where(keep == 1, whole, (count - (1 - keep**count) / lost) / lost)
