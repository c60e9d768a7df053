"""Walls of one's own in a passage: what they may be, and where they may not stand.

Imports nothing heavy.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import NamedTuple

from salpchain.errors import InputError

MOST_WALLS = 16  # in a passage, besides its own (chosen)
SHORTEST = 0.01  # m, of one (chosen)

Numbers = Sequence[float]  # of a wall: x, y, x, y of the ends of its middle line (m)


class Zone(NamedTuple):
    """A box (m) that must stay free."""

    low: tuple[float, float]
    high: tuple[float, float]


def each_wall(walls: Numbers) -> list[Numbers]:
    """The numbers of all walls, by wall.

    Raises:
        InputError: not four for each, too many walls, or one that is hardly longer than a dot.
    """
    if len(walls) % 4:
        raise InputError(
            f"walls must be x,y,x,y of the ends of each wall (m), got {len(walls)} numbers"
        )
    if len(walls) > 4 * MOST_WALLS:
        raise InputError(f"walls must be {MOST_WALLS} or fewer, got {len(walls) // 4}")
    found = [walls[first : first + 4] for first in range(0, len(walls), 4)]
    for index, (ax, ay, bx, by) in enumerate(found):
        if hypot(bx - ax, by - ay) < SHORTEST:
            raise InputError(
                f"walls must have their two ends apart, wall {index} has {(ax, ay)} twice"
            )
    return found


def check_free(walls: Numbers, zone: Zone, margin: float, what: str) -> None:
    """Raise InputError if the middle line of a wall comes as near as this (m) to a zone."""
    (left, low), (right, high) = zone
    grown = Zone((left - margin, low - margin), (right + margin, high + margin))
    for index, wall in enumerate(each_wall(walls)):
        if _meets(wall, grown):
            raise InputError(
                f"walls must be clear of where {what}, x from {left:.2f} to {right:.2f} m and y"
                f" from {low:.2f} to {high:.2f} m: put wall {index} elsewhere"
            )


def _meets(wall: Numbers, zone: Zone) -> bool:
    """Whether a segment and a box have a point in common."""
    first, last = 0.0, 1.0
    for start, end, low, high in zip(wall[:2], wall[2:], *zone, strict=True):
        step = end - start
        if step == 0:
            near, far = (-inf, inf) if low <= start <= high else (inf, -inf)
        else:
            near, far = sorted(((low - start) / step, (high - start) / step))
        first, last = max(first, near), min(last, far)
    return first <= last
