"""Walls and posts: what they are, and how they push units (VMAS 1.5.2 outside, an own law inside).

A wall is a thick segment, that is a box; a post is a circle. Links do not touch them, as in VMAS.
Inside this package both are boxes with a rounded rim: a post has no size but its rim.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics import boxes
from salpchain.physics.boxes import Boxes, Vector, cross, square, to_box, turned
from salpchain.physics.candidates import AWAY, Candidates, Pushes, of_each, pushed, scattered
from salpchain.physics.substeps import Motion, Push, Rig
from salpchain.xla import materialise

# How many times as fast the force grows with the depth inside a wall as with the nearness outside
# (chosen: see docs/world.md).
HARDER = 8.0
DEEPEST = 0.005  # m, from which depth on the force grows no more (chosen): 70 N


class Walls(eqx.Module):
    """Thick segments that units cannot enter."""

    ends: Float[Array, "wall 2 2"]  # m, world: the two ends of the middle line, x and y of each
    width: Float[Array, " wall"]  # m, across
    present: Bool[Array, " wall"]


class Posts(eqx.Module):
    """Circles that units cannot enter."""

    centre: Float[Array, "post 2"]  # m, world
    radius: Float[Array, " post"]  # m
    present: Bool[Array, " post"]


class Obstacles(eqx.Module):
    """What stands in the water. Slots that are not `present` exert nothing, whatever they hold.

    Every array may be traced, and each chain of a batch may have obstacles of its own.
    """

    walls: Walls
    posts: Posts


class Solids(NamedTuple):
    """Walls and posts alike: boxes with a rim around them. What is not there is far away.

    The first axis is that of the solids, the last that of a batch if there is one.
    """

    centre: Float[Array, "solid 2 *batch"]  # m
    turn: Float[Array, "solid 2 *batch"]  # cosine and sine of the angle of the longer axis
    half: Float[Array, "solid 2 *batch"]  # m, half the size of the box
    rim: Float[Array, "solid *batch"]  # m, radius of a post; 0 of a wall


def solids(obstacles: Obstacles) -> Solids | None:
    """Walls, then posts; None if there is no slot for either."""
    walls, posts = wall_solids(obstacles.walls), post_solids(obstacles.posts)
    together = jax.tree.map(lambda *x: jnp.concatenate(x), walls, posts)
    return together if together.rim.size else None


def wall_solids(walls: Walls) -> Solids:
    """Walls as boxes without a rim."""
    there = walls.present[:, None]
    begin, end = (jnp.where(there, walls.ends[:, k], float(k)) for k in (0, 1))
    along = end - begin
    length = jnp.sqrt(along[:, :1] ** 2 + along[:, 1:] ** 2)
    width = jnp.where(there, walls.width[:, None], 0.0)
    half = jnp.concatenate([jnp.where(there, length, 0.0), width], axis=1) / 2
    centre = jnp.where(there, (begin + end) / 2, -AWAY)
    return Solids(centre, along / length, half, jnp.zeros_like(walls.width))


def post_solids(posts: Posts) -> Solids:
    """Posts as rims without a box."""
    centre = jnp.where(posts.present[:, None], posts.centre, -AWAY)
    turn = jnp.broadcast_to(jnp.array([1.0, 0.0], centre.dtype), centre.shape)
    radius = jnp.where(posts.present, posts.radius, 0.0)
    return Solids(centre, turn, jnp.zeros_like(centre), radius)


def distance_squared_beyond(
    solid: Solids, point: Float[Array, "2 unit batch"], reach: Array
) -> Float[Array, "unit batch"]:
    """Square distance (m2) of points from a box, less that at which its rim is within reach.

    Negative where a point is within reach (m) of the solid's surface, or inside.
    """
    apart = to_box(point - solid.centre[:, None], solid.turn[:, None])
    beyond = [jnp.maximum(jnp.abs(apart[k]) - solid.half[k], 0.0) for k in (0, 1)]
    return beyond[0] ** 2 + beyond[1] ** 2 - (reach + solid.rim) ** 2


def obstruction(rig: Rig, near: Candidates, units: Motion) -> Push:
    """How obstacles push units. `other` is the solid."""
    num, batch = units.angle.shape
    x, y = (row.reshape(num * batch) for row in scattered(rig.present, units.position))
    angle = units.angle.reshape(num * batch)

    def exert(unit: Array, other: Array, valid: Array, never: Array) -> Pushes:
        chain = unit % batch
        physics = of_each(rig.physics, chain)
        one = jax.tree.map(lambda s: jnp.moveaxis(s[other, ..., chain], 0, -1), rig.obstacles)
        place, turn, one = materialise(((x[unit], y[unit]), turned(angle[unit]), one), never)
        valid &= _circles_meet(physics, one, place)
        push = _solid_against_unit(physics, one, place, turn, never)
        return [(unit, [jnp.where(valid, value, 0.0) for value in push])]

    def load() -> Float[Array, "3 unit batch"]:
        return pushed([near], exert, num, batch)

    return Push(near.count > 0, load)


def every_obstruction(rig: Rig, units: Motion) -> Push:
    """`obstruction` by all obstacles, in operations that have derivatives of both modes."""
    place, turn = jnp.where(rig.present, units.position, 0.0), turned(units.angle)

    def add(total: Array, solid: Solids) -> tuple[Array, None]:
        one = jax.tree.map(partial(jnp.expand_dims, axis=-2), solid)
        near = _circles_meet(rig.physics, one, place) & rig.present
        push = jnp.stack(_solid_against_unit(rig.physics, one, place, turn))
        return total + jnp.where(near, push, 0.0), None

    nothing = jnp.zeros((3, *units.angle.shape))
    return Push(None, lambda: jax.lax.scan(add, nothing, rig.obstacles)[0])


def _circles_meet(physics: Any, solid: Solids, place: Any) -> Bool[Array, "*unit"]:
    """Whether the circles around unit and solid meet, without which VMAS looks no further."""
    size = jnp.sqrt(physics.unit_length**2 + physics.unit_width**2) / 2
    around = size + jnp.sqrt(square(solid.half)) + solid.rim
    offset = solid.centre[0] - place[0], solid.centre[1] - place[1]
    return square(offset) <= around**2


def _solid_against_unit(
    physics: Any, solid: Solids, place: Any, turn: Vector, never: Any = False
) -> tuple[Array, Array, Array]:
    """Force (N, x and y) and torque (N m) on units.

    Outside it is VMAS's law of two boxes, or of a box and a sphere, which holds inside too. Where
    unit and wall overlap, VMAS exerts nothing; here the force goes on from the 10 N that it has at
    the surface, along the shortest way out, and grows faster, up to 70 N.
    """
    half = (physics.unit_length / 2, physics.unit_width / 2)
    offset = solid.centre[0] - place[0], solid.centre[1] - place[1]
    pair = Boxes(half, (solid.half[0], solid.half[1]), offset, turn, solid.turn)
    outside, between = boxes.closest_points(pair, never)
    gap, away = boxes.unit_vector(between)
    depth, inside, out = boxes.deepest_points(pair)
    inner = jnp.where(solid.rim > 0, depth, HARDER * jnp.minimum(depth, DEEPEST))
    within = boxes.overlap(pair)
    gap = jnp.where(within, -inner, gap) - solid.rim
    here = [jnp.where(within, inside[k], outside[k]) for k in (0, 1)]
    size = jnp.where(gap <= physics.contact_gap, boxes.repulsion(physics, gap), 0.0)
    force = tuple(size * jnp.where(within, out[k], away[k]) for k in (0, 1))
    return force[0], force[1], cross(here, force)
