"""What the domain's functions are given, checked when they are traced; free once compiled."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.errors import InputError
from salpchain.tasks.reach.config import SHORTEST


def check_key(key: Any) -> None:
    """Raise InputError unless this is one random key."""
    dtype, shape = getattr(key, "dtype", None), jnp.shape(key)
    if dtype is not None and jnp.issubdtype(dtype, jax.dtypes.prng_key):
        keys = shape
    elif dtype == np.uint32 and shape:  # of the old kind: `jax.random.PRNGKey`
        keys = shape[:-1]
    else:
        raise InputError(f"reset takes a random key, such as jax.random.key(0), got {_told(key)}")
    if keys:
        raise InputError(f"reset takes one random key, got {keys} of them{_batch('reset')}")


def check_number(length: Any, slots: int) -> None:
    """Raise InputError unless this many units fit; of a traced number, unless it is a whole one."""
    if isinstance(length, str) or jnp.shape(length) or not _is_whole(length):
        raise InputError(f"length must be one whole number of units, got {_told(length)}")
    if isinstance(length, bool):
        raise InputError(f"length must be a whole number of units, got {length}")
    if isinstance(length, int | np.integer) and not SHORTEST <= length <= slots:
        raise InputError(f"length must be {SHORTEST} to {slots} units here, got {length}")


def _is_whole(number: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(number), jnp.integer)


def check_start(chain: Any, target: Any, slots: int) -> None:
    """Raise InputError unless a chain of this many slots and its target fit together."""
    shapes = {
        "the chain's unit positions": (chain.units.position, (slots, 2)),
        "the chain's unit angles": (chain.units.angle, (slots,)),
        "the chain's link positions": (chain.links.position, (slots - 1, 2)),
        "the target": (target, (slots, 2)),
    }
    for name, (given, shape) in shapes.items():
        if jnp.shape(given) != shape:
            batch = _batch("start") if jnp.ndim(given) > len(shape) else ""
            raise InputError(
                f"{name} must have shape {shape} for {slots} units, got {jnp.shape(given)}{batch}"
            )


def check_state(state: Any, function: str) -> None:
    """Raise InputError unless this is the state of one chain."""
    if state.obs.ndim != 2:
        raise InputError(
            f"{function} takes the state of one chain, got observations of shape"
            f" {state.obs.shape}{_batch(function)}"
        )


def checked_action(
    action: Any, shape: tuple[int, int], like: Float[Array, " unit"]
) -> Float[Array, "unit act"]:
    """The action, in the chain's precision.

    Raises:
        InputError: another shape, or no real numbers.
    """
    if jnp.shape(action) != shape:
        batch = _batch("step") if jnp.ndim(action) > 2 else ""
        raise InputError(
            f"action must have shape {shape}, a row for each unit, got {jnp.shape(action)}{batch}"
        )
    dtype = jnp.result_type(action)
    if not (jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)):
        raise InputError(f"action must be real numbers, got {_told(action)}")
    return jnp.asarray(action).astype(like.dtype)


def _batch(function: str) -> str:
    return f": for a batch, use jax.vmap({function})"


def _told(given: Any) -> str:
    """A short description of what was given."""
    if getattr(given, "dtype", None) is None:
        return repr(given)
    return f"{given.dtype} of shape {jnp.shape(given)}"
