"""One of several worlds, chosen by a number that may be traced, as if it were the only one.

Worlds that are drawn from it have the same parts, whichever is chosen, so that one compiled program
plays them all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from salpchain.ranges import Range
from salpchain.world.config import WorldConfig


@dataclass(frozen=True, eq=False)
class Chosen:
    """The range of a setting in the world that is chosen."""

    low: Float[Array, ""]
    high: Float[Array, ""]
    most: float  # the largest number that can be drawn in any of the worlds
    is_fixed: bool = False


Which = int | Int[Array, ""]


def chosen(worlds: Sequence[WorldConfig], which: Which | Callable[[str], Which]) -> WorldConfig:
    """The settings of the world of this number; what is alike in all is as in each.

    Where they differ, a range is `Chosen`, and a flag an array. `which` may be a number for each
    setting, by its path.

    Raises:
        ValueError: a setting differs that must be known when a program is compiled.
    """
    return _chosen(worlds, which, "world")


def _chosen(values: Sequence[Any], which: Which | Callable[[str], Which], path: str) -> Any:
    first = values[0]
    if all(value == first for value in values):
        return first
    if isinstance(first, Range):
        number = which(path) if callable(which) else which
        low, high = (jnp.asarray(ends)[number] for ends in zip(*values, strict=True))
        return Chosen(low, high, max(value.most for value in values))
    if isinstance(first, bool):
        return jnp.asarray(values)[which(path) if callable(which) else which]
    if path == "world.name":
        return first
    if not is_dataclass(first):
        raise ValueError(f"worlds of one program must agree in {path}, got {first!r} in one")
    settings = object.__new__(type(first))  # its checks are those of each, and were made
    for one in fields(first):
        same = [getattr(value, one.name) for value in values]
        object.__setattr__(settings, one.name, _chosen(same, which, f"{path}.{one.name}"))
    return settings
