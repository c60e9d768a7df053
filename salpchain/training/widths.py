"""Chains of many lengths, worked on few at a time, with no more slots than those few need.

A batch of mixed lengths has as many slots as its longest chain, half of them dead on the average.
On a CPU a network's work is worth sorting by length: dead slots of short chains are left out.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from salpchain.xla import on_cpu

# Units whose activations are worked on at a time: on a CPU they stay in a core's cache, which
# saves up to half of an update's time (measured).
CACHED_ROWS = 512
MOST_WIDTHS = 4  # numbers of slots for which a program is compiled (chosen)


def widths_of(lengths: Sequence[int]) -> tuple[int, ...]:
    """Numbers of slots, ascending, that share out these lengths evenly; the last serves all.

    A single one where there is nothing to win: of one length, or on other than a CPU, which takes
    a batch whole.
    """
    count = min(MOST_WIDTHS, len(lengths)) if on_cpu() else 1
    last = [-(-len(lengths) * part // count) - 1 for part in range(1, count + 1)]
    return tuple(lengths[place] for place in last)


def by_length(present: Bool[Array, "chain unit"], size: int) -> Int[Array, "part some"]:
    """The places of all chains in parts of `size`, sorted by length, so that each has its likes."""
    return jnp.argsort(present.sum(axis=1)).reshape(-1, size)


def at_width(
    widths: Sequence[int],
    present: Bool[Array, "chain unit"],
    function: Callable[..., Any],
    *args: Any,
) -> Any:
    """`function(width, *args)` with the least width that has room for these chains."""
    if len(widths) == 1:
        return function(widths[0], *args)
    longest = present.sum(axis=1).max()
    which = (longest > jnp.array(widths[:-1])).sum()
    return jax.lax.switch(which, [partial(function, width) for width in widths], *args)
