"""Contact of units: boxes that repel when closer than a small gap (VMAS 1.5.2).

Arrays have the batch last: vectors are (2, unit, batch) or (2, pair, batch). Each chain has a list
of pairs of units that may touch.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from salpchain.physics.derivatives import root
from salpchain.physics.joints import softplus
from salpchain.physics.substeps import Load, Motion
from salpchain.xla import once

SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # of the four corners


class Pairs(NamedTuple):
    """Units that may touch, in lists that are gone through one by one.

    A pair of a unit with itself fills up a list.
    """

    first: Int[Array, "list pair batch"]
    second: Int[Array, "list pair batch"]
    lists: Int[Array, ""] | int  # that hold any pairs; they come first


def touching_distance(physics: Any) -> Any:
    """Distance of centres (m) above which two units never touch: VMAS compares bounding circles."""
    return jnp.sqrt(physics.unit_length**2 + physics.unit_width**2)


def contact_load(rig: Any, pairs: Pairs, units: Motion) -> Load:
    """What the units of each pair exert on each other, summed over pairs for every unit.

    Shapes are looked at only where some pair is near.
    """
    turn = _turn(units)

    def load(some: Listed) -> Array:
        boxes = some.offset, _at(turn, some.first), _at(turn, some.second)
        force, first, second = _box_against_box(rig.physics, *boxes, some.never)
        loads = jnp.stack([*force, first]), jnp.stack([*-force, second])
        return _sum_for_units(some, units.angle, *(jnp.where(some.near, x, 0.0) for x in loads))

    def add(index: Array, total: Array) -> Array:
        some = _listed(rig, pairs, units, index)
        return jax.lax.cond(some.near.any(), lambda: total + load(some), lambda: total)

    nothing = jnp.zeros((3, *units.angle.shape))
    total = jax.lax.fori_loop(0, pairs.lists, add, nothing)
    return Load(total[:2], total[2])


class Listed(NamedTuple):
    """The pairs of one list, and how they lie."""

    first: Int[Array, "pair batch"]
    second: Int[Array, "pair batch"]
    offset: Float[Array, "2 pair batch"]  # m, from first to second
    near: Bool[Array, "pair batch"]  # bounding circles meet, as VMAS has it

    @property
    def never(self) -> Bool[Array, ""]:
        """False, for `once`."""
        return self.near.sum() < 0


def _listed(rig: Any, pairs: Pairs, units: Motion, index: Array) -> Listed:
    first, second = pairs.first[index], pairs.second[index]
    offset = _at(units.position, second) - _at(units.position, first)
    near = _square(offset) <= touching_distance(rig.physics) ** 2
    return Listed(first, second, offset, near & (first != second))


def _turn(units: Motion) -> Float[Array, "2 unit batch"]:
    return jnp.stack([jnp.cos(units.angle), jnp.sin(units.angle)])


def _at(x: Shaped[Array, "*xy unit batch"], index: Int[Array, "pair batch"]) -> Array:
    """The rows of each chain's units, with the coordinates in front if there are any."""
    if x.ndim == 3:
        return jnp.stack([_at(row, index) for row in x])
    return jnp.take_along_axis(x, index, axis=0)


def _sum_for_units(
    some: Listed, like: Array, first: Array, second: Array
) -> Float[Array, "3 unit batch"]:
    """For each unit, the sum of what its pairs give it, (3, pair, batch) to either unit."""
    num, batch = like.shape
    unit = jnp.concatenate([some.first, some.second])
    given = jnp.moveaxis(jnp.concatenate([first, second], axis=1), 0, -1)
    total = jnp.zeros((num, batch, 3)).at[unit, jnp.arange(batch)].add(given)
    return jnp.moveaxis(total, -1, 0)


def _box_against_box(
    physics: Any, offset: Array, turn: Array, other_turn: Array, never: Any = False
) -> tuple[Float[Array, "2 pair batch"], Float[Array, "pair batch"], Float[Array, "pair batch"]]:
    """Force (N) on a box at the origin by a box of the same size at `offset`, and torques (N m).

    The other box feels the opposite force. The torques are that on the first box and that on the
    second. The closest points of two separate convex polygons are a corner of one and a point of
    the other. Boxes whose sides cross exert nothing on each other: VMAS finds the same point twice.
    """
    half = (physics.unit_length / 2, physics.unit_width / 2)
    gap, here, normal = _closest(half, offset, turn, other_turn, never)
    size = physics.contact_stiffness * physics.softness * _soft_depth(physics, gap)
    acts = (gap <= physics.contact_gap) & ~_overlap(half, offset, turn, other_turn)
    force = jnp.where(acts, size, 0.0) * normal
    there = here - gap * normal - offset
    return force, _cross(here, force), -_cross(there, force)


def _cross(one: Array, other: Array) -> Array:
    return one[0] * other[1] - one[1] * other[0]


def _soft_depth(physics: Any, gap: Array) -> Array:
    return softplus(jnp.maximum(physics.contact_gap - gap, 0.0) / physics.softness)


def _closest(
    half: Any, offset: Array, turn: Array, other_turn: Array, never: Any
) -> tuple[Array, Array, Array]:
    """Gap, point on the box at the origin, and the unit vector from the other's point to it.

    Each corner of either box is paired with the nearest point of the other; the closest pair of
    the eight counts. Which one that is, is found first: with all eight at hand a CPU would work
    each out anew for every number that is needed of the closest.
    """
    place = (half, offset, turn, other_turn)
    squares = [_square(_corner_pair(*place, k // 4 == 0, *SIGNS[k % 4])[1]) for k in range(8)]
    least, which = squares[0], jnp.zeros(squares[0].shape, jnp.int32)
    for k, square in enumerate(squares[1:], 1):
        which, least = jnp.where(square < least, k, which), jnp.minimum(square, least)
    which = once(which, never)
    corner = which % 4
    signs = jnp.where(corner < 2, 1.0, -1.0), jnp.where(corner % 3 == 0, 1.0, -1.0)
    (own, own_between), (far, far_between) = (
        _corner_pair(*place, mine, *signs) for mine in (True, False)
    )
    here, between = once(
        (jnp.where(which < 4, own, far), jnp.where(which < 4, own_between, far_between)), never
    )
    gap = root(_square(between))
    return gap, here, between / jnp.maximum(gap, 1e-9)


def _corner_pair(
    half: Any, offset: Array, turn: Array, other_turn: Array, mine: bool, along: Any, across: Any
) -> tuple[Array, Array]:
    """A corner, of the box at the origin or of the other, and the nearest point of the other box.

    Given as the point on the box at the origin and the vector to it from the point on the other.
    """
    corner = (half[0] * along, half[1] * across)
    if mine:
        here = _to_world(corner, turn)
        there = offset + _to_world(_clamp(half, _to_box(here - offset, other_turn)), other_turn)
    else:
        there = offset + _to_world(corner, other_turn)
        here = _to_world(_clamp(half, _to_box(there, turn)), turn)
    return here, here - there


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
