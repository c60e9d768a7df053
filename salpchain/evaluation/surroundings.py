"""What was around a chain in a recorded episode: walls and posts, the water, its thrusters."""

from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from salpchain import given
from salpchain.errors import InputError


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Still water, nothing in it and thrusters that work, unless said otherwise.

    Raises:
        InputError: a field of another shape or kind than stated, or numbers that are not finite.
    """

    # (wall, 5) m: x, y of one end, x, y of the other, width
    walls: np.ndarray = field(default_factory=partial(np.zeros, (0, 5), float))
    # (post, 3) m: x, y, radius
    posts: np.ndarray = field(default_factory=partial(np.zeros, (0, 3), float))
    # (step, unit) of each thruster; no rows where all are whole
    gain: np.ndarray = field(default_factory=partial(np.zeros, (0, 0), float))
    # (moment, row, column, 2) m/s; no moments: still
    water: np.ndarray = field(default_factory=partial(np.zeros, (0, 0, 0, 2), float))
    # m: lowest, highest x and y of the water's grid
    water_area: np.ndarray = field(default_factory=partial(np.zeros, (2, 2), float))

    def __post_init__(self) -> None:
        shapes = {"walls": (-1, 5), "posts": (-1, 3), "gain": (-1, -1)}
        shapes |= {"water": (-1, -1, -1, 2), "water_area": (2, 2)}
        for name, shape in shapes.items():
            array = given.instance(name, getattr(self, name), np.ndarray, "a NumPy array")
            fits = len(array.shape) == len(shape)
            fits &= all(want in (-1, has) for want, has in zip(shape, array.shape, strict=False))
            if not fits or array.dtype.kind != "f":
                raise InputError(
                    f"{name} has shape {array.shape} and type {array.dtype}, expected floats"
                    f" (as many as there are: -1) {shape}"
                )
            if not np.isfinite(array).all():
                raise InputError(f"{name} holds numbers that are not finite")
        if len(self.water) and not self.water.size:
            raise InputError(f"water has shape {self.water.shape}: its grid must have points")

    def check(self, steps: int, length: int) -> None:
        """Raise InputError unless it is that of an episode of so many steps and units."""
        if len(self.gain) and self.gain.shape != (steps, length):
            expected = (steps, length)
            raise InputError(f"gain has shape {self.gain.shape}, expected {expected} or no rows")

    def named(self) -> dict[str, np.ndarray]:
        """Every array by its name."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def dead(self, step: int, length: int) -> Bool[np.ndarray, " unit"]:
        """Which thrusters are dead in a control step; after the last one as in the last one."""
        if not len(self.gain):
            return np.zeros(length, bool)
        return self.gain[min(step, len(self.gain) - 1)] == 0

    def flow(self, points: Float[np.ndarray, "*point 2"], part: float) -> np.ndarray:
        """The water's velocity (m/s) at points (m), when this part of the episode is over.

        Linear between the points and the moments of the grid; outside as at its edge.
        """
        if not len(self.water):
            return np.zeros_like(points)
        moments, rows, columns, _ = self.water.shape
        when, still = _between(np.asarray(part), moments)
        now = self.water[when] + still * (self.water[_next(when, moments)] - self.water[when])
        low, high = self.water_area
        share = (points - low) / np.maximum(high - low, 1e-9)
        (x, right), (y, up) = _between(share[..., 0], columns), _between(share[..., 1], rows)
        right, up = right[..., None], up[..., None]
        x1, y1 = _next(x, columns), _next(y, rows)
        below = now[y, x] + right * (now[y, x1] - now[y, x])
        above = now[y1, x] + right * (now[y1, x1] - now[y1, x])
        return below + up * (above - below)


def _between(share: Any, count: int) -> tuple[Any, Any]:
    """The number before a place in [0, 1] of so many in a row, and how far it is to the next."""
    at = np.clip(share, 0.0, 1.0) * (count - 1)
    first = np.floor(at).astype(int)
    return first, at - first


def _next(index: Any, count: int) -> Any:
    return np.minimum(index + 1, count - 1)
