"""How a function written for the batch's last axis is called with one chain, or under `jax.vmap`.

On a CPU loops over a long last axis are several times faster than over the two coordinates of a
point, so the engine wants the batch last. Nobody outside this package sees that.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap

from salpchain.switches import automatic, standard_promotion


def over_the_batch(
    core: Callable[..., Any], differentiable: Callable[..., Any] | None = None
) -> Callable[..., Any]:
    """`core(static, *trees)`, whose arrays have the batch last, as a function of one chain.

    `static` is hashable and fixed at compile time. Under any nesting of `jax.vmap` the batch axes
    are merged into one and `core` is called once. Scalars that are the same for the whole batch
    reach it as scalars.

    Derivatives of both modes are those of `differentiable`, the same function in operations that
    have them; `core` itself if not given.
    """

    # JAX calls them later, where the switches of whoever batches or differentiates hold.
    plain, smooth = standard_promotion(core), standard_promotion(differentiable or core)

    @functools.wraps(core)
    def one(static: Any, *trees: Any) -> Any:
        return _for_one(plain, smooth, static)(*trees)

    return one


@functools.cache
def _for_one(
    core: Callable[..., Any], differentiable: Callable[..., Any], static: Any
) -> Callable[..., Any]:
    """The function of one chain: JAX's batching by hand has no derivative, so it gets one here."""
    batched = _batched(core, static)

    @jax.custom_jvp
    def one(*trees: Any) -> Any:
        return batched(*trees)

    def alone(*trees: Any) -> Any:
        last = jax.tree.map(lambda x: x[..., None] if jnp.ndim(x) else x, trees)
        return jax.tree.map(lambda x: x[..., 0], differentiable(static, *last))

    @one.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        return jax.jvp(alone, primals, tangents)

    return one


def _batched(core: Callable[..., Any], static: Any) -> Callable[..., Any]:
    many = _for_many(core, static)

    @custom_vmap
    def one(*trees: Any) -> Any:
        alone = jax.tree.map(lambda x: x[None] if jnp.ndim(x) else x, trees)
        return jax.tree.map(lambda x: x[0], many(*alone))

    @one.def_vmap
    def _(size: int, batched: Any, *trees: Any) -> Any:
        out = many(*jax.tree.map(functools.partial(_spread, size), trees, tuple(batched)))
        return out, jax.tree.map(lambda _: True, out)

    return one


@functools.cache
def _for_many(core: Callable[..., Any], static: Any) -> Callable[..., Any]:
    """`core` for arrays whose batch axis is first; a further batch axis is merged with it."""

    def first(*trees: Any) -> Any:
        last = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1) if jnp.ndim(x) else x, trees)
        return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), core(static, *last))

    traced = jax.jit(first, inline=True)  # once for each shape, in whatever programs it is

    @custom_vmap
    def many(*trees: Any) -> Any:
        return automatic(traced, trees)

    @many.def_vmap
    def _(size: int, batched: Any, *trees: Any) -> Any:
        flags = tuple(batched)
        inner = _inner_size(trees, flags)
        merged = jax.tree.map(functools.partial(_merge, size, inner), trees, flags)
        out = jax.tree.map(lambda x: x.reshape(size, inner, *x.shape[1:]), many(*merged))
        return out, jax.tree.map(lambda _: True, out)

    return many


def _spread(size: int, leaf: Any, batched: bool) -> Any:
    """The leaf with a batch axis in front; an unbatched scalar stays a scalar."""
    if batched or jnp.ndim(leaf) == 0:
        return leaf
    return jnp.broadcast_to(leaf, (size, *jnp.shape(leaf)))


def _inner_size(trees: Any, flags: Any) -> int:
    pairs = zip(jax.tree.leaves(trees), jax.tree.leaves(flags), strict=True)
    return next(x.shape[int(b)] for x, b in pairs if jnp.ndim(x) > int(b))


def _merge(size: int, inner: int, leaf: Any, batched: bool) -> Any:
    """(size, inner, ...) as (size * inner, ...), whatever of the two axes the leaf has."""
    if not batched:
        leaf = _spread(size, leaf, False)
    elif jnp.ndim(leaf) == 1:
        leaf = jnp.broadcast_to(leaf[:, None], (size, inner))
    return leaf.reshape(size * inner, *leaf.shape[2:]) if jnp.ndim(leaf) else leaf


def redo(
    flag: jax.Array, old: Any, make: Callable[[jax.Array], Any], chunk: int, axis: int = 0
) -> Any:
    """`old` with the flagged chains replaced by those that `make` gives for their indices.

    Works on `chunk` chains at a time, so rare work costs little, and nothing while no flag is set.
    `axis` is where all arrays have the batch. The other chains stay bit-identical.
    """

    def turn(carry: tuple[jax.Array, Any]) -> tuple[jax.Array, Any]:
        left, tree = carry
        fresh = make(jnp.nonzero(left, size=chunk, fill_value=0)[0])
        slot = jnp.cumsum(left) - 1
        filled = left & (slot < chunk)
        slot = jnp.clip(slot, 0, chunk - 1)
        placed = jax.tree.map(lambda x: jnp.take(x, slot, axis=axis), fresh)
        return left & ~filled, where(filled, placed, tree, axis)

    return jax.lax.while_loop(lambda carry: carry[0].any(), turn, (flag, old))[1]


def where(flag: jax.Array, one: Any, other: Any, axis: int = 0) -> Any:
    """For each chain of the batch, the arrays of `one` where the flag is true, else of `other`."""

    def pick(x: jax.Array, y: jax.Array) -> jax.Array:
        across = flag.reshape(flag.shape + (1,) * (x.ndim - flag.ndim)) if axis == 0 else flag
        return jnp.where(across, x, y)

    return jax.tree.map(pick, one, other)
