"""Geometry of two boxes: the closest points, whether they overlap, and how deep (VMAS 1.5.2).

Vectors are pairs of arrays, x and y: a CPU works on each in one pass, where stacked coordinates
would cut it into many. The first box of a pair is at the origin.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.derivatives import root
from salpchain.physics.joints import softplus
from salpchain.xla import materialise

Vector = Sequence[Any] | Array  # x and y
SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # of the four corners


class Boxes(NamedTuple):
    """How two boxes lie; half sizes (m) are along and across a box's own axis."""

    half: Vector
    other_half: Vector
    offset: Vector  # m, from the centre of the first to that of the other
    turn: Vector  # cosine and sine of the first box's angle
    other_turn: Vector


def repulsion(physics: Any, gap: Array) -> Array:
    """Size (N) of the force between two surfaces that are this far (m) apart, and nearer than the
    contact gap."""
    depth = softplus(jnp.maximum(physics.contact_gap - gap, 0.0) / physics.softness)
    return physics.contact_stiffness * physics.softness * depth


def closest_points(boxes: Boxes, never: Any) -> tuple[Vector, Vector]:
    """The point on the first box, and the vector to it from the point on the other.

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
    corner, mine = which % 4, which < 4
    signs = jnp.where(corner < 2, 1.0, -1.0), jnp.where(corner % 3 == 0, 1.0, -1.0)
    own, far = (_corner_pair(boxes, of_first, *signs) for of_first in (True, False))
    here, between = (_choose(mine, *pair) for pair in zip(own, far, strict=True))
    return materialise((here, between), never)


def _corner_pair(boxes: Boxes, mine: bool, along: Any, across: Any) -> tuple[Vector, Vector]:
    """A corner, of the first box or of the other, and the nearest point of the other box.

    Given as the point on the first box and the vector to it from the point on the other.
    """
    half, other_half, offset, turn, other_turn = boxes
    if mine:
        here = from_box((half[0] * along, half[1] * across), turn)
        place = here[0] - offset[0], here[1] - offset[1]
        nearest = from_box(_clamp(other_half, to_box(place, other_turn)), other_turn)
        there = offset[0] + nearest[0], offset[1] + nearest[1]
    else:
        corner = from_box((other_half[0] * along, other_half[1] * across), other_turn)
        there = offset[0] + corner[0], offset[1] + corner[1]
        here = from_box(_clamp(half, to_box(there, turn)), turn)
    return here, (here[0] - there[0], here[1] - there[1])


def _choose(flag: Array, one: Vector, other: Vector) -> Vector:
    return jnp.where(flag, one[0], other[0]), jnp.where(flag, one[1], other[1])


def unit_vector(between: Vector) -> tuple[Array, Vector]:
    """Its length, and the vector of length 1 that points as it does; none of no length."""
    gap = root(square(between))
    scale = 1 / jnp.maximum(gap, 1e-9)
    return gap, (between[0] * scale, between[1] * scale)


def overlap(boxes: Boxes) -> Bool[Array, "*pair"]:
    """Whether two boxes overlap: no side of either separates them."""
    inside: Any = True
    for _, place, reach in _axes(boxes):
        inside &= (jnp.abs(place[0]) < reach[0]) & (jnp.abs(place[1]) < reach[1])
    return inside


def _axes(boxes: Boxes) -> list[tuple[Vector, Vector, Vector]]:
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


def deepest_points(boxes: Boxes) -> tuple[Float[Array, "*pair"], Vector, Vector]:
    """Depth (m) of two boxes that overlap, a point on the first, and the way out for the first.

    The depth is the shortest way on which the first leaves the other: along a normal of one of
    their sides. The point is that corner of the one box which is deepest in that side of the other.
    """
    none = jnp.zeros_like(boxes.turn[0])
    depth, normal, point = jnp.full_like(none, jnp.inf), (none, none), (none, none)
    for mine, (axes, place, reach) in zip((True, False), _axes(boxes), strict=True):
        for k, axis in enumerate((axes, (-axes[1], axes[0]))):
            flip = jnp.where(place[k] > 0, -1.0, 1.0)
            out = axis[0] * flip, axis[1] * flip
            here = _corner_towards(boxes, mine, out)
            way = reach[k] - jnp.abs(place[k])
            nearer = way < depth
            depth = jnp.where(nearer, way, depth)
            normal, point = _choose(nearer, out, normal), _choose(nearer, here, point)
    return depth, point, normal


def _corner_towards(boxes: Boxes, mine: bool, out: Vector) -> Vector:
    """The corner of the other box that is deepest in the first's side, if the side is `mine`; else
    that of the first in the other's. As a point on the first box.
    """
    half, other_half, offset, turn, other_turn = boxes
    if not mine:
        towards = to_box(out, turn)
        return from_box([half[k] * -_sign(towards[k]) for k in (0, 1)], turn)
    towards = to_box(out, other_turn)
    corner = from_box([other_half[k] * _sign(towards[k]) for k in (0, 1)], other_turn)
    # where sides are parallel any point of them is as deep, and a long wall's corner is far away
    place = to_box((offset[0] + corner[0], offset[1] + corner[1]), turn)
    return from_box(_clamp(half, place), turn)


def _sign(x: Array) -> Array:
    return jnp.where(x < 0, -1.0, 1.0)


def square(vector: Any) -> Array:
    """The square of its length."""
    return vector[0] ** 2 + vector[1] ** 2


def cross(one: Any, other: Any) -> Array:
    """The cross product of two vectors in the plane."""
    return one[0] * other[1] - one[1] * other[0]


def turned(angle: Float[Array, "*shape"]) -> Vector:
    """Cosine and sine."""
    return jnp.cos(angle), jnp.sin(angle)


def from_box(point: Any, turn: Any) -> Vector:
    """A vector in the axes of a box that is turned so, in those that it is turned against."""
    return point[0] * turn[0] - point[1] * turn[1], point[0] * turn[1] + point[1] * turn[0]


def to_box(point: Any, turn: Any) -> Vector:
    """The same the other way round."""
    return point[0] * turn[0] + point[1] * turn[1], point[1] * turn[0] - point[0] * turn[1]


def _clamp(half: Vector, point: Vector) -> Vector:
    return jnp.clip(point[0], -half[0], half[0]), jnp.clip(point[1], -half[1], half[1])
