"""Who listens to whom: graphs over the units of a chain (paper section 3.2.1, Figure 2)."""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Shaped

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.networks.config import REACH

Heads = Float[Array, "unit *head feature"]
Scores = Float[Array, "unit seen *head"]
Compare = Callable[[Array, Array], Array]  # (..., feature), twice, to (...)


@runtime_checkable
class Graph(Protocol):
    """A graph with a self loop at each present node: the units, then other nodes if it has any."""

    @property
    def nodes(self) -> int:
        """Number of nodes, empty slots counted."""
        ...

    def degree(self) -> Float[Array, " unit"]:
        """How many nodes each sees, itself counted, by their weights if they have any."""
        ...

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """For each node, the sum of the values of the nodes that it sees."""
        ...

    def products(self, query: Heads, key: Heads) -> Scores:
        """Scalar products of each node's query with the keys of the nodes that it may see."""
        ...

    def compare(self, with_each: Compare, query: Heads, key: Heads) -> Scores:
        """The same with any comparison of two nodes instead of the scalar product."""
        ...

    def attend(self, scores: Scores, values: Heads) -> Heads:
        """Values of the nodes seen, weighted by the softmax of the scores over these nodes."""
        ...


class ChainGraph(eqx.Module):
    """`mixed`: each unit sees itself and the units that a link joins to it; O(n)."""

    present: Bool[Array, " unit"]
    joined: Bool[Array, " link"]

    @property
    def nodes(self) -> int:
        """Number of slots."""
        return self.present.shape[0]

    def degree(self) -> Float[Array, " unit"]:
        """1, plus 1 for each joined neighbour."""
        return self._seen().sum(axis=1, dtype=jnp.float32)

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """Own value plus those of the joined neighbours."""
        joined = self.joined[:, None]
        none = jnp.zeros_like(values[:1])
        previous = jnp.concatenate([none, jnp.where(joined, values[:-1], 0.0)])
        following = jnp.concatenate([jnp.where(joined, values[1:], 0.0), none])
        return values + previous + following

    def products(self, query: Heads, key: Heads) -> Scores:
        """With the previous unit, the unit itself, the next unit."""
        return self.compare(lambda one, other: (one * other).sum(axis=-1), query, key)

    def compare(self, with_each: Compare, query: Heads, key: Heads) -> Scores:
        """With the previous unit, the unit itself, the next unit."""
        return jnp.stack([with_each(query, other) for other in _along(key)], axis=1)

    def attend(self, scores: Scores, values: Heads) -> Heads:
        """Of the previous unit, the unit itself, the next unit."""
        weights = _softmax(scores, self._seen())
        sides = zip(jnp.unstack(weights, axis=1), _along(values), strict=True)
        previous, own, following = (weight[..., None] * side for weight, side in sides)
        return previous + own + following

    def _seen(self) -> Bool[Array, "unit 3"]:
        """Whether each unit sees the one before it, itself, and the one after it."""
        none = jnp.zeros(1, bool)
        own = jnp.ones(self.present.shape, bool)
        return jnp.stack(
            [jnp.concatenate([none, self.joined]), own, jnp.concatenate([self.joined, none])], 1
        )


def _along(values: Shaped[Array, "unit *rest"]) -> tuple[Array, Array, Array]:
    """What the unit before has, what each has, what the unit after has; zeros at the ends."""
    none = jnp.zeros_like(values[:1])
    return (
        jnp.concatenate([none, values[:-1]]),
        values,
        jnp.concatenate([values[1:], none]),
    )


class DenseGraph(eqx.Module):
    """Any graph: `sees[i, j]` says whether node i sees node j. Each must see some node.

    Memory for a layer is O(n^2) scores and O(n) features.
    """

    sees: Bool[Array, "unit unit"]

    @property
    def nodes(self) -> int:
        """Number of rows."""
        return self.sees.shape[0]

    def degree(self) -> Float[Array, " unit"]:
        """Row sums, at least 1."""
        return jnp.maximum(self.sees.sum(axis=1, dtype=jnp.float32), 1)

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """Sums over each row."""
        return self.sees.astype(values.dtype) @ values

    def products(self, query: Heads, key: Heads) -> Scores:
        """With every node."""
        return jnp.einsum("i...f,j...f->ij...", query, key)

    def compare(self, with_each: Compare, query: Heads, key: Heads) -> Scores:
        """With every node, row by row, so that no features of all pairs are ever kept."""
        row = jax.checkpoint(lambda one: with_each(one, key))  # type: ignore[attr-defined]
        return jax.lax.map(row, query)

    def attend(self, scores: Scores, values: Heads) -> Heads:
        """Of every node seen."""
        return jnp.einsum("ij...,j...f->i...f", _softmax(scores, self.sees), values)


class HubGraph(DenseGraph):
    """A dense graph whose last node hears the mean of the units, not their sum.

    The weights of what it hears sum to 1, so that in a graph convolution neither what it hears nor
    what it tells grows or fades with the length of the chain. Attention has weights of its own.
    """

    def degree(self) -> Float[Array, " unit"]:
        """Row sums; of the hub 2: itself and the mean."""
        return super().degree().at[-1].set(2.0)

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """Sums over each row; of the hub its own value and the mean of the units'."""
        units = self.sees[-1, :-1].astype(values.dtype)
        heard = units @ values[:-1] / jnp.maximum(units.sum(), 1)
        return super().gather(values).at[-1].set(values[-1] + heard)


def _softmax(scores: Scores, seen: Bool[Array, "unit seen"]) -> Scores:
    """Over the nodes seen; the others weigh nothing."""
    seen = seen.reshape(seen.shape + (1,) * (scores.ndim - 2))
    return jax.nn.softmax(jnp.where(seen, scores, -jnp.inf), axis=1)


def mixed(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> ChainGraph:
    """n + 2 (n - 1) directed edges for a chain of n units."""
    return ChainGraph(present, joined)


def full(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> DenseGraph:
    """n^2 directed edges: every present unit sees every present unit."""
    return of_adjacency(present[:, None] & present)


def near(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> DenseGraph:
    """Each unit sees those at most `REACH` joined links away: between `mixed` and `full`. Ours."""
    slot = jnp.arange(present.shape[0])
    piece = jnp.concatenate([jnp.zeros(1, int), jnp.cumsum(~joined)])  # of a chain that was cut
    within = jnp.abs(slot[:, None] - slot) <= REACH
    return of_adjacency(within & (piece[:, None] == piece) & present[:, None] & present)


def hub(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> HubGraph:
    """`mixed`, and one node more, last, that sees every unit and that every unit sees. Ours."""
    sees = jnp.diag(present) | jnp.diag(joined, 1) | jnp.diag(joined, -1)
    sees = jnp.pad(sees, (0, 1)).at[:-1, -1].set(present).at[-1, :-1].set(present)
    return HubGraph(of_adjacency(sees).sees)


def of_adjacency(sees: ArrayLike | Sequence) -> DenseGraph:
    """Your own graph, (n, n) of bool: `sees[i, j]` says that unit i hears unit j.

    Self loops are added. Leave rows and columns of dead slots false.

    Raises:
        InputError: not a square of booleans.
    """
    try:
        square = jnp.asarray(sees)
    except (TypeError, ValueError):
        raise InputError(f"a graph is an (n, n) array of bool, got {told(sees)}") from None
    shape, kind = square.shape, square.dtype
    if len(shape) != 2 or shape[0] != shape[1] or not jnp.issubdtype(kind, jnp.bool_):
        raise InputError(f"a graph is an (n, n) array of bool, got {kind} of shape {shape}")
    return DenseGraph(square | jnp.eye(shape[0], dtype=bool))


GRAPHS: dict[str, Callable[[Array, Array], Graph]] = {
    "mixed": mixed,
    "full": full,
    "near": near,
    "hub": hub,
}
