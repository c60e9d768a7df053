"""What each unit observes: `table1`, the paper's; `body`, the unit's own view, and variants of it.


The features are worked out as rows, one number of every unit, with the batch of chains last
(see `physics.batching`): units are the first axis of every row, whether a batch follows or not.
"""

from collections.abc import Callable
from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.physics.batching import over_the_batch
from salpchain.physics.derivatives import compress, direction, root
from salpchain.physics.state import Chain, wrap
from salpchain.xla import once

NEIGHBOUR = 0.07  # m, the scale of what is told of neighbours (fixed: policies learned with it)
SENSED = 0.2  # m, from which on a unit that is no neighbour is not sensed (chosen)

Row = Array  # (unit,) or (unit, batch)
Pair = tuple[Row, Row]  # x and y


def observe(
    name: str, chain: Chain, target: Float[Array, "unit 2"], force: Float[Array, "unit 2"]
) -> Float[Array, "unit feature"]:
    """The named observation of one chain; zeros in dead slots. Fast under `jax.vmap`.

    Args:
        name: a key of `OBSERVATIONS`.
        chain: where the chain is.
        target: one point (m) for each unit.
        force: of each unit's thrust in the last control step (N, world axes), as it acted.
    """
    return _observe(name, chain, target, force)


@over_the_batch
def _observe(name: str, chain: Chain, target: Array, force: Array) -> Array:
    rows = OBSERVATIONS[name](View(chain, target, force))
    return jnp.where(chain.present[:, None], jnp.stack(rows, axis=1), 0.0)


class View:
    """The chain and its target as rows, with what both observations need of them."""

    def __init__(self, chain: Chain, target: Array, force: Array) -> None:
        """Rows of a chain, of a batch of chains with the batch last."""
        self.chain, self.force = chain, _pair(force)
        self.position = _pair(chain.units.position)
        self.velocity = _pair(chain.units.velocity)
        self.target = _pair(target)
        angle = chain.units.angle
        never = chain.present.sum() < 0
        self.turn: Pair = once((jnp.cos(angle), jnp.sin(angle)), never)

    def mean(self, pair: Pair) -> Pair:
        """Mean over the present units."""
        present = self.chain.present
        share = 1 / jnp.maximum(present.sum(axis=0), 1)
        x, y = (jnp.sum(jnp.where(present, row, 0.0), axis=0) * share for row in pair)
        return x, y

    def own(self, pair: Pair) -> Pair:
        """World vectors in each unit's axes: along the unit, and along its heading."""
        (cosine, sine), (x, y) = self.turn, pair
        return cosine * x + sine * y, cosine * y - sine * x

    def neighbours(self, row: Row) -> tuple[Row, Row]:
        """What the previous and what the next linked unit has; zero where there is none."""
        joined, none = self.chain.joined, jnp.zeros_like(row[:1])
        previous = jnp.concatenate([none, jnp.where(joined, row[:-1], 0.0)])
        following = jnp.concatenate([jnp.where(joined, row[1:], 0.0), none])
        return previous, following

    def towards(self, pair: Pair) -> tuple[Pair, Pair]:
        """From each unit's point to those of the previous and next linked unit; else zero."""
        joined = self.chain.joined
        steps = [jnp.where(joined, row[1:] - row[:-1], 0.0) for row in pair]
        none = jnp.zeros_like(steps[0][:1])
        previous = tuple(jnp.concatenate([none, -step]) for step in steps)
        following = tuple(jnp.concatenate([step, none]) for step in steps)
        return previous, following  # type: ignore[return-value]

    def nearest(self) -> Pair:
        """From each unit to the nearest that is no neighbour, shorter the farther it is.

        1 - distance / `SENSED` long: nothing from `SENSED` on.
        """
        present, slot = self.chain.present, _indices(self.chain.units.angle)
        joined = jnp.concatenate([self.chain.joined, jnp.zeros_like(present[:1])])
        follows = (slot == slot[:, None] + 1) & joined[:, None]
        precedes = (slot + 1 == slot[:, None]) & joined
        other = present & present[:, None] & (slot != slot[:, None]) & ~follows & ~precedes
        x, y = (row - row[:, None] for row in self.position)
        square = jnp.where(other, x**2 + y**2, jnp.inf)
        least = square.min(axis=1)
        chosen = jnp.where(other & (square <= least[:, None]), 1.0, 0.0)
        apart = jnp.maximum(root(least), 1e-6)
        share = jnp.maximum(1 / apart - 1 / SENSED, 0.0) / jnp.maximum(chosen.sum(axis=1), 1)
        return (chosen * x).sum(axis=1) * share, (chosen * y).sum(axis=1) * share

    def bearing(self, vector: Pair) -> Row:
        """Angle of a neighbour from the unit's own angle (rad, wrapped); 0 where there is none."""
        x, y = vector
        there = (x != 0) | (y != 0)
        return jnp.where(there, wrap(direction(y, x) - self.chain.units.angle), 0.0)


def table1(view: View) -> list[Row]:
    """The 24 numbers of the paper's Table 1, in its order, in world axes; SI units."""
    units = view.chain.units
    index = _indices(units.angle)
    previous, following = view.towards(view.position)
    force = [view.neighbours(row) for row in view.force]
    return [
        *(((index >> bit) & 1).astype(units.angle.dtype) for bit in range(4)),
        *view.position,
        *view.velocity,
        wrap(units.angle),
        units.angular_velocity,
        *_minus(view.velocity, view.mean(view.velocity)),
        *_minus(view.position, view.mean(view.position)),
        *_minus(view.position, view.mean(view.target)),
        *_minus(view.target, view.position),
        view.bearing(previous),
        view.bearing(following),
        *(side[0] for side in force),
        *(side[1] for side in force),
    ]


def body(view: View, metric: bool = False) -> list[Row]:
    """22 numbers in the unit's own axes, of much the same size at any length and distance.

    `metric`: what is far is given in metres as it is.

    The place beside the chain's centroid is in units of the chain's own spread (root mean square).
    In metres, the ends of a long chain see what none saw in training: controllers trained on 8
    units then miss the target from 40 units on.
    """
    units = view.chain.units
    error = _minus(view.target, view.position)
    here, there = view.mean(view.position), view.mean(view.target)
    near = 1 / (root(sum(_squares(error))) + 0.01)
    neighbours = (*view.towards(view.position), *view.towards(view.target))
    place = _indices(units.angle) * (2 / jnp.maximum(view.chain.present.sum(axis=0) - 1, 1)) - 1.0
    beside = _minus(view.position, here)
    spread = root(sum(view.mean(_squares(beside))))
    vectors = [
        _times(view.velocity, 5.0),
        *(_times(vector, 1 / NEIGHBOUR) for vector in neighbours),
        _times(error, near),
        _times(view.mean(view.velocity), 5.0),
        _times(beside, 1 / (spread + 0.01)),
    ]
    far = [error, _minus(there, here)]
    return [
        *(row for vector in vectors for row in view.own(vector)),
        *(row if metric else compress(row) for vector in far for row in view.own(vector)),
        units.angular_velocity / 3,
        place,
    ]


def proximity(view: View, metric: bool = False) -> list[Row]:
    """`body`, and the direction to the nearest unit that is no neighbour, 2 long at contact.

    What a proximity sensor tells; without, units pressed against each other cannot know it.
    """
    return [*body(view, metric), *view.own(_times(view.nearest(), 2.0))]


def anonymous(view: View) -> list[Row]:
    """`proximity` without the unit's place in the chain: 23 numbers."""
    *own, _, along, heading = proximity(view)
    return [*own, along, heading]


OBSERVATIONS: dict[str, Callable[[View], list[Row]]] = {
    "table1": table1,
    "body": body,
    "proximity": proximity,
    "anonymous": anonymous,
    "metric": partial(proximity, metric=True),
}


def _pair(vectors: Array) -> Pair:
    return vectors[:, 0], vectors[:, 1]


def _minus(one: Pair, other: Pair) -> Pair:
    return one[0] - other[0], one[1] - other[1]


def _squares(pair: Pair) -> Pair:
    return pair[0] ** 2, pair[1] ** 2


def _times(pair: Pair, factor: Array | float) -> Pair:
    return pair[0] * factor, pair[1] * factor


def _indices(row: Row) -> Array:
    """0, 1, 2, ... along the chain, in the shape of a row."""
    index = jnp.arange(row.shape[0]).reshape(-1, *(1,) * (row.ndim - 1))
    return jnp.broadcast_to(index, row.shape)
