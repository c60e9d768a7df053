"""What is around a chain, as outlines and lines in metres: walls, posts, streaks in the water."""

import numpy as np
from jaxtyping import Float

from salpchain.evaluation.surroundings import Surroundings

LIFE = 6.0  # s for which a streak is seen (chosen)
TAIL = 3.0  # s of its way that it shows (chosen)
FADE = 1.5  # s in which it shrinks at its end (chosen)
PIECES = 6  # of a streak
CIRCLE = 48  # corners of a post
SLOWEST = 1e-4  # m/s, water that is taken for still

Points = Float[np.ndarray, "_ 2"]


def wall_outlines(walls: Float[np.ndarray, "wall 5"]) -> Float[np.ndarray, "wall 4 2"]:
    """The corners (m) of each wall."""
    a, b, half = walls[:, 0:2], walls[:, 2:4], walls[:, 4:] / 2
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-9)
    side = half * np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([a - side, b - side, b + side, a + side], axis=1)


def post_outlines(
    posts: Float[np.ndarray, "post 3"], share: float = 1.0
) -> Float[np.ndarray, "post corner 2"]:
    """Circles (m) of this share of each post's radius."""
    angle = np.linspace(0, 2 * np.pi, CIRCLE, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return posts[:, None, :2] + share * posts[:, None, 2:] * ring


def near(around: Surroundings, points: Points) -> Points:
    """Corners (m) of the obstacles, as far as they lie around these points (m)."""
    corners = [wall_outlines(around.walls), post_outlines(around.posts)]
    every = np.concatenate([outline.reshape(-1, 2) for outline in corners])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = (high - low).max()
    inside = ((low - margin <= every) & (every <= high + margin)).all(axis=1)
    return every[inside]


def is_moving(around: Surroundings) -> bool:
    """Whether the water moves."""
    return bool(around.water.size) and float(np.abs(around.water).max()) > SLOWEST


def streaks(
    around: Surroundings, start: Points, time: float, duration: float
) -> Float[np.ndarray, "streak point 2"]:
    """Ways (m) of specks that drift with the water, up to a time (s) of an episode.

    Each begins near one of the `start` points (m), at a time and a place of its own, and begins
    anew somewhere near after some seconds. The last point is where a speck is now.
    """
    index = np.arange(len(start))
    turn, age = np.divmod(time / LIFE + _scatter(index, 3.0), 1.0)
    age = age * LIFE
    spread = np.ptp(start, axis=0) / max(np.sqrt(len(start)), 1.0)
    jitter = np.stack([_scatter(index + 7919 * turn, salt) for salt in (1.0, 2.0)], axis=1)
    place = start + (jitter - 0.5) * spread
    step, ways = age[:, None] / (2 * PIECES), [place]
    part = np.clip(time / max(duration, 1e-9), 0.0, 1.0)
    for _ in range(2 * PIECES):
        ways.append(ways[-1] + step * around.flow(ways[-1], float(part)))
    length = np.minimum(TAIL, age) * np.clip((LIFE - age) / FADE, 0.0, 1.0)
    first = 1 - length / np.maximum(age, 1e-9)
    at = first[:, None] + (1 - first[:, None]) * np.linspace(0, 1, PIECES + 1)
    return _along(np.stack(ways, axis=1), at)


def _along(ways: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points at these parts in [0, 1] of ways with equally long pieces."""
    last = ways.shape[1] - 1
    first = np.minimum((share * last).astype(int), last - 1)
    rest = (share * last - first)[..., None]
    rows = np.arange(len(ways))[:, None]
    return (1 - rest) * ways[rows, first] + rest * ways[rows, first + 1]


def _scatter(number: np.ndarray, salt: float) -> np.ndarray:
    """A number in [0, 1) for each, as good as random."""
    return np.abs(np.sin(number * 127.1 + 311.7 * salt) * 43758.5453) % 1.0
