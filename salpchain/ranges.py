"""Ranges of numbers in settings: `0.05` fixes a number, `0:0.08` is drawn anew each time."""

from math import isfinite
from typing import Any, NamedTuple

from salpchain.errors import InputError
from salpchain.given import told


class Range(NamedTuple):
    """The ends between which a number is drawn uniformly for each episode; equal ends fix it."""

    low: float
    high: float

    @property
    def is_fixed(self) -> bool:
        """Whether every episode has the same number."""
        return self.low == self.high

    @property
    def most(self) -> float:
        """The largest number that can be drawn."""
        return self.high

    def __str__(self) -> str:
        return f"{self.low:g}" if self.is_fixed else f"{self.low:g}:{self.high:g}"


def as_range(value: object) -> Range:
    """A number, two numbers, or text such as `0.05` or `0:0.08`, as a range.

    Raises:
        InputError: anything else, or a first number above the second.
    """
    try:
        ends = [float(part) for part in _parts(value)]
    except (TypeError, ValueError):
        ends = []
    if not 1 <= len(ends) <= 2 or not all(map(isfinite, ends)):
        raise InputError(f"must be a finite number or a range such as 0:0.08, got {told(value)}")
    if ends[0] > ends[-1]:
        raise InputError(
            f"must have the lower end first, {ends[1]:g}:{ends[0]:g}, got {told(value)}"
        )
    return Range(ends[0], ends[-1])


def _parts(value: object) -> list[Any]:
    if isinstance(value, str):
        return value.split(":")
    if isinstance(value, bool):
        raise TypeError
    return list(value) if isinstance(value, list | tuple) else [value]
