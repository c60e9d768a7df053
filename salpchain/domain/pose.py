"""Where chains start and the target poses they must take (paper section 3.1; DESIGN section 4)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.physics.chain import Chain, at_rest

LINK = 0.07  # m, between neighbouring points (paper's world)
SPAWN = 0.1  # m, the first unit starts with abs(x), abs(y) below this
RADIUS = (0.05, 0.3)  # m, of target arcs, times max(1, n // 3)
# Of folded starts (chosen)
FOLD = 3.2  # rad, the most that a fold turns, over a few joints
SHARPEST = 1.6  # rad, the most that a fold turns at one joint
WAVE = 0.15  # rad, standard deviation of what every joint turns besides
APART = 0.064  # m, least distance of the centres of units that are no neighbours: the diagonal
FLATTER = (1.0, 0.9, 0.8, 0.7, 0.5, 0.25, 0.0)  # times the turns, until no units overlap


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


def spawn(draw: Draw, slots: int, length: int | Array) -> Chain:
    """A straight chain at rest near the origin, in a random direction; slots past `length` dead."""
    first = _between(-SPAWN, SPAWN, draw.spawn)
    angle = _between(0.0, 2 * jnp.pi, draw.angle)
    along = LINK * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    slot = jnp.arange(slots)
    present = slot < length
    position = first + slot[:, None] * along
    return at_rest(position, jnp.full(slots, angle), present, present[1:])


def folded(key: PRNGKeyArray, chain: Chain, length: int | Array) -> Chain:
    """The straight chain at rest, folded at a random place by a random angle and waved a little.

    The first unit and link stay where they are, no two units overlap, and what is at rest is the
    straight chain. Ours: the paper's chains start straight.
    """
    turns = _turns(key, chain.present.shape[0], length)
    links, places = jax.vmap(lambda share: _laid(chain, share * turns))(jnp.array(FLATTER))
    flattest = jnp.argmax(jax.vmap(lambda place: _is_clear(place, chain.present))(places))
    link, place = links[flattest], places[flattest]
    before, after = jnp.concatenate([link[:1], link]), jnp.concatenate([link, link[-1:]])
    is_last = jnp.arange(place.shape[0]) == length - 1
    angle = jnp.where(is_last, before, (before + after) / 2)
    bent = at_rest(place, angle, chain.present, chain.linked)
    return eqx.tree_at(
        lambda c: (c.links.angle, c.rest_angle), bent, (link, jnp.zeros_like(bent.rest_angle))
    )


def _turns(key: PRNGKeyArray, slots: int, length: int | Array) -> Float[Array, " joint"]:
    """What each link turns against the one before it (rad)."""
    where, width, most, wave = jr.split(key, 4)
    joint = jnp.arange(slots - 2)
    centre = jr.uniform(where) * jnp.maximum(length - 3, 0)
    spread = jr.uniform(width, minval=0.5, maxval=2.5)  # joints
    fold = jnp.exp(-(((joint - centre) / spread) ** 2)) * (joint < length - 2)
    fold = fold / jnp.maximum(fold.sum(), 1e-3) * jr.uniform(most, minval=-FOLD, maxval=FOLD)
    return jnp.clip(fold, -SHARPEST, SHARPEST) + WAVE * jr.normal(wave, joint.shape)


def _laid(
    chain: Chain, turns: Float[Array, " joint"]
) -> tuple[Float[Array, " link"], Float[Array, "unit 2"]]:
    """Angles of the links, and places of the units, of the chain turned so at its inner units."""
    angle = chain.units.angle[0] + jnp.concatenate([jnp.zeros(1), jnp.cumsum(turns)])
    steps = LINK * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    first = chain.units.position[:1]
    return angle, jnp.concatenate([first, first + jnp.cumsum(steps, axis=0)])


def _is_clear(place: Float[Array, "unit 2"], present: Bool[Array, " unit"]) -> Bool[Array, ""]:
    """Whether no two units but neighbours are so near that they could overlap."""
    apart = jnp.sum((place[:, None] - place) ** 2, axis=-1)
    slot = jnp.arange(place.shape[0])
    counts = present[:, None] & present & (jnp.abs(slot[:, None] - slot) > 1)
    return jnp.where(counts, apart, jnp.inf).min() > APART**2


def target_pose(draw: Draw, slots: int, length: int | Array) -> Float[Array, "slots 2"]:
    """A random target pose (m): one or two arcs, whose size and distance grow with the length."""
    first = _sign(draw.sign) * _between(1.0, 2.0, draw.distance) * length * LINK
    turn = _between(0.0, 2 * jnp.pi, draw.turn)
    return first + curve(random_bend(draw, length), turn, slots, length)


def random_bend(draw: Draw, length: int | Array) -> Bend:
    """Radius uniform in 0.05 to 0.3 m times max(1, n // 3), either turn, one arc or two."""
    radius = _between(*RADIUS, draw.radius) * jnp.maximum(1, length // 3)
    return Bend(radius, _sign(draw.left), jnp.where(draw.double < 0.5, 1.0, 0.0))


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
