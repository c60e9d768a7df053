"""Global switches of JAX that a program may set for its own code, and ours need not follow.

Strict promotion of types and ranks and a mesh with explicit sharding are such switches: they hold
for whoever set them, while functions of this package run as they were tested.
"""

import functools
from collections.abc import Callable
from contextlib import ExitStack
from typing import ParamSpec, TypeVar

import jax

Given = ParamSpec("Given")
Result = TypeVar("Result")


def standard_promotion(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """The function, traced or run under JAX's standard promotion of types and ranks."""

    @functools.wraps(function)
    def run(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            return function(*args, **kwargs)

    return run


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
