"""Where chains start and the target poses they must take (paper section 3.1; DESIGN section 4)."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.physics.chain import Chain, at_rest

LINK = 0.07  # m, between neighbouring points (paper's world)
SPAWN = 0.1  # m, the first unit starts with abs(x), abs(y) below this
RADIUS = (0.05, 0.3)  # m, of target arcs, times max(1, n // 3)


class Bend(NamedTuple):
    """The shape of a target pose: arcs of chords, before it is placed."""

    radius: Float[Array, ""]  # m
    left: Float[Array, ""]  # +1 where the first arc turns anticlockwise, else -1
    double: Float[Array, ""]  # 1 where the second half turns the other way, else 0


def spawn(key: PRNGKeyArray, slots: int, length: int | Array) -> Chain:
    """A straight chain at rest near the origin, in a random direction; slots past `length` dead."""
    place_key, turn_key = jr.split(key)
    first = jr.uniform(place_key, (2,), minval=-SPAWN, maxval=SPAWN)
    angle = jr.uniform(turn_key, maxval=2 * jnp.pi)
    along = LINK * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    slot = jnp.arange(slots)
    present = slot < length
    position = first + slot[:, None] * along
    return at_rest(position, jnp.full(slots, angle), present, present[1:])


def target_pose(key: PRNGKeyArray, slots: int, length: int | Array) -> Float[Array, "slots 2"]:
    """A random target pose (m): one or two arcs, whose size and distance grow with the length."""
    bend_key, place_key = jr.split(key)
    x_key, sign_key, turn_key = jr.split(place_key, 3)
    near = length * LINK
    distance = jr.uniform(x_key, (2,), minval=1.0, maxval=2.0) * near
    first = distance * jr.rademacher(sign_key, (2,), distance.dtype)
    turn = jr.uniform(turn_key, maxval=2 * jnp.pi)
    return first + curve(random_bend(bend_key, length), turn, slots, length)


def random_bend(key: PRNGKeyArray, length: int | Array) -> Bend:
    """Radius uniform in 0.05 to 0.3 m times max(1, n // 3), either turn, one arc or two."""
    radius_key, left_key, double_key = jr.split(key, 3)
    radius = jr.uniform(radius_key, minval=RADIUS[0], maxval=RADIUS[1])
    return Bend(
        radius=radius * jnp.maximum(1, length // 3),
        left=jr.rademacher(left_key, (), radius.dtype),
        double=jr.bernoulli(double_key).astype(radius.dtype),
    )


def curve(
    bend: Bend, turn: Float[Array, ""] | float, slots: int, length: int | Array
) -> Float[Array, "slots 2"]:
    """Points one link apart along the bend, the first at the origin with its chord at `turn`.

    Of two arcs, the first holds half the points (one more when they are odd).
    """
    chord = jnp.arange(slots - 1)
    side = jnp.where(chord < (length + 1) // 2, 1.0, 1.0 - 2.0 * bend.double)
    step = 2 * jnp.arcsin(jnp.minimum(LINK / (2 * bend.radius), 1.0))
    angle = turn + bend.left * step * (jnp.cumsum(side) - side[0])
    points = LINK * jnp.cumsum(jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1), axis=0)
    return jnp.concatenate([jnp.zeros((1, 2)), points])
