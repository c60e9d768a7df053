"""Target poses: random ones, and what a person drew by hand made into chords of one link."""

import numpy as np
from jaxtyping import Float

from salpchain.errors import InputError
from salpchain.tasks.reach.targets import LINK

SHARPEST = 2 * np.arcsin(LINK / (2 * 0.05))  # rad between chords: the task's tightest arc, 5 cm
SHORTEST_LINE = 0.05  # m, of a drawing that means anything (chosen)

Points = Float[np.ndarray, "_ 2"]
Point = Float[np.ndarray, "2"]


def random_target(dice: np.random.Generator, length: int, centre: Point) -> Points:
    """An arc or an S of chords of one link, in a random place near a chain's length away."""
    whole = length * LINK
    radius = max(dice.uniform(0.2, 0.9) * whole, 0.08)
    step = 2 * np.arcsin(min(LINK / (2 * radius), 1.0)) * dice.choice([-1, 1])
    turns = np.full(length - 1, step)
    if dice.random() < 0.5:
        turns[length // 2 :] *= -1
    points = _walked(np.zeros(2), dice.uniform(0, 2 * np.pi) + np.cumsum(turns))
    way, far = dice.uniform(0, 2 * np.pi), 0.35 + dice.uniform(0.3, 0.55) * whole
    return points - points.mean(axis=0) + centre + far * np.array([np.cos(way), np.sin(way)])


def _walked(start: Point, bearings: Float[np.ndarray, " chord"]) -> Points:
    steps = LINK * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return np.vstack([start, start + np.cumsum(steps, axis=0)])


def resampled(drawn: Points, length: int) -> Points:
    """As many points as units along a drawn line (m), each one link from the one before.

    Corners sharper than a chain can take are rounded. What is too short goes straight on, what is
    too long ends early.

    Raises:
        InputError: the line is hardly longer than a dot.
    """
    line = np.asarray(drawn, float)
    if np.linalg.norm(np.diff(line, axis=0), axis=1).sum() < SHORTEST_LINE:
        raise InputError("draw a longer line: this is hardly more than a dot")
    points, bearing, at = [line[0]], None, 0.0
    while len(points) < length:
        aim, at = _ahead(line, points[-1], at)
        wanted = bearing if aim is None else float(np.arctan2(*(aim - points[-1])[::-1]))
        assert wanted is not None  # a line that is no dot has a first direction
        if bearing is not None:
            turn = np.mod(wanted - bearing + np.pi, 2 * np.pi) - np.pi
            wanted = bearing + float(np.clip(turn, -SHARPEST, SHARPEST))
        bearing = wanted
        points.append(points[-1] + LINK * np.array([np.cos(bearing), np.sin(bearing)]))
    return np.array(points)


def _ahead(line: Points, here: Point, at: float) -> tuple[Point | None, float]:
    """The first point of the line past `at` (in pieces) that is one link from here; or its end.

    None where the line has ended.
    """
    for piece in range(int(at), len(line) - 1):
        a, b = line[piece], line[piece + 1]
        low = at - piece if piece == int(at) else 0.0
        for part in _crossings(a - here, b - a):
            if part > low:
                return a + part * (b - a), piece + part
    last = len(line) - 1.0
    rest = np.linalg.norm(line[-1] - here)
    return (line[-1], last) if at < last and rest > 0.2 * LINK else (None, last)


def _crossings(a: Point, way: Point) -> list[float]:
    """Where a + part * way leaves the circle of one link around the origin, part in [0, 1]."""
    square = float(way @ way)
    if square == 0:
        return []
    half = float(a @ way) / square
    under = half**2 - (float(a @ a) - LINK**2) / square
    if under < 0:
        return []
    return [part for part in (-half + np.sqrt(under),) if 0 <= part <= 1]


def nearer_way_round(points: Points, units: Points) -> Points:
    """The points in the order in which the units have the shorter way to them."""
    there = np.linalg.norm(units - points, axis=1).sum()
    back = np.linalg.norm(units - points[::-1], axis=1).sum()
    return points if there <= back else points[::-1].copy()
