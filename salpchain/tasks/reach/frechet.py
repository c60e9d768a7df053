"""Discrete Frechet distance between two chains of points (Eiter and Mannila 1994; paper 3.1.1)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.batching import over_the_batch, redo
from salpchain.physics.derivatives import root

AT_ONCE = 4  # chains whose tables are filled together (chosen)


def frechet_distance(
    one: Float[Array, "point 2"], other: Float[Array, "point 2"], length: int | Array | None = None
) -> Float[Array, ""]:
    """Smallest leash (m) that lets two walkers go along both chains of points without going back.

    Only the first `length` points of both count (all of them by default). The coupling table is
    filled one antidiagonal at a time: entry i of a diagonal pairs point i of `one` with point
    k - i of `other`.
    """
    num = one.shape[0]
    last = num - 1 if length is None else length - 1
    rows = jnp.arange(num)
    infinite = jnp.full(num, jnp.inf)

    def fill(k: Array, diagonals: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        before_last, previous, result = diagonals
        column = k - rows
        apart = _distance(one, other[jnp.clip(column, 0, num - 1)])
        reached = jnp.minimum(jnp.minimum(previous, _shift(previous)), _shift(before_last))
        entry = jnp.where(k == 0, apart, jnp.maximum(apart, reached))
        entry = jnp.where((column >= 0) & (column < num), entry, jnp.inf)
        result = jnp.where(k == 2 * last, entry[jnp.asarray(last)], result)
        return previous, entry, result

    start = (infinite, infinite, jnp.inf)
    return jax.lax.fori_loop(0, 2 * num - 1, fill, start)[2]


def _shift(diagonal: Float[Array, " point"]) -> Float[Array, " point"]:
    return jnp.concatenate([jnp.full(1, jnp.inf), diagonal[:-1]])


def _distance(one: Float[Array, "point 2"], other: Float[Array, "point 2"]) -> Array:
    return root(jnp.sum((one - other) ** 2, axis=-1))


def within_frechet(
    one: Float[Array, "point 2"],
    other: Float[Array, "point 2"],
    length: int | Array,
    limit: float,
) -> Bool[Array, ""]:
    """Whether `frechet_distance` is at most `limit` (m), at little cost when that is plain to see.

    The distance between the two first and the two last points is a lower bound, the largest
    distance between points of the same index an upper one. The table is filled only for the
    chains of a batch that lie between the two.
    """
    return _within(limit, one, other, jnp.asarray(length))


@over_the_batch
def _within(limit: float, one: Array, other: Array, length: Array) -> Array:
    one, other = jax.lax.stop_gradient((one, other))  # yes or no: it has no derivative
    points, _, batch = one.shape
    length = jnp.broadcast_to(length, (batch,))
    apart = jnp.sqrt(jnp.sum((one - other) ** 2, axis=1))
    ends = jnp.maximum(apart[0], jnp.take_along_axis(apart, length[None] - 1, axis=0)[0])
    counts = jnp.arange(points)[:, None] < length
    certain = jnp.max(jnp.where(counts, apart, 0.0), axis=0) <= limit

    def look(chosen: Array) -> Array:
        parts = (one[..., chosen], other[..., chosen], length[chosen])
        return jax.vmap(frechet_distance, in_axes=(-1, -1, 0))(*parts) <= limit

    doubtful = (ends <= limit) & ~certain
    return redo(doubtful, certain, look, min(batch, AT_ONCE))
