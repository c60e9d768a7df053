"""Where chains start and the target poses they must take (paper section 3.1)."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.dynamics.robot import Dynamics, scale_of, settled
from salpchain.physics.state import Chain, Physics, Scalar, at_rest

LINK: float = Physics.link_length  # m, of the default physics  # pyright: ignore[reportAssignmentType]
PAPER = Physics()  # the paper's
SPAWN = 0.1  # m, the first unit starts with abs(x), abs(y) below this
RADIUS = (0.05, 0.3)  # m, of target arcs, times max(1, n // 3)


class Draw(NamedTuple):
    """The random numbers of one episode, each uniform in [0, 1): drawn at once, for speed."""

    spawn: Float[Array, "2"]  # place of the first unit
    angle: Float[Array, ""]  # of the chain
    distance: Float[Array, "2"]  # of the first target point
    sign: Float[Array, "2"]  # of its coordinates
    turn: Float[Array, ""]  # of the whole target
    radius: Float[Array, ""]  # of its arcs
    left: Float[Array, ""]  # which way the first arc turns
    double: Float[Array, ""]  # one arc or two


def draw(key: PRNGKeyArray) -> Draw:
    """Fresh random numbers."""
    u = jr.uniform(key, (11,))
    return Draw(u[0:2], u[2], u[3:5], u[5:7], u[7], u[8], u[9], u[10])


def _sign(u: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return jnp.where(u < 0.5, -1.0, 1.0)


def _between(low: float, high: float, u: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return low + (high - low) * u


class Bend(NamedTuple):
    """The shape of a target pose: arcs of chords, before it is placed."""

    radius: Float[Array, ""]  # m
    left: Float[Array, ""]  # +1 where the first arc turns anticlockwise, else -1
    double: Float[Array, ""]  # 1 where the second half turns the other way, else 0


def spawn(draw: Draw, slots: int, length: int | Array, physics: Physics = PAPER) -> Chain:
    """A straight chain at rest near the origin, in a random direction; slots past `length` dead."""
    reach = SPAWN * scale_of(physics)
    first = _between(-reach, reach, draw.spawn)
    angle = _between(0.0, 2 * jnp.pi, draw.angle)
    along = physics.link_length * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    slot = jnp.arange(slots)
    present = slot < length
    position = first + slot[:, None] * along
    chain = at_rest(position, jnp.full(slots, angle), present, present[1:])
    return settled(physics, chain)


def target_pose(
    draw: Draw, slots: int, length: int | Array, physics: Physics = PAPER
) -> Float[Array, "slots 2"]:
    """A random target pose (m): one or two arcs, whose size and distance grow with the length."""
    link = physics.link_length
    first = _sign(draw.sign) * _between(1.0, 2.0, draw.distance) * length * link
    turn = _between(0.0, 2 * jnp.pi, draw.turn)
    bend = random_bend(draw, length, scale_of(physics))
    if not isinstance(physics, Dynamics):
        return first + curve(bend, turn, slots, length, link)
    ends = first + curve(bend, turn, slots + 1, length, link)
    return (ends[1:] + ends[:-1]) / 2  # the middles of hinged links, which such a chain can take


def random_bend(draw: Draw, length: int | Array, scale: float = 1.0) -> Bend:
    """Radius uniform in 0.05 to 0.3 m times max(1, n // 3), either turn, one arc or two.

    `scale` times these where links are so many times as long.
    """
    low, high = (scale * radius for radius in RADIUS)
    radius = _between(low, high, draw.radius) * jnp.maximum(1, length // 3)
    return Bend(radius, _sign(draw.left), jnp.where(draw.double < 0.5, 1.0, 0.0))


def curve(
    bend: Bend,
    turn: Float[Array, ""] | float,
    slots: int,
    length: int | Array,
    link: Scalar = LINK,
) -> Float[Array, "slots 2"]:
    """Points one link apart along the bend, the first at the origin with its chord at `turn`.

    Of two arcs, the first holds half the points (one more when they are odd).
    """
    chord = jnp.arange(slots - 1)
    side = jnp.where(chord < (length + 1) // 2, 1.0, 1.0 - 2.0 * bend.double)
    step = 2 * jnp.arcsin(jnp.minimum(link / (2 * bend.radius), 1.0))
    angle = turn + bend.left * step * (jnp.cumsum(side) - side[0])
    points = link * jnp.cumsum(jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1), axis=0)
    return jnp.concatenate([jnp.zeros((1, 2)), points])
