"""Who listens to whom: graphs over the units of a chain (paper section 3.2.1, Figure 2)."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


@runtime_checkable
class Graph(Protocol):
    """A graph with a self loop at each present node."""

    def degree(self) -> Int[Array, " unit"]:
        """Number of nodes that each node sees, itself counted."""
        ...

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """For each node, the sum of the values of the nodes that it sees."""
        ...


class ChainGraph(eqx.Module):
    """`mixed`: each unit sees itself and the units that a link joins to it; O(n)."""

    present: Bool[Array, " unit"]
    joined: Bool[Array, " link"]

    def degree(self) -> Int[Array, " unit"]:
        """1, plus 1 for each joined neighbour."""
        none = jnp.zeros(1, jnp.int32)
        links = self.joined.astype(jnp.int32)
        return 1 + jnp.concatenate([none, links]) + jnp.concatenate([links, none])

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """Own value plus those of the joined neighbours."""
        joined = self.joined[:, None]
        none = jnp.zeros_like(values[:1])
        previous = jnp.concatenate([none, jnp.where(joined, values[:-1], 0.0)])
        following = jnp.concatenate([jnp.where(joined, values[1:], 0.0), none])
        return values + previous + following


class DenseGraph(eqx.Module):
    """Any graph: `sees[i, j]` says whether node i sees node j."""

    sees: Bool[Array, "unit unit"]

    def degree(self) -> Int[Array, " unit"]:
        """Row sums, at least 1."""
        return jnp.maximum(self.sees.sum(axis=1), 1)

    def gather(self, values: Float[Array, "unit feature"]) -> Float[Array, "unit feature"]:
        """Sums over each row."""
        return self.sees.astype(values.dtype) @ values


def mixed(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> ChainGraph:
    """n + 2 (n - 1) directed edges for a chain of n units."""
    return ChainGraph(present, joined)


def full(present: Bool[Array, " unit"], joined: Bool[Array, " link"]) -> DenseGraph:
    """n^2 directed edges: every present unit sees every present unit."""
    return DenseGraph((present[:, None] & present) | jnp.eye(present.shape[0], dtype=bool))


GRAPHS: dict[str, Callable[[Array, Array], Graph]] = {"mixed": mixed, "full": full}
