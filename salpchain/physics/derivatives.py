"""Elementary functions that also have their right derivative where JAX's own is not a number, or 0.

Chains lie exactly there: at rest a joint is closed, a unit is parallel to its link, a dead slot has
no neighbour. Values are those of the plain expressions, bit for bit.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.custom_jvp
def root(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The square root; its derivative at 0, a corner of a distance, is 0."""
    return jnp.sqrt(x)


@root.defjvp
def _root(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = root(*primals)
    slope = jnp.where(value > 0, 0.5 / jnp.where(value > 0, value, 1.0), 0.0)
    return value, tangents[0] * slope


@jax.custom_jvp
def scaled_expm1(scale: Any, x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """scale (exp|x| - 1) sign(x), which is smooth: its slope is scale exp|x|, at 0 too."""
    return scale * (jnp.exp(jnp.abs(x)) - 1) * jnp.sign(x)


@scaled_expm1.defjvp
def _scaled_expm1(primals: tuple[Any, Array], tangents: tuple[Any, Array]) -> tuple[Array, Array]:
    (scale, x), (by_scale, by_x) = primals, tangents
    return scaled_expm1(scale, x), scaled_expm1(by_scale, x) + scale * jnp.exp(jnp.abs(x)) * by_x


@jax.custom_jvp
def compress(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sign(x) log(1 + 5 |x|): metres far away stay in the range seen near by."""
    return jnp.sign(x) * jnp.log1p(5 * jnp.abs(x))


@compress.defjvp
def _compress(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return compress(*primals), tangents[0] * 5 / (1 + 5 * jnp.abs(primals[0]))


@jax.custom_jvp
def direction(y: Float[Array, "*shape"], x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The angle of a vector (rad); of no vector 0, with the derivative 0."""
    return jnp.arctan2(y, x)


@direction.defjvp
def _direction(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    (y, x), (dy, dx) = primals, tangents
    square = x * x + y * y
    there = square > 0
    turn = (x * dy - y * dx) / jnp.where(there, square, 1.0)
    return direction(y, x), jnp.where(there, turn, 0.0)
