"""Contact of units: boxes that repel when closer than a small gap (VMAS 1.5.2).

Arrays have the batch last: vectors are (2, unit, batch). Each unit has a list of partners, others
that it may touch, and sums what they exert on it.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from salpchain.physics.engine import Load, Motion
from salpchain.physics.joints import softplus

SIGNS = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, -1.0, 1.0]])  # of the four corners


def touching_distance(physics: Any) -> Any:
    """Distance of centres (m) above which two units never touch: VMAS compares bounding circles."""
    return jnp.sqrt(physics.unit_length**2 + physics.unit_width**2)


def contact_load(rig: Any, partner: Int[Array, "partner unit batch"], units: Motion) -> Load:
    """What their partners exert on all units; the shapes are looked at only where some are near."""
    offset, near = _near(rig, partner, units)

    def load() -> Load:
        force, torque = _box_against_box(rig.physics, offset, *_turns(partner, units))
        force, torque = jnp.where(near, force, 0.0), jnp.where(near, torque, 0.0)
        return Load(force.sum(axis=1), torque.sum(axis=0))

    def nothing() -> Load:
        return Load(jnp.zeros_like(units.position), jnp.zeros_like(units.angle))

    return jax.lax.cond(near.any(), load, nothing)


def meet(
    rig: Any, partner: Int[Array, "partner unit batch"], units: Motion
) -> Bool[Array, " batch"]:
    """Chains in which the boxes of a unit and a partner are closer than the gap, or overlap."""
    offset, near = _near(rig, partner, units)
    half = (rig.physics.unit_length / 2, rig.physics.unit_width / 2)
    boxes = (half, offset, *_turns(partner, units))
    close = (_closest(*boxes)[0] <= rig.physics.contact_gap) | _overlap(*boxes)
    return (near & close).any(axis=(0, 1))


def _near(rig: Any, partner: Array, units: Motion) -> tuple[Array, Array]:
    """Offsets (m) of the partners, and whether bounding circles meet: VMAS looks no further."""
    other = jnp.stack([_at(x, partner) for x in units.position])
    offset = other - units.position[:, None]
    near = rig.present & _at(rig.present, partner) & (partner != _own(partner))
    return offset, near & (_square(offset) <= touching_distance(rig.physics) ** 2)


def _turns(partner: Array, units: Motion) -> tuple[Array, Array]:
    """Cosines and sines of the units' angles, and of their partners'."""
    turn = jnp.stack([jnp.cos(units.angle), jnp.sin(units.angle)])
    return turn[:, None], jnp.stack([_at(x, partner) for x in turn])


def _at(x: Shaped[Array, "unit batch"], partner: Int[Array, "partner unit batch"]) -> Array:
    return jax.vmap(lambda p: jnp.take_along_axis(x, p, axis=0))(partner)


def _own(partner: Int[Array, "partner unit batch"]) -> Array:
    return jnp.arange(partner.shape[1])[:, None]


def _box_against_box(
    physics: Any, offset: Array, turn: Array, other_turn: Array
) -> tuple[Float[Array, "2 partner unit batch"], Float[Array, "partner unit batch"]]:
    """Force (N) and torque (N m) on a box at the origin, by a box of the same size at `offset`.

    The closest points of two separate convex polygons are a corner of one and a point of the
    other. Boxes whose sides cross exert nothing on each other: VMAS finds the same point twice.
    """
    half = (physics.unit_length / 2, physics.unit_width / 2)
    best = _closest(half, offset, turn, other_turn)
    gap, here, normal = best
    size = physics.contact_stiffness * physics.softness * _soft_depth(physics, gap)
    acts = (gap <= physics.contact_gap) & ~_overlap(half, offset, turn, other_turn)
    force = jnp.where(acts, size, 0.0) * normal
    return force, here[0] * force[1] - here[1] * force[0]


def _soft_depth(physics: Any, gap: Array) -> Array:
    return softplus(jnp.maximum(physics.contact_gap - gap, 0.0) / physics.softness)


def _closest(
    half: Any, offset: Array, turn: Array, other_turn: Array
) -> tuple[Array, Array, Array]:
    """Gap, point on the box at the origin, and the unit vector from the other's point to it.

    Each corner of either box is paired with the nearest point of the other; the closest pair of
    the eight counts. Candidates are a new axis behind the coordinates.
    """
    corner = jnp.stack([half[i] * SIGNS[i].reshape(4, 1, 1, 1) for i in (0, 1)])
    offset, turn, other_turn = (x[:, None] for x in (offset, turn, other_turn))
    theirs = offset + _to_world(corner, other_turn)
    mine = jnp.broadcast_to(_to_world(corner, turn), theirs.shape)
    on_theirs = offset + _to_world(_clamp(half, _to_box(mine - offset, other_turn)), other_turn)
    on_mine = _to_world(_clamp(half, _to_box(theirs, turn)), turn)
    here = jnp.concatenate([mine, on_mine], axis=1)
    between = here - jnp.concatenate([on_theirs, theirs], axis=1)
    square = _square(between)
    least = square.min(axis=0)
    pick = (square == least) & (jnp.cumsum(square == least, axis=0) == 1)
    here, between = (jnp.where(pick, x, 0.0).sum(axis=1) for x in (here, between))
    gap = jnp.sqrt(least)
    return gap, here, between / jnp.maximum(gap, 1e-9)


def _square(vector: Array) -> Array:
    return vector[0] ** 2 + vector[1] ** 2


def _to_world(point: Any, turn: Array) -> Array:
    return jnp.stack(
        [point[0] * turn[0] - point[1] * turn[1], point[0] * turn[1] + point[1] * turn[0]]
    )


def _to_box(point: Array, turn: Array) -> Array:
    return jnp.stack(
        [point[0] * turn[0] + point[1] * turn[1], point[1] * turn[0] - point[0] * turn[1]]
    )


def _clamp(half: Any, point: Array) -> Array:
    return jnp.stack([jnp.clip(point[i], -half[i], half[i]) for i in (0, 1)])


def _overlap(half: Any, offset: Array, turn: Array, other_turn: Array) -> Array:
    """Whether two boxes of the same size overlap: no side of either separates them."""
    cosine = jnp.abs(turn[0] * other_turn[0] + turn[1] * other_turn[1])
    sine = jnp.abs(turn[0] * other_turn[1] - turn[1] * other_turn[0])
    along = half[0] + half[0] * cosine + half[1] * sine
    across = half[1] + half[0] * sine + half[1] * cosine
    inside = jnp.ones_like(cosine, dtype=bool)
    for box in (turn, other_turn):
        place = _to_box(offset, box)
        inside &= (jnp.abs(place[0]) < along) & (jnp.abs(place[1]) < across)
    return inside
