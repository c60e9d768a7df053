"""What keeps XLA on a CPU from computing a thing many times, in a bad order, or on copies."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float

_flat = ContextVar("flat", default=False)  # within `flat_products`


def materialise(tree: Any, never: jax.Array | bool) -> Any:
    """The same arrays, computed once and kept, though many operations read them.

    XLA on a CPU computes a cheap-looking sine anew in each operation that needs it. A loop that
    never turns stops that; `never` must be false, and XLA must not be able to tell. It has the
    derivatives of what it is given.
    """
    return _materialise(tree, never)


@jax.custom_jvp
def _materialise(tree: Any, never: jax.Array | bool) -> Any:
    def turn(carry: tuple[jax.Array, Any]) -> tuple[jax.Array, Any]:
        other = jax.tree.map(lambda x: ~x if x.dtype == bool else x + 1, carry[1])
        return jnp.zeros((), bool), other

    return jax.lax.while_loop(lambda carry: carry[0], turn, (jnp.asarray(never), tree))[1]


@_materialise.defjvp
def _(primals: Any, tangents: Any) -> Any:
    return _materialise(*primals), tangents[0]


def on_cpu() -> bool:
    """Whether what is traced now will run on a CPU, unless told otherwise."""
    return jax.default_backend() == "cpu"


def whole_gradient(
    y: Float[Array, "*rows outputs"], like: Array, kept: bool = False
) -> Float[Array, "*rows outputs"]:
    """`y`; within `flat_products` its gradient is worked out whole before any product with it.

    A weight's gradient needs that of the layer's output transposed. XLA on a CPU works it out in
    that order, along columns: where much leads to it, as behind attention, several times slower.
    With `kept`, `y` too is worked out once there, though many operations read it.
    `like` is any array of finite numbers that all rows share, such as the weights. Elsewhere `y`
    has derivatives of both modes.
    """
    wanted = _flat.get() and on_cpu()
    return _whole_gradient(y, like, kept) if wanted else y


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def _whole_gradient(y: Array, like: Array, kept: bool) -> Array:
    return _whole(y, like) if kept else y


def _forward(y: Array, like: Array, kept: bool) -> tuple[Array, Array]:
    return _whole_gradient(y, like, kept), like


def _backward(kept: bool, like: Array, gradient: Array) -> tuple[Array, Array]:
    return _whole(gradient, like), jnp.zeros_like(like)


def _whole(x: Array, like: Array) -> Array:
    return materialise(x, jnp.isinf(like.ravel()[0]))


_whole_gradient.defvjp(_forward, _backward)


@contextmanager
def flat_products() -> Iterator[None]:
    """Within, `product` under `jax.vmap` is one product of matrices, and so is its gradient.

    For gradients of a batch on a CPU, where XLA else copies what it multiplies. There and only
    there: within, what is not under `jax.vmap` has no gradient.
    """
    before = _flat.set(True)
    try:
        yield
    finally:
        _flat.reset(before)


def product(
    x: Float[Array, "*rows inputs"], weight: Float[Array, "inputs outputs"]
) -> Float[Array, "*rows outputs"]:
    """`x @ weight`."""
    return _flat_product(x, weight) if _flat.get() else x @ weight


@custom_vmap
def _flat_product(x: Array, weight: Array) -> Array:
    return x @ weight


@_flat_product.def_vmap
def _(size: int, batched: Any, x: Array, weight: Array) -> tuple[Array, bool]:
    if batched[1]:
        return jax.vmap(jnp.matmul, (0 if batched[0] else None, 0))(x, weight), True
    rows = x.reshape(-1, x.shape[-1]) @ weight
    return rows.reshape(*x.shape[:-1], -1), True
