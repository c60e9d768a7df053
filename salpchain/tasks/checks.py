"""What the functions of a task are given, checked when they are traced; free once compiled."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from salpchain.checks import SHORTEST
from salpchain.errors import InputError
from salpchain.given import index, instance, told
from salpchain.physics.state import Chain
from salpchain.starting import check_can_compute
from salpchain.tasks.state import State
from salpchain.world.obstacles import check_clear
from salpchain.world.world import World


def check_key(key: Any, function: str = "reset") -> None:
    """Raise InputError unless this is one random key."""
    dtype, shape = getattr(key, "dtype", None), getattr(key, "shape", ())
    if dtype is not None and jnp.issubdtype(dtype, jax.dtypes.prng_key):
        keys = shape
    elif dtype == np.uint32 and shape:  # of the old kind: `jax.random.PRNGKey`
        keys = shape[:-1]
    else:
        raise InputError(
            f"{function} takes a random key, such as jax.random.key(0), got {_told(key)}"
        )
    if keys:
        raise InputError(f"{function} takes one random key, got {keys} of them{_batch(function)}")


def check_number(length: Any, slots: int) -> None:
    """Raise InputError unless this many units fit; of a traced number, unless it is a whole one."""
    if isinstance(length, jax.Array):  # traced, or not worth waiting for
        if length.shape or not jnp.issubdtype(length.dtype, jnp.integer):
            raise InputError(f"length must be one whole number of units, got {_told(length)}")
        return
    number = index(length)
    if number is None:
        raise InputError(f"length must be one whole number of units, got {_told(length)}")
    if not SHORTEST <= number <= slots:
        raise InputError(f"length must be {SHORTEST} to {slots} units here, got {number}")


def check_chain(chain: Any, slots: int) -> None:
    """Raise InputError unless this is one chain of this many slots."""
    instance("chain", chain, Chain, "a salpchain.Chain")
    _check_shape("the chain's unit positions", chain.units.position, (slots, 2), slots)
    _check_shape("the chain's unit angles", chain.units.angle, (slots,), slots)
    _check_shape("the chain's link positions", chain.links.position, (slots - 1, 2), slots)


def checked_vectors(
    name: str, vectors: Any, like: Float[Array, "unit 2"]
) -> Float[Array, "unit 2"]:
    """A point or vector for each unit, in the precision of the units' positions.

    Raises:
        InputError: another shape than theirs, or no numbers.
    """
    vectors = _numbers(name, vectors, like.shape)
    _check_shape(name, vectors, like.shape, len(like))
    return vectors.astype(like.dtype)


def _check_shape(name: str, array: Any, shape: tuple[int, ...], slots: int) -> None:
    if jnp.shape(array) != shape:
        batch = _batch("start") if jnp.ndim(array) > len(shape) else ""
        raise InputError(
            f"{name} must have shape {shape} for {slots} units, got {jnp.shape(array)}{batch}"
        )


def check_state(state: Any, function: str, slots: int | None = None) -> None:
    """Raise InputError unless JAX can compute, and this is one chain's state, of so many slots."""
    check_can_compute()
    shape = getattr(getattr(state, "obs", None), "shape", None)
    if shape is None or not isinstance(getattr(state, "chain", None), Chain):
        raise InputError(f"{function} takes a state, as env.reset gives it, got {told(state)}")
    if len(shape) != 2:
        raise InputError(
            f"{function} takes the state of one chain, got observations of shape"
            f" {shape}{_batch(function)}"
        )
    if slots not in (None, shape[0]):
        raise InputError(
            f"{function} takes a state of {slots} slots, this environment's length, got one of"
            f" {shape[0]}: make both with the same length"
        )


def checked_clear(state: State, world: World) -> State:
    """The state of an episode that begins among obstacles of one's own.

    Raises:
        InputError: one of them is in the way of the chain, as far as its place is known now.
    """
    if world.obstacles is not None and not isinstance(state.chain.present, Tracer):
        check_clear(state.chain, world.obstacles, world.dynamics)
    return state


def checked_action(
    action: Any, shape: tuple[int, int], like: Float[Array, " unit"]
) -> Float[Array, "unit act"]:
    """The action, in the chain's precision.

    Raises:
        InputError: another shape, or no real numbers.
    """
    action = _numbers("action", action, shape)
    if action.shape != shape:
        batch = _batch("step") if action.ndim > 2 else ""
        raise InputError(
            f"action must have shape {shape}, a row for each unit, got {action.shape}{batch}"
        )
    return action.astype(like.dtype)


def _numbers(name: str, given: Any, shape: tuple[int, ...]) -> Array:
    """What was given, an array or rows of numbers, as an array of real numbers."""
    try:
        array = jnp.asarray(given)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers of shape {shape}, got {told(given)}") from None
    if not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        raise InputError(f"{name} must be real numbers, got {_told(array)}")
    return array


def _batch(function: str) -> str:
    return f": for a batch, use jax.vmap({function})"


def _told(given: Any) -> str:
    """A short description of what was given."""
    if getattr(given, "dtype", None) is None:
        return told(given)
    return f"{given.dtype} of shape {given.shape}"
