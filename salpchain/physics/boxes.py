"""Geometry of two boxes: the closest points, whether they overlap, and how deep (VMAS 1.5.2).

Arrays have the batch last: vectors are (2, pair, batch). The first box of a pair is at the origin.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.derivatives import root
from salpchain.physics.joints import softplus
from salpchain.xla import materialise

SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # of the four corners


class Boxes(NamedTuple):
    """How two boxes lie; half sizes (m) are along and across a box's own axis."""

    half: Any
    other_half: Any
    offset: Float[Array, "2 pair batch"]  # m, from the centre of the first to that of the other
    turn: Float[Array, "2 pair batch"]  # cosine and sine of the first box's angle
    other_turn: Float[Array, "2 pair batch"]


def repulsion(physics: Any, gap: Array) -> Array:
    """Size (N) of the force between two surfaces that are this far (m) apart, and nearer than the
    contact gap."""
    return physics.contact_stiffness * physics.softness * _soft_depth(physics, gap)


def _soft_depth(physics: Any, gap: Array) -> Array:
    return softplus(jnp.maximum(physics.contact_gap - gap, 0.0) / physics.softness)


def closest_points(boxes: Boxes, never: Any) -> tuple[Array, Array, Array]:
    """Gap, point on the box at the origin, and the unit vector from the other's point to it.

    The closest points of two separate convex polygons are a corner of one and a point of the other.
    Each corner of either box is paired with the nearest point of the other; the closest pair of
    the eight counts. Which one that is, is found first: with all eight at hand a CPU would work
    each out anew for every number that is needed of the closest.
    """
    squares = [square(_corner_pair(boxes, k // 4 == 0, *SIGNS[k % 4])[1]) for k in range(8)]
    least, which = squares[0], jnp.zeros(squares[0].shape, jnp.int32)
    for k, value in enumerate(squares[1:], 1):
        which, least = jnp.where(value < least, k, which), jnp.minimum(value, least)
    which = materialise(which, never)
    corner = which % 4
    signs = jnp.where(corner < 2, 1.0, -1.0), jnp.where(corner % 3 == 0, 1.0, -1.0)
    (own, own_between), (far, far_between) = (
        _corner_pair(boxes, mine, *signs) for mine in (True, False)
    )
    here, between = materialise(
        (jnp.where(which < 4, own, far), jnp.where(which < 4, own_between, far_between)), never
    )
    gap = root(square(between))
    return gap, here, between / jnp.maximum(gap, 1e-9)


def _corner_pair(boxes: Boxes, mine: bool, along: Any, across: Any) -> tuple[Array, Array]:
    """A corner, of the box at the origin or of the other, and the nearest point of the other box.

    Given as the point on the box at the origin and the vector to it from the point on the other.
    """
    half, other_half, offset, turn, other_turn = boxes
    if mine:
        here = to_world((half[0] * along, half[1] * across), turn)
        nearest = _clamp(other_half, to_box(here - offset, other_turn))
        there = offset + to_world(nearest, other_turn)
    else:
        corner = (other_half[0] * along, other_half[1] * across)
        there = offset + to_world(corner, other_turn)
        here = to_world(_clamp(half, to_box(there, turn)), turn)
    return here, here - there


def overlap(boxes: Boxes) -> Bool[Array, "pair batch"]:
    """Whether two boxes overlap: no side of either separates them."""
    inside = jnp.ones_like(boxes.turn[0], dtype=bool)
    for _, place, reach in _axes(boxes):
        inside &= (jnp.abs(place[0]) < reach[0]) & (jnp.abs(place[1]) < reach[1])
    return inside


def _axes(boxes: Boxes) -> list[tuple[Array, Array, tuple[Array, Array]]]:
    """For each box its turn, the offset in its axes (m), and how far apart (m) the centres must be
    along either axis for the two boxes to be apart."""
    half, other_half, offset, turn, other_turn = boxes
    cosine = jnp.abs(turn[0] * other_turn[0] + turn[1] * other_turn[1])
    sine = jnp.abs(turn[0] * other_turn[1] - turn[1] * other_turn[0])
    found = []
    for axes, own, far in ((turn, half, other_half), (other_turn, other_half, half)):
        along = own[0] + far[0] * cosine + far[1] * sine
        across = own[1] + far[0] * sine + far[1] * cosine
        found.append((axes, to_box(offset, axes), (along, across)))
    return found


def deepest_points(boxes: Boxes) -> tuple[Array, Array, Array]:
    """Depth (m) of two boxes that overlap, a point on the first, and the way out for the first.

    The depth is the shortest way on which the first leaves the other: along a normal of one of
    their sides. The point is that corner of the one box which is deepest in that side of the other.
    """
    depth = jnp.full_like(boxes.turn[0], jnp.inf)
    normal = point = jnp.zeros_like(boxes.offset)
    for mine, (axes, place, reach) in zip((True, False), _axes(boxes), strict=True):
        for k, axis in enumerate((axes, jnp.stack([-axes[1], axes[0]]))):
            out = jnp.where(place[k] > 0, -axis, axis)
            here = _corner_towards(boxes, mine, out)
            way = reach[k] - jnp.abs(place[k])
            nearer = way < depth
            depth = jnp.where(nearer, way, depth)
            normal, point = jnp.where(nearer, out, normal), jnp.where(nearer, here, point)
    return depth, point, normal


def _corner_towards(boxes: Boxes, mine: bool, out: Array) -> Array:
    """The corner of the other box that is deepest in the first's side, if the side is `mine`; else
    that of the first in the other's. As a point on the first box.
    """
    half, other_half, offset, turn, other_turn = boxes
    if not mine:
        towards = to_box(-out, turn)
        return to_world([half[k] * _sign(towards[k]) for k in (0, 1)], turn)
    towards = to_box(out, other_turn)
    corner = [other_half[k] * _sign(towards[k]) for k in (0, 1)]
    # where sides are parallel any point of them is as deep, and a long wall's corner is far away
    return to_world(_clamp(half, to_box(offset + to_world(corner, other_turn), turn)), turn)


def _sign(x: Array) -> Array:
    return jnp.where(x < 0, -1.0, 1.0)


def square(vector: Array) -> Array:
    """The square of its length."""
    return vector[0] ** 2 + vector[1] ** 2


def cross(one: Array, other: Array) -> Array:
    """The cross product of two vectors in the plane."""
    return one[0] * other[1] - one[1] * other[0]


def to_world(point: Any, turn: Array) -> Array:
    """A vector in a box's axes, in those of the world."""
    return jnp.stack(
        [point[0] * turn[0] - point[1] * turn[1], point[0] * turn[1] + point[1] * turn[0]]
    )


def to_box(point: Array, turn: Array) -> Array:
    """A vector in the axes of the world, in those of a box."""
    return jnp.stack(
        [point[0] * turn[0] + point[1] * turn[1], point[1] * turn[0] - point[0] * turn[1]]
    )


def _clamp(half: Any, point: Array) -> Array:
    return jnp.stack([jnp.clip(point[i], -half[i], half[i]) for i in (0, 1)])
