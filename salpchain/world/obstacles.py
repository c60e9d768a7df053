"""Walls and posts from lists, with room for more, and whether they cover the start of a chain."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.errors import InputError
from salpchain.physics.boxes import Boxes, Vector, closest_points, overlap, turned, unit_vector
from salpchain.physics.obstacles import Obstacles, Posts, Solids, Walls, solids
from salpchain.physics.state import Chain, Physics

Point = tuple[float, float]  # m, world
Wall = tuple[Point, Point, float]  # the ends of its middle line, and its width (m)


def make_obstacles(
    walls: Sequence[Any] = (), posts: Sequence[Any] = (), slots: Sequence[int] | None = None
) -> Obstacles:
    """Obstacles for `salpchain.physics.chain.step` and for a world.

    Args:
        walls: `((x, y), (x, y), width)` of each, in m.
        posts: `((x, y), radius)` of each, in m.
        slots: for how many walls and how many posts there is room, so that episodes with other
            numbers of them share a compiled program; as many as given if left out.

    Raises:
        InputError: not such lists, numbers that are not finite, sizes that are not positive, ends
            of a wall at one point, or more than there is room for.
    """
    room_for = _checked_slots(slots, len(walls), len(posts))
    wall, post = ([*map(_numbers, how, range(len(how)), [kind] * len(how))]
                  for kind, how in (("wall", walls), ("post", posts)))  # fmt: skip
    for index, (ax, ay, bx, by, _) in enumerate(wall):
        if math.hypot(bx - ax, by - ay) < SHORTEST:
            raise InputError(
                f"wall {index}: its two ends must be apart, got {(ax, ay)} twice; a post is round"
            )
    filled_walls, filled_posts = _filled(wall, 5, room_for[0]), _filled(post, 3, room_for[1])
    return Obstacles(
        Walls(filled_walls[:, :4].reshape(-1, 2, 2), filled_walls[:, 4], _first(wall, room_for[0])),
        Posts(filled_posts[:, :2], filled_posts[:, 2], _first(post, room_for[1])),
    )


SHORTEST = 1e-3  # m, of a wall (chosen)
FORMS = {
    "wall": ("((x, y), (x, y), width)", 5, "width"),
    "post": ("((x, y), radius)", 3, "radius"),
}


def _numbers(given: Any, index: int, kind: str) -> tuple[float, ...]:
    """The numbers of one wall or post, the size last."""
    form, count, size = FORMS[kind]
    numbers: list[float] = []
    shapes: list[tuple[int, ...]] = []
    try:
        for part in given:
            numbers += [*map(float, np.ravel(part))]
            shapes.append(np.shape(part))
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or shapes != [*[(2,)] * (count // 2), ()]:
        raise InputError(f"{kind} {index} must be {form} in m, got {given!r}")
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"{kind} {index} must be finite numbers (m), got {given!r}")
    if not numbers[-1] > 0:
        raise InputError(f"{kind} {index}: its {size} must be positive (m), got {numbers[-1]}")
    return tuple(numbers)


def _checked_slots(slots: Any, *counts: int) -> tuple[int, int]:
    if slots is None:
        return counts[0], counts[1]
    whole = isinstance(slots, tuple | list) and len(slots) == 2
    if not whole or not all(isinstance(n, int | np.integer) and n >= 0 for n in slots):
        raise InputError(f"slots must be two whole numbers, (walls, posts), got {slots!r}")
    for kind, count, room_for in zip(("walls", "posts"), counts, slots, strict=True):
        if count > room_for:
            raise InputError(f"{count} {kind} need as many slots or more, got {room_for}")
    return int(slots[0]), int(slots[1])


def _filled(rows: list[tuple[float, ...]], columns: int, slots: int) -> Float[Array, "slot column"]:
    full = np.zeros((slots, columns), np.float32)
    full[: len(rows)] = np.reshape(rows, (-1, columns))
    return jnp.asarray(full)


def _first(rows: list[tuple[float, ...]], slots: int) -> Array:
    return jnp.arange(slots) < len(rows)


def room(
    width: float | int, height: float | int, thickness: float | int = 0.05, centre: Any = (0.0, 0.0)
) -> list[Wall]:
    """The four walls around a free rectangle (m): a list for `make_obstacles`.

    Raises:
        InputError: a size that is not a positive number.
    """
    for name, size in (("width", width), ("height", height), ("thickness", thickness)):
        if not (isinstance(size, int | float) and math.isfinite(size) and size > 0):
            raise InputError(f"room: {name} must be a positive number (m), got {size!r}")
    x, y = (width + thickness) / 2, (height + thickness) / 2
    ends = [
        *(((-x - thickness / 2, side * y), (x + thickness / 2, side * y)) for side in (-1, 1)),
        *(((side * x, -y - thickness / 2), (side * x, y + thickness / 2)) for side in (-1, 1)),
    ]
    cx, cy = centre
    return [((cx + a, cy + b), (cx + c, cy + d), thickness) for (a, b), (c, d) in ends]


def check_clear(chain: Chain, obstacles: Obstacles, physics: Physics | None = None) -> None:
    """Raise InputError if a wall or a post covers a unit of the chain, or lies across a link.

    Units cannot pass a wall, but links do not touch any: a chain that starts on both sides of one
    would hang on it. For one chain, of known numbers: not under `jax.jit` or `jax.vmap`.
    """
    if chain.units.position.ndim != 2:
        shape = jnp.shape(chain.units.position)
        raise InputError(f"check_clear takes one chain, got unit positions of shape {shape}")
    there = solids(obstacles)
    if there is None:
        return
    walls = obstacles.walls.width.shape[0]
    for name, covered in _covered(chain, there, physics or Physics()):
        for body, solid in np.argwhere(covered)[:1]:
            kind = f"wall {solid}" if solid < walls else f"post {solid - walls}"
            what = f"covers unit {body}"
            if name == "link":
                what = f"lies across the link of units {body} and {body + 1}"
            raise InputError(
                f"{kind} {what} at the start (counted from 0): move the {kind[:4]} or the chain"
            )


def _covered(chain: Chain, there: Solids, physics: Physics) -> Iterator[tuple[str, np.ndarray]]:
    """For units and for links, which (body, solid) overlap."""
    unit = (physics.unit_length / 2, physics.unit_width / 2)
    link = (physics.link_length / 2, 0.0)
    for name, half, bodies, alive in (
        ("unit", unit, chain.units, chain.present),
        ("link", link, chain.links, chain.joined),
    ):
        covered = _overlapping(half, bodies.position.T, turned(bodies.angle), there)
        yield name, covered & np.asarray(alive)[:, None]


def _overlapping(half: Any, place: Array, turn: Vector, there: Solids) -> np.ndarray:
    """Which boxes and solids overlap, (body, solid): the solids take the place of a batch."""
    centre, other_turn, other_half = (x.T[:, None] for x in there[:3])
    turn = (turn[0][:, None], turn[1][:, None])
    pair = Boxes(half, other_half, centre - place[:, :, None], turn, other_turn)
    gap, _ = unit_vector(closest_points(pair, False)[1])
    return np.asarray(overlap(pair) | (gap <= there.rim))
