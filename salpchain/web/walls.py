"""Walls that a person draws in the water, one of them with an opening to pass."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from salpchain.errors import InputError
from salpchain.physics.obstacles import Obstacles, Posts, Walls
from salpchain.tasks.parting.config import THICK

MOST_WALLS = 8  # drawn by hand, without the one that has an opening (chosen)
SHORTEST = 0.05  # m, of a wall (chosen)
NARROWEST = 0.14  # m, of an opening: two units that are linked pass side by side
FREE = 0.04  # m, from a wall that is drawn to the centre of a unit (chosen)

Point = Float[np.ndarray, "2"]
Points = Float[np.ndarray, "_ 2"]
Rows = Float[np.ndarray, "wall 5"]  # m: x, y of both ends of the middle line, width


@dataclass(frozen=True)
class Gate:
    """A wall with an opening in its middle."""

    begin: tuple[float, float]  # m
    end: tuple[float, float]
    opening: float  # m

    @property
    def rows(self) -> Rows:
        """The walls on both sides of the opening."""
        begin, end = np.array(self.begin), np.array(self.end)
        along = (end - begin) / np.hypot(*(end - begin)) * self.opening / 2
        middle = (begin + end) / 2
        sides = (begin, middle - along), (middle + along, end)
        return np.array([[*one, *other, THICK] for one, other in sides])

    def lane(self, start: Point, goal: Point) -> Float[np.ndarray, "2 2"] | None:
        """The way through (m), from before the opening to behind it; None where the straight way
        from start to goal does not cross this wall."""
        begin, end = np.array(self.begin), np.array(self.end)
        size = np.hypot(*(end - begin))
        along = (end - begin) / size
        across, middle = np.array([-along[1], along[0]]), (begin + end) / 2
        before, behind = (start - middle) @ across, (goal - middle) @ across
        if before * behind >= 0:
            return None
        crossing = start + before / (before - behind) * (goal - start)
        if abs((crossing - middle) @ along) > size / 2:
            return None
        step = np.sign(behind) * THICK / 2 * across
        return np.stack([middle - step, middle + step])


@dataclass(frozen=True, eq=False)
class Drawn:
    """All walls that were drawn."""

    walls: tuple[tuple[float, ...], ...] = ()  # ends of each, without an opening
    gate: Gate | None = None

    @property
    def rows(self) -> Rows:
        """Every piece of wall."""
        single = np.array([[*wall, THICK] for wall in self.walls]).reshape(-1, 5)
        return single if self.gate is None else np.vstack([single, self.gate.rows])

    def with_wall(
        self, begin: tuple[float, float], end: tuple[float, float], opening: float, units: Points
    ) -> "Drawn":
        """With one more wall; one with an opening takes the place of the one before.

        Raises:
            InputError: too many, too short, an opening that nothing can pass or that leaves no
                wall; a unit is where the wall would be.
        """
        size = float(np.hypot(end[0] - begin[0], end[1] - begin[1]))
        least = opening + 2 * SHORTEST if opening else SHORTEST
        if opening and opening < NARROWEST:
            raise InputError(
                f"an opening is at least {100 * NARROWEST:.0f} cm wide, got {100 * opening:.0f} cm"
            )
        if size < least:
            raise InputError(
                f"draw a longer wall: at least {100 * least:.0f} cm, got {100 * size:.0f} cm"
            )
        gate = Gate(begin, end, opening) if opening else None
        one = replace(self, gate=gate) if gate else replace(self, walls=(*self.walls, begin + end))
        if len(one.walls) > MOST_WALLS:
            raise InputError(f"{MOST_WALLS} walls stand already: take one away first")
        rows = gate.rows if gate else one.rows[len(one.walls) - 1 : len(one.walls)]
        if (wall_gap(rows, units) < FREE).any():
            raise InputError("a chain is where the wall would be: draw it elsewhere")
        return one

    def without(self, point: Point) -> "Drawn":
        """Without the wall that is nearest to a point (m).

        Raises:
            InputError: none was drawn.
        """
        away = [float(wall_gap(np.array([[*wall, THICK]]), point[None])[0]) for wall in self.walls]
        gate = np.inf if self.gate is None else float(wall_gap(self.gate.rows, point[None])[0])
        if not away and self.gate is None:
            raise InputError("no wall was drawn: drag to draw one")
        if gate <= min(away, default=np.inf):
            return replace(self, gate=None)
        at = int(np.argmin(away))
        return replace(self, walls=self.walls[:at] + self.walls[at + 1 :])

    def among(self, others: Obstacles | None) -> Obstacles:
        """These walls, in slots for as many as there may be, besides other obstacles."""
        rows, slots = self.rows, MOST_WALLS + 2
        padded = np.zeros((slots, 5), np.float32)
        padded[: len(rows)] = rows
        walls = Walls(
            jnp.asarray(padded[:, :4].reshape(-1, 2, 2)),
            jnp.full(slots, THICK, jnp.float32),
            jnp.arange(slots) < len(rows),
        )
        if others is None:
            return Obstacles(walls, Posts(jnp.zeros((0, 2)), jnp.zeros(0), jnp.zeros(0, bool)))
        both = others.walls, walls
        ends, width, present = (
            jnp.concatenate([getattr(one, name) for one in both])
            for name in ("ends", "width", "present")
        )
        return Obstacles(Walls(ends, width, present), others.posts)


def wall_gap(rows: Rows, points: Points) -> Float[np.ndarray, " point"]:
    """How far points are from the nearest wall (m): below zero inside, infinite if none."""
    nearest = np.full(len(points), np.inf)
    for ax, ay, bx, by, width in rows.astype(float):
        middle, half = np.array([ax + bx, ay + by]) / 2, np.array([bx - ax, by - ay]) / 2
        size = np.hypot(*half)
        along = half / size
        away = points - middle
        local = np.stack([away @ along, away @ np.array([-along[1], along[0]])], axis=1)
        beyond = np.abs(local) - [size, width / 2]
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        nearest = np.minimum(nearest, outside + np.minimum(beyond.max(axis=1), 0))
    return nearest
