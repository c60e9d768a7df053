"""Global switches of JAX that a program may set for its own code, and ours need not follow.

Strict promotion of types and ranks and a mesh with explicit sharding are such switches: they hold
for whoever set them, while functions of this package run as they were tested.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp

from salpchain.errors import InputError

Given = ParamSpec("Given")
Result = TypeVar("Result")


def standard_promotion(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, traced or run under JAX's standard promotion of types and ranks."""

    @functools.wraps(function)
    def run(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            return function(*args, **kwargs)

    return run


def automatic(function: Callable[..., Any], trees: Any) -> Any:
    """What the function gives for arrays whose first axis may be sharded explicitly, as its results
    then are.

    Within, XLA chooses how arrays are sharded: explicitly, each reshaping would need to be told.
    """
    axes = {jax.typeof(leaf).sharding.spec[0] for leaf in jax.tree.leaves(trees) if jnp.ndim(leaf)}
    axes -= {None}
    if not axes:
        return function(*trees)
    spec = jax.sharding.PartitionSpec(axes.pop())
    return jax.sharding.auto_axes(function, out_sharding=spec)(*trees)


@contextmanager
def refused_if_sharded(function: str) -> Iterator[None]:
    """Raise InputError with the remedy where JAX cannot tell how an explicitly sharded batch goes
    on."""
    try:
        yield
    except Exception as error:
        if type(error).__name__ != "ShardingTypeError":  # JAX does not show it
            raise
        raise InputError(
            f"{function} does not take a batch on a mesh with explicit axes: make the mesh with"
            " jax.sharding.AxisType.Auto, or use jax.sharding.auto_axes"
        ) from None


def own_mesh(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """`standard_promotion` for a function that is never traced and brings a mesh of its own.

    A mesh that was set with `jax.set_mesh` is set again when the function returns.
    """

    @functools.wraps(function)
    def run(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with ExitStack() as switches:
            if not jax.sharding.get_abstract_mesh().empty:
                switches.enter_context(jax.set_mesh(None))
            return standard_promotion(function)(*args, **kwargs)

    return run
