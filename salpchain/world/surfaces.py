"""What a unit senses of walls and posts: the nearest surface, and distances along rays.

Rows are one number of every unit, with the batch of chains last (see `physics.batching`): units are
the first axis of every row, whether a batch follows or not. So are obstacles in their arrays.
"""

from math import pi
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.physics.batching import over_the_batch
from salpchain.physics.boxes import from_box, to_box
from salpchain.physics.derivatives import root
from salpchain.physics.obstacles import Obstacles, Solids, post_solids, solids, wall_solids
from salpchain.physics.state import Chain

SENSED = 0.2  # m, from a unit's centre, from which on a surface is not felt (chosen)
FARTHEST = 0.5  # m, how far rays reach (chosen)

Row = Array  # (unit,) or (unit, batch)
Pair = tuple[Row, Row]  # x and y


def nearest_surface(
    chain: Chain, obstacles: Obstacles, reach: float = SENSED
) -> Float[Array, "unit 2"]:
    """Towards the nearest point of any obstacle, in each unit's axes (along it, along its heading).

    1 - distance / reach long: 1 where the unit's centre is at the surface, and zero where none is
    within reach (m); zero in dead slots too.
    """
    there = solids(obstacles)
    if there is None:
        return jnp.zeros_like(chain.units.position)
    return _nearest(reach, chain.units.position, chain.units.angle, chain.present, there)


def rays(
    chain: Chain, obstacles: Obstacles, num: int = 8, reach: float = FARTHEST
) -> Float[Array, "unit ray"]:
    """How far each unit sees from its centre, over `reach` (m): 1 where there is nothing.

    Ray k points 2 pi k / num anticlockwise from the unit's axis. Zero in dead slots.
    """
    walls, posts = wall_solids(obstacles.walls), post_solids(obstacles.posts)
    body = chain.units.position, chain.units.angle, chain.present
    return _rays((num, reach), *body, walls, posts)


@over_the_batch
def _nearest(reach: float, position: Array, angle: Array, present: Array, there: Solids) -> Array:
    point, turn = (position[:, 0], position[:, 1]), (jnp.cos(angle), jnp.sin(angle))
    rows = jnp.stack(nearest_rows(point, turn, there, reach), axis=1)
    return jnp.where(present[:, None], rows, 0.0)


@over_the_batch
def _rays(
    how: tuple[int, float], position: Array, angle: Array, present: Array, walls: Any, posts: Any
) -> Array:
    point, turn = (position[:, 0], position[:, 1]), (jnp.cos(angle), jnp.sin(angle))
    rows = jnp.stack(ray_rows(point, turn, walls, posts, *how), axis=1)
    return jnp.where(present[:, None], rows, 0.0)


def nearest_rows(point: Pair, turn: Pair, there: Solids, reach: float) -> list[Row]:
    """`nearest_surface` as two rows, of units at these points (m) with these cosines and sines."""
    place = jnp.stack(point)

    def look(index: Array, found: tuple[Row, Row, Row]) -> tuple[Row, Row, Row]:
        x, y, least = found
        one = jax.tree.map(lambda x: x[index], there)
        towards, distance = _towards(one, place)
        nearer = distance < least
        x, y = jnp.where(nearer, towards[0], x), jnp.where(nearer, towards[1], y)
        return x, y, jnp.where(nearer, distance, least)

    nothing = jnp.zeros_like(point[0])
    start = nothing, nothing, jnp.full_like(nothing, reach)
    x, y, least = jax.lax.fori_loop(0, there.rim.shape[0], look, start)
    size = 1 - jnp.maximum(least, 0.0) / reach
    return [*(size * row for row in to_box((x, y), turn))]


def _towards(solid: Solids, place: Array) -> tuple[Array, Row]:
    """The direction from each point to the nearest of a solid, and its distance (m) from there."""
    turn = solid.turn[:, None]
    apart = to_box(place - solid.centre[:, None], turn)
    back = [jnp.clip(apart[k], -solid.half[k], solid.half[k]) - apart[k] for k in (0, 1)]
    way = jnp.stack(from_box(back, turn))
    distance = root(way[0] ** 2 + way[1] ** 2)
    return way / jnp.maximum(distance, 1e-6), distance - solid.rim


def ray_rows(
    point: Pair, turn: Pair, walls: Solids, posts: Solids, num: int, reach: float
) -> list[Row]:
    """`rays` as rows, of units at these points (m) with these cosines and sines."""
    place, shape = jnp.stack(point), (num, *(1,) * turn[0].ndim)
    bearing = 2 * pi * jnp.arange(num).reshape(shape) / num
    cosine, sine = jnp.cos(bearing), jnp.sin(bearing)
    ray = jnp.stack([cosine * turn[0] - sine * turn[1], cosine * turn[1] + sine * turn[0]])
    seen = jnp.full(ray.shape[1:], reach, turn[0].dtype)
    seen = _seen(_to_wall, walls, place, ray, seen)
    return [*(_seen(_to_post, posts, place, ray, seen) / reach)]


def _seen(distance: Any, some: Solids, place: Array, ray: Array, seen: Array) -> Array:
    """The shortest of what was seen (m) and the distances to some solids."""
    if not some.rim.shape[0]:
        return seen

    def look(index: Array, seen: Array) -> Array:
        one = jax.tree.map(lambda x: x[index], some)
        return jnp.minimum(seen, distance(one, place, ray))

    return jax.lax.fori_loop(0, some.rim.shape[0], look, seen)


def _to_wall(wall: Solids, place: Array, ray: Array) -> Array:
    """Distance (m) along each ray to a box; infinite where it misses. From inside it is 0."""
    start = to_box(place - wall.centre[:, None], wall.turn[:, None])
    ahead = to_box(ray, wall.turn[:, None])
    enter, leave = jnp.zeros_like(ahead[0]), jnp.full_like(ahead[0], jnp.inf)
    for k in (0, 1):
        step = jnp.where(jnp.abs(ahead[k]) > 1e-9, ahead[k], 1e-9)
        one, other = ((side * wall.half[k] - start[k]) / step for side in (-1, 1))
        enter = jnp.maximum(enter, jnp.minimum(one, other))
        leave = jnp.minimum(leave, jnp.maximum(one, other))
    return jnp.where(enter <= leave, enter, jnp.inf)


def _to_post(post: Solids, place: Array, ray: Array) -> Array:
    """Distance (m) along each ray to a circle; infinite where it misses. From inside it is 0."""
    apart = place - post.centre[:, None]
    along = -(apart[0] * ray[0] + apart[1] * ray[1])
    aside = apart[0] * ray[1] - apart[1] * ray[0]
    half = post.rim**2 - aside**2
    ends = root(jnp.maximum(half, 0.0))
    return jnp.where((half > 0) & (along + ends >= 0), jnp.maximum(along - ends, 0.0), jnp.inf)
