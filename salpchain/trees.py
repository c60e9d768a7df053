"""Pytrees of arrays as named arrays and back, for files."""

from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from salpchain.errors import InputError
from salpchain.files import Arrays


def to_arrays(tree: Any) -> Arrays:
    """Every leaf under its path, e.g. `trunk.first.linear.weight`; random keys as their data."""
    return {name: np.asarray(_plain(leaf)) for name, leaf in _named(tree)}


def from_arrays(template: Any, arrays: Arrays, what: str, cast: bool = False) -> Any:
    """The template (arrays or their shapes) with the named arrays as leaves.

    With `cast`, floating-point numbers of another precision are taken in the template's.

    Raises:
        InputError: an array is missing, left over, or of another shape or type.
    """
    named = _named(template)
    names = [name for name, _ in named]
    odd = sorted(set(names) ^ set(arrays))
    if odd:
        raise InputError(f"{what} does not hold what it should: {odd[0]} is missing or left over")
    leaves = [_restore(leaf, arrays[name], f"{name} in {what}", cast) for name, leaf in named]
    return jax.tree.unflatten(jax.tree.structure(template), leaves)


def _named(tree: Any) -> list[tuple[str, Any]]:
    paths = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [(jax.tree_util.keystr(path).lstrip("."), leaf) for path, leaf in paths]


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _plain(leaf: Any) -> Any:
    return jr.key_data(leaf) if _is_key(leaf) else leaf


def _restore(leaf: Any, array: np.ndarray, name: str, cast: bool) -> Any:
    like = jax.eval_shape(_plain, leaf)
    if cast and all(np.issubdtype(x.dtype, np.floating) for x in (array, like)):
        array = array.astype(like.dtype)
    if array.shape != like.shape or array.dtype != like.dtype:
        raise InputError(
            f"{name} has shape {array.shape} and type {array.dtype}, expected {like.shape}"
            f" and {like.dtype}"
        )
    return jr.wrap_key_data(jnp.asarray(array)) if _is_key(leaf) else jnp.asarray(array)
