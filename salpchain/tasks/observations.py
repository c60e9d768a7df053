"""Observations worked out: features (`tasks/features.py`) of a chain, its target and its world.

The features are worked out as rows, one number of every unit, with the batch of chains last
(see `physics.batching`): units are the first axis of every row, whether a batch follows or not.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from salpchain.dynamics.robot import scale_of, tempo_of
from salpchain.physics import derivatives
from salpchain.physics.batching import over_the_batch
from salpchain.physics.derivatives import direction
from salpchain.physics.state import Chain, wrap
from salpchain.tasks.features import SENSED, Observation, features, readings
from salpchain.tasks.view import Pair, Row, View
from salpchain.world.surfaces import nearest_surface, rays
from salpchain.world.world import World
from salpchain.xla import materialise


class Around(NamedTuple):
    """The world of an episode and the control step, for features that sense of it."""

    world: World
    time: Int[Array, ""] | int


def _water(chain: Chain, around: Around) -> Float[Array, "unit 2"]:
    """Velocity (m/s) of each unit relative to the water."""
    if around.world.current is None:
        return chain.units.velocity
    return chain.units.velocity - around.world.current.flow(chain.units.position).velocity


def _surface(chain: Chain, around: Around) -> Float[Array, "unit 2"]:
    if around.world.obstacles is None:
        return jnp.zeros_like(chain.units.position)
    return nearest_surface(chain, around.world.obstacles)


def _rays(chain: Chain, around: Around) -> Float[Array, "unit ray"]:
    if around.world.obstacles is None:
        return jnp.ones_like(chain.units.position, shape=(len(chain.present), 8))
    return rays(chain, around.world.obstacles)


def _thruster(chain: Chain, around: Around) -> Float[Array, "unit 1"]:
    """Gain of each unit's thruster now."""
    like = chain.units.angle
    if around.world.thrusters is None:
        return jnp.ones_like(like)[:, None]
    return around.world.thrusters.working(jnp.asarray(around.time), like)[:, None]


def _reverse(chain: Chain, around: Around) -> Float[Array, "unit 1"]:
    """Gain of each unit's thruster backwards now: 0 of jets that push one way."""
    gain = _thruster(chain, around)
    thrusters = around.world.thrusters
    return gain if thrusters is None else jnp.where(thrusters.one_sided, 0.0, gain)


# What a feature can name among its `senses`, (unit, number): in world axes, `surface` in the unit's
SENSES: dict[str, Callable[[Chain, Around], Array]] = {
    "water": _water,
    "surface": _surface,
    "rays": _rays,
    "thruster": _thruster,
    "reverse": _reverse,
}


def observe(
    name: str,
    chain: Chain,
    target: Float[Array, "unit 2"],
    force: Float[Array, "unit 2"],
    around: Around | None = None,
) -> Float[Array, "unit feature"]:
    """The named observation of one chain; zeros in dead slots. Fast under `jax.vmap`.

    One of several control steps as if all had been as now; `with_history` has them as they were.

    Args:
        name: as in `features.features`.
        chain: where the chain is.
        target: one point (m) for each unit.
        force: of each unit's thrust in the last control step (N, world axes), as it acted.
        around: where it swims; still water without obstacles if not given.
    """
    observation = features(name)
    around = Around(World(), 0) if around is None else around
    wanted = dict.fromkeys(sense for feature in observation for sense in feature.senses)
    sensed = {sense: SENSES[sense](chain, around) for sense in wanted}
    scale, tempo = scale_of(around.world.dynamics), tempo_of(around.world.dynamics)
    if (scale, tempo) != (1.0, 1.0):
        chain, target, sensed = _as_paper(chain, target, sensed, scale, tempo)
    return jnp.tile(_observe(observation, chain, target, force, sensed), (1, readings(name)[1]))


def _as_paper(
    chain: Chain, target: Array, sensed: dict[str, Array], scale: float, tempo: float
) -> tuple[Chain, Array, dict[str, Array]]:
    """What is observed in lengths of a link and times of its way, told as if it were the paper's:
    so the numbers that a policy sees are of the size that they have there."""
    units = chain.units
    seen = units.position / scale, units.velocity * (tempo / scale), units.angular_velocity * tempo
    chain = eqx.tree_at(
        lambda c: (c.units.position, c.units.velocity, c.units.angular_velocity), chain, seen
    )
    sensed = {
        sense: rows * (tempo / scale) if sense == "water" else rows
        for sense, rows in sensed.items()
    }
    return chain, target / scale, sensed


def with_history(
    name: str, now: Float[Array, "unit feature"], before: Float[Array, "unit feature"]
) -> Float[Array, "unit feature"]:
    """The observation now, the steps before taken from the observation of one step before."""
    count = readings(name)[1]
    if count == 1:
        return now
    reading = now.shape[1] // count
    return jnp.concatenate([now[:, :reading], before[:, :-reading]], axis=1)


@over_the_batch
def _observe(
    observation: Observation, chain: Chain, target: Array, force: Array, sensed: dict[str, Array]
) -> Array:
    view = ChainView(chain, target, force, sensed)
    rows = [row for feature in observation for row in feature.rows(view)]
    return jnp.where(chain.present[:, None], jnp.stack(rows, axis=1), 0.0)


class ChainView(View):
    """The chain and its target as rows; `View` says what each is."""

    def __init__(
        self, chain: Chain, target: Array, force: Array, sensed: Mapping[str, Array]
    ) -> None:
        """Rows of a chain, of a batch of chains with the batch last."""
        self.chain, self.force = chain, _pair(force)
        self.position = _pair(chain.units.position)
        self.velocity = _pair(chain.units.velocity)
        self.angle, self.angular_velocity = chain.units.angle, chain.units.angular_velocity
        self.target = _pair(target)
        self.sensed = {
            name: tuple(x[:, k] for k in range(x.shape[1])) for name, x in sensed.items()
        }
        never = chain.present.sum() < 0
        self.turn: Pair = materialise((jnp.cos(self.angle), jnp.sin(self.angle)), never)

    @cached_property
    def centroid(self) -> Pair:
        """Mean position of the chain's units (m)."""
        return self.mean(self.position)

    @cached_property
    def target_centroid(self) -> Pair:
        """Mean of the target points (m)."""
        return self.mean(self.target)

    @cached_property
    def piece(self) -> tuple[Row, Row]:
        """Which unit of its piece each is, from 1 on, and of how many, in a chain that can part."""
        one = jnp.ones_like(self.angle)[:, None]
        return tuple(row[:, 0] for row in _along_pieces(one, self.chain.joined))  # type: ignore[return-value]

    def mean(self, pair: Pair) -> Pair:
        """Mean over the present units; of each unit's own piece, in a chain that can part."""
        present = self.chain.present
        if self.chain.docking is not None:
            share = 1 / self.piece[1]
            _, sums = _along_pieces(jnp.stack(pair, axis=1), self.chain.joined)
            return sums[:, 0] * share, sums[:, 1] * share
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
        x, y, equal, square = self._nearest()
        apart = jnp.maximum(derivatives.root(square), 1e-6)
        share = jnp.maximum(1 / apart - 1 / SENSED, 0.0) / jnp.maximum(equal, 1)
        return x * share, y * share

    def _nearest(self) -> tuple[Row, Row, Row, Row]:
        """Offsets (m) of each unit to the nearest that are no neighbours and equally far: their
        sum, their number, and the square of their length, which is infinite where there is none.

        All units `shift` places on are looked at in turn, so that no array holds all pairs.
        """
        here, (x, y) = self.chain.present, self.position
        joined = jnp.concatenate([self.chain.joined, jnp.zeros_like(here[:1])])
        twice = [jnp.concatenate([row, row]) for row in (x, y, here, joined)]

        def look(shift: Array, found: tuple[Row, Row, Row, Row]) -> tuple[Row, Row, Row, Row]:
            there = [lax.dynamic_slice_in_dim(row, shift, len(here)) for row in twice]
            neighbour = ((shift == 1) & joined) | ((shift == len(here) - 1) & there[3])
            offset = there[0] - x, there[1] - y
            square = offset[0] ** 2 + offset[1] ** 2
            square = jnp.where(here & there[2] & ~neighbour, square, jnp.inf)
            *kept, least = found
            equal = jnp.where((square <= least) & (square < jnp.inf), 1.0, 0.0)
            sums = (
                jnp.where(square < least, 0.0, old) + equal * new
                for old, new in zip(kept, (*offset, 1.0), strict=True)
            )
            return (*sums, jnp.minimum(least, square))  # type: ignore[return-value]

        none = jnp.zeros_like(x)
        return lax.fori_loop(1, len(here), look, (none, none, none, none + jnp.inf))

    def bearing(self, vector: Pair) -> Row:
        """Angle of a neighbour from the unit's own angle (rad, wrapped); 0 where there is none."""
        x, y = vector
        there = (x != 0) | (y != 0)
        return jnp.where(there, wrap(direction(y, x) - self.angle), 0.0)

    def bit(self, place: int) -> Row:
        """A bit of the unit's index in the chain."""
        return ((_indices(self.angle) >> place) & 1).astype(self.angle.dtype)

    def place(self) -> Row:
        """Place in the chain, from -1 (first) to 1 (last); in its piece, if it can part."""
        if self.chain.docking is not None:
            place, number = self.piece
            return (place - 1) * (2 / jnp.maximum(number - 1, 1)) - 1.0
        last = jnp.maximum(self.chain.present.sum(axis=0) - 1, 1)
        return _indices(self.angle) * (2 / last) - 1.0

    def wrap(self, angle: Row) -> Row:
        """An angle (rad) in [-pi, pi)."""
        return wrap(angle)

    def root(self, row: Row) -> Row:
        """The square root, with a derivative at 0."""
        return derivatives.root(row)

    def compress(self, row: Row) -> Row:
        """sign(x) log(1 + 5 |x|)."""
        return derivatives.compress(row)


def _along_pieces(rows: Array, joined: Array) -> tuple[Array, Array]:
    """The sum of rows (unit, number) over each unit's piece, up to the unit and in all.

    Once along the chain and once back, so that no array holds all pairs.
    """
    edge = jnp.zeros_like(joined[:1])
    before, after = (jnp.concatenate(x)[:, None] for x in ((edge, joined), (joined, edge)))

    def on(sums: Array, unit: tuple[Array, Array]) -> tuple[Array, Array]:
        row, goes_on = unit
        sums = jnp.where(goes_on, sums + row, row)
        return sums, sums

    def back(total: Array, unit: tuple[Array, Array]) -> tuple[Array, Array]:
        sums, goes_on = unit
        total = jnp.where(goes_on, total, sums)
        return total, total

    none = jnp.zeros_like(rows[0])
    _, sums = lax.scan(on, none, (rows, before), unroll=UNROLLED)
    return sums, lax.scan(back, none, (sums, after), reverse=True, unroll=UNROLLED)[1]


UNROLLED = 8  # units of a chain that a loop over it takes at once (chosen)


def _pair(vectors: Array) -> Pair:
    return vectors[:, 0], vectors[:, 1]


def _indices(row: Row) -> Array:
    """0, 1, 2, ... along the chain, in the shape of a row."""
    index = jnp.arange(row.shape[0]).reshape(-1, *(1,) * (row.ndim - 1))
    return jnp.broadcast_to(index, row.shape)
