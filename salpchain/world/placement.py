"""Where the obstacles of an episode stand: beside the way, clear of start, target and one another.

Each obstacle has a slot, so that episodes with other numbers of them share a program. Walls and
posts are alike here: a middle line between two ends, which of a post are one point, and a rim.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.physics.obstacles import Obstacles, Posts, Walls
from salpchain.physics.state import Chain, Physics
from salpchain.ranges import Range
from salpchain.world.config import ObstacleConfig

WIDTH = 0.04  # m, across a wall (chosen)
CORNER = WIDTH / 2**0.5  # m, from the end of a wall's middle line to its corners
TRIES = 16  # places that are tried for an obstacle before it is left out (chosen)
PASSAGE = 2.0  # link lengths left free between two obstacles, so that a chain fits (chosen)
NARROWEST = 0.1  # m, of the free water in a room round start and target (chosen)


class Way(NamedTuple):
    """What lies before a chain at the start of an episode."""

    points: Float[Array, "point 2"]  # m, of the start and of the target; all finite
    start: Float[Array, "2"]  # m, the centre of the chain
    ahead: Float[Array, "2"]  # m, from there to the centre of the target
    axes: Float[Array, "2 2"]  # unit vectors along the way and across it
    extent: Float[Array, ""]  # m, the chain's length
    link: Float[Array, ""]  # m


class Chance(NamedTuple):
    """The random numbers of one episode, each uniform in [0, 1): drawn at once, for speed."""

    room: Float[Array, ""]
    walls: Float[Array, ""]
    posts: Float[Array, ""]
    size: Float[Array, " slot"]
    along: Float[Array, "slot try"]
    aside: Float[Array, "slot try"]  # below a half to the right
    angle: Float[Array, "slot try"]  # below a half clockwise


def _draw(key: PRNGKeyArray, num: int) -> Chance:
    """Fresh random numbers for so many slots."""
    u = jr.uniform(key, (3 + num * (1 + 3 * TRIES),))
    tries = u[3 + num :].reshape(3, num, TRIES)
    return Chance(u[0], u[1], u[2], u[3 : 3 + num], *tries)


def _between(given: Range, u: Array) -> Array:
    return given.low + (given.high - given.low) * u


def _count(given: Range, u: Array) -> Array:
    """A whole number of the range, each equally likely."""
    low, high = round(given.low), round(given.high)
    return jnp.minimum(low + jnp.floor((high - low + 1) * u), high)


def _either_side(given: Range, u: Array) -> Array:
    """A number of the range, with either sign."""
    side = jnp.where(u < 0.5, -1.0, 1.0)
    return side * _between(given, jnp.where(u < 0.5, 2 * u, 2 * u - 1))


class Pieces(NamedTuple):
    """Walls and posts by their middle lines."""

    ends: Float[Array, "*piece 2 2"]  # m
    rim: Float[Array, " *piece"]  # m, from the line to the surface
    present: Bool[Array, " *piece"]


def place_obstacles(
    config: ObstacleConfig,
    key: PRNGKeyArray,
    chain: Chain,
    target: Float[Array, "unit 2"],
    physics: Physics,
) -> Obstacles | None:
    """Obstacles around a start and a target (m) as the settings say; None if they say none.

    No surface is nearer than a link's length to the centre of a unit at its start or to a target
    point. An obstacle for which no such place is found is not present.
    """
    slots = round(config.walls.high), round(config.posts.high)
    if not any(slots) and not config.room.high:
        return None
    way, chance = _way(chain, target, physics), _draw(key, sum(slots))
    width = _between(config.room, chance.room)
    around = _room(width, way) if config.room.high else jnp.zeros((0, 2, 2))
    pieces = _scattered(config, chance, way, around, slots)
    num_walls, num_around = slots[0], len(around)
    ends = jnp.concatenate([around, pieces.ends[:num_walls]])
    standing = jnp.concatenate([jnp.ones(num_around, bool), pieces.present[:num_walls]])
    posts = jax.tree.map(lambda x: x[num_walls:], pieces)
    return Obstacles(
        Walls(ends, jnp.full(len(ends), WIDTH), standing),
        Posts(posts.ends[:, 0], posts.rim, posts.present),
    )


def _way(chain: Chain, target: Float[Array, "unit 2"], physics: Physics) -> Way:
    there = chain.present[:, None]
    position = jnp.where(there, chain.units.position, chain.units.position[0])
    goal, num = jnp.where(there, target, target[0]), there.sum()
    start = jnp.where(there, position, 0.0).sum(axis=0) / num
    ahead = jnp.where(there, goal, 0.0).sum(axis=0) / num - start
    angle = jnp.arctan2(ahead[1], ahead[0])
    along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    axes = jnp.stack([along, jnp.stack([-along[1], along[0]])])
    link = jnp.asarray(physics.link_length)
    return Way(jnp.concatenate([position, goal]), start, ahead, axes, num * link, link)


def _room(width: Array, way: Way) -> Float[Array, "4 2 2"]:
    """The middle lines (m) of four walls along the way and across it, these chain lengths away."""
    free = jnp.maximum(width * way.extent, NARROWEST)
    points = jnp.stack([_dot(way.points, axis) for axis in way.axes], axis=-1)
    low, high = points.min(axis=0) - free, points.max(axis=0) + free
    half = WIDTH / 2
    (x, y), (right, top) = low - half, high + half
    ends = [
        [[x - half, side], [right + half, side]] for side in (y, top)
    ] + [
        [[side, y - half], [side, top + half]] for side in (x, right)
    ]  # fmt: skip
    return _turned(jnp.asarray(ends), way)


def _scattered(
    config: ObstacleConfig,
    chance: Chance,
    way: Way,
    around: Float[Array, "wall 2 2"],
    slots: tuple[int, int],
) -> Pieces:
    """Walls, then posts, each at the first of its places that is clear of all there is by then."""
    num, first = sum(slots), slots[0]
    counts = _count(config.walls, chance.walls), _count(config.posts, chance.posts)
    wanted = jnp.concatenate([jnp.arange(n) < k for n, k in zip(slots, counts, strict=True)])
    length = way.extent * _between(config.wall_length, chance.size[:first])
    radius = _between(config.post_radius, chance.size[first:])
    rim = jnp.concatenate([jnp.full(first, CORNER), radius])
    tried = _tried(config, chance, way, jnp.concatenate([length, jnp.zeros(slots[1])]))
    passage = PASSAGE * way.link
    clear = _far(_to_points(tried, way.points), rim[:, None, None] + way.link)
    clear &= _far(_apart(tried, around), rim[:, None, None] + CORNER + passage)
    clear &= _far(_apart(_seen(tried, way.start), around), 0.0)  # on this side of the room's walls

    def add(placed: Pieces, slot: Array) -> tuple[Pieces, None]:
        reach = jnp.where(placed.present, placed.rim + rim[slot] + passage, -1.0)
        good = clear[slot] & _far(_apart(tried[slot], placed.ends), reach)
        chosen = Pieces(tried[slot, good.argmax()], rim[slot], wanted[slot] & good.any())
        return jax.tree.map(lambda every, one: every.at[slot].set(one), placed, chosen), None

    none = Pieces(jnp.zeros((num, 2, 2)), jnp.zeros(num), jnp.zeros(num, bool))
    return jax.lax.scan(add, none, jnp.arange(num))[0] if num else none


def _tried(
    config: ObstacleConfig, chance: Chance, way: Way, length: Float[Array, " slot"]
) -> Float[Array, "slot try 2 2"]:
    """The ends (m) of each obstacle at each place that is tried for it."""
    along = _between(config.along, chance.along)[..., None] * way.ahead
    aside = way.extent * _either_side(config.aside, chance.aside)
    centre = way.start + along + aside[..., None] * way.axes[1]
    angle = _either_side(config.wall_angle, chance.angle)
    line = _turned(jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1), way)
    half = line * length[:, None, None] / 2
    return jnp.stack([centre - half, centre + half], axis=-2)


def _seen(
    tried: Float[Array, "*tried 2 2"], start: Float[Array, "2"]
) -> Float[Array, "*tried 2 2"]:
    """Segments from the start (m) to the middles of pieces."""
    centre = tried.mean(axis=-2)
    return jnp.stack([jnp.broadcast_to(start, centre.shape), centre], axis=-2)


def _far(squares: Float[Array, "*tried other"], least: Array | float) -> Bool[Array, " *tried"]:
    """Whether all distances, given squared (m2), are greater than the least (m)."""
    return jnp.all(squares > jnp.sign(least) * jnp.square(least), axis=-1)


def _to_points(
    tried: Float[Array, "*tried 2 2"], points: Float[Array, "other 2"]
) -> Float[Array, "*tried other"]:
    """Square distances (m2) of points from segments given by their ends."""
    return _square_to(points, tried[..., None, :, :])


def _apart(
    tried: Float[Array, "*tried 2 2"], others: Float[Array, "other 2 2"]
) -> Float[Array, "*tried other"]:
    """Square distances (m2) between segments given by their ends; 0 where two cross."""
    one = tried[..., None, :, :]
    to_ends = [_square_to(others[:, k], one) for k in (0, 1)]
    from_ends = [_square_to(one[..., k, :], others) for k in (0, 1)]
    apart = jnp.minimum(jnp.minimum(*to_ends), jnp.minimum(*from_ends))
    return jnp.where(_split(one, others) & _split(others, one), 0.0, apart)


def _square_to(point: Array, segment: Array) -> Array:
    line, away = segment[..., 1, :] - segment[..., 0, :], point - segment[..., 0, :]
    part = jnp.clip(_dot(away, line) / jnp.maximum(_dot(line, line), 1e-12), 0.0, 1.0)
    rest = away - part[..., None] * line
    return _dot(rest, rest)


def _turned(points: Float[Array, "*point 2"], way: Way) -> Float[Array, "*point 2"]:
    """Points or vectors along the way and across it (m), in world axes."""
    return points[..., :1] * way.axes[0] + points[..., 1:] * way.axes[1]


def _dot(one: Array, other: Array) -> Array:
    return one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1]


def _split(one: Array, other: Array) -> Array:
    """Whether the line through one has the ends of the other on its two sides."""
    line = one[..., 1, :] - one[..., 0, :]
    across = jnp.stack([-line[..., 1], line[..., 0]], axis=-1)
    first, last = (_dot(across, other[..., k, :] - one[..., 0, :]) for k in (0, 1))
    return first * last < 0
