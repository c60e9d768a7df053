"""Folded starts, to train what straight ones hardly ever lead to (ours, not the paper's)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.physics.contact import touching_distance
from salpchain.physics.state import Chain, Physics, at_rest, wrap
from salpchain.tasks.reach.targets import PAPER

# All chosen
FOLD = 3.2  # rad, the most that a fold turns, over a few joints
SHARPEST = 1.6  # rad, the most that a fold turns at one joint
WAVE = 0.15  # rad, standard deviation of what every joint turns besides
ASKEW = 0.1  # rad, standard deviation of how a stalled chain is turned against its target
FLATTER = (1.0, 0.9, 0.8, 0.7, 0.5, 0.25, 0.0)  # times the turns, until no units overlap


def folded(key: PRNGKeyArray, chain: Chain, length: int | Array, physics: Physics = PAPER) -> Chain:
    """The straight chain at rest, folded at a random place by a random angle and waved a little.

    The first unit and link stay where they are, no two units overlap, and the rest angles are
    those of the straight chain.
    """
    turns = _turns(key, chain.present.shape[0], length)
    angle, first = chain.units.angle[0], chain.units.position[0]
    return _bent(chain, *_clear(first, angle, turns, chain.present, physics), length)


def stalled(
    key: PRNGKeyArray,
    chain: Chain,
    target: Float[Array, "unit 2"],
    length: int | Array,
    physics: Physics = PAPER,
) -> Chain:
    """The chain as `folded`, but bent like the target besides, and with one link on the target's.

    So it lies where a swim ends that stalls: one part in place, the other folded back along it.
    """
    how, which, askew = jr.split(key, 3)
    along = jnp.arctan2(*jnp.diff(target, axis=0).T[::-1])
    joint = jnp.arange(along.shape[0] - 1)
    bends = jnp.where(joint < length - 2, wrap(jnp.diff(along)), 0.0)
    turns = bends + _turns(how, chain.present.shape[0], length)
    turns = jnp.clip(turns, -SHARPEST, SHARPEST)
    angle, place = _clear(target[0], along[0], turns, chain.present, physics)
    link = jr.randint(which, (), 0, length - 1)
    turned = along[link] - angle[link] + ASKEW * jr.normal(askew)
    x, y = (place - place[link]).T
    cos, sin = jnp.cos(turned), jnp.sin(turned)
    moved = target[link] + jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return _bent(chain, angle + turned, moved, length)


def _turns(key: PRNGKeyArray, slots: int, length: int | Array) -> Float[Array, " joint"]:
    """What each link turns against the one before it (rad)."""
    where, width, most, wave = jr.split(key, 4)
    joint = jnp.arange(slots - 2)
    centre = jr.uniform(where) * jnp.maximum(length - 3, 0)
    spread = jr.uniform(width, minval=0.5, maxval=2.5)  # joints
    fold = jnp.exp(-(((joint - centre) / spread) ** 2)) * (joint < length - 2)
    fold = fold / jnp.maximum(fold.sum(), 1e-3) * jr.uniform(most, minval=-FOLD, maxval=FOLD)
    return jnp.clip(fold, -SHARPEST, SHARPEST) + WAVE * jr.normal(wave, joint.shape)


def _clear(
    first: Float[Array, "2"],
    angle: Float[Array, ""],
    turns: Float[Array, " joint"],
    present: Bool[Array, " unit"],
    physics: Physics,
) -> tuple[Float[Array, " link"], Float[Array, "unit 2"]]:
    """Angles of the links and places of the units, with turns made flatter until none overlap."""
    shapes = jax.vmap(lambda share: _laid(first, angle, share * turns, physics))(jnp.array(FLATTER))
    flattest = jnp.argmax(jax.vmap(lambda place: _is_clear(place, present, physics))(shapes[1]))
    return shapes[0][flattest], shapes[1][flattest]


def _laid(
    first: Float[Array, "2"],
    angle: Float[Array, ""],
    turns: Float[Array, " joint"],
    physics: Physics,
) -> tuple[Float[Array, " link"], Float[Array, "unit 2"]]:
    """Angles of the links, and places of the units, of a chain turned so at its inner units."""
    links = angle + jnp.concatenate([jnp.zeros(1), jnp.cumsum(turns)])
    steps = physics.link_length * jnp.stack([jnp.cos(links), jnp.sin(links)], axis=-1)
    return links, jnp.concatenate([first[None], first + jnp.cumsum(steps, axis=0)])


def _is_clear(
    place: Float[Array, "unit 2"], present: Bool[Array, " unit"], physics: Physics
) -> Bool[Array, ""]:
    """Whether no two units but neighbours are so near that they could overlap."""
    apart = jnp.sum((place[:, None] - place) ** 2, axis=-1)
    slot = jnp.arange(place.shape[0])
    counts = present[:, None] & present & (jnp.abs(slot[:, None] - slot) > 1)
    return jnp.where(counts, apart, jnp.inf).min() > touching_distance(physics) ** 2


def _bent(
    chain: Chain, link: Float[Array, " link"], place: Float[Array, "unit 2"], length: int | Array
) -> Chain:
    """The chain with these link angles and unit places, its units between their links."""
    before, after = jnp.concatenate([link[:1], link]), jnp.concatenate([link, link[-1:]])
    is_last = jnp.arange(place.shape[0]) == length - 1
    angle = jnp.where(is_last, before, (before + after) / 2)
    bent = at_rest(place, angle, chain.present, chain.linked)
    return eqx.tree_at(
        lambda c: (c.links.angle, c.rest_angle), bent, (link, jnp.zeros_like(bent.rest_angle))
    )
