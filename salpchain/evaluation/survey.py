"""What was around a chain, measured after its episode: obstacles, thrusters, water on a grid."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.evaluation.surroundings import Surroundings
from salpchain.physics.obstacles import Obstacles
from salpchain.world.current import Current
from salpchain.world.world import World

POINTS = 41  # of the water's grid along either side (chosen)
MOMENTS = 32  # at most, of water that changes in time (chosen)
ROOM = 0.5  # how far the grid goes beyond all that swims, of the larger side (chosen)


def surroundings(
    world: World, points: Float[np.ndarray, "point 2"], gain: Any, current: Any
) -> Surroundings:
    """Of an episode in this world, whose chain and target were at these points (m).

    `gain` (step, unit) is None where no thruster is broken; `current` holds the arrays of the
    water's motion, (time, ...), and is None in still water.
    """
    known: dict[str, Any] = {}
    if world.obstacles is not None:
        known |= _standing(world.obstacles)
    if gain is not None and not (gain == 1).all():
        known["gain"] = np.asarray(gain, np.float32)
    if world.current is not None:
        known |= _water(world.current, current, points)
    return Surroundings(**known)


def _standing(obstacles: Obstacles) -> dict[str, np.ndarray]:
    """The obstacles that are there, as rows."""
    walls, posts = jax.device_get((obstacles.walls, obstacles.posts))
    rows = np.concatenate([walls.ends.reshape(-1, 4), walls.width[:, None]], axis=1)
    rounds = np.concatenate([posts.centre, posts.radius[:, None]], axis=1)
    return {
        "walls": rows[walls.present].astype(np.float32),
        "posts": rounds[posts.present].astype(np.float32),
    }


def _water(
    last: Current, arrays: Any, points: Float[np.ndarray, "point 2"]
) -> dict[str, np.ndarray]:
    """The water's velocity around the points (m): once where it is steady, one point if uniform."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = ROOM * (high - low).max()
    low, high = low - margin, high + margin
    times = _moments(arrays)
    chosen = jax.tree.map(lambda x: x[times], arrays)
    sides = [np.linspace(low[k], high[k], POINTS, dtype=np.float32) for k in (0, 1)]
    grid = np.stack(np.meshgrid(*sides), axis=-1)
    fixed = eqx.filter(last, eqx.is_array, inverse=True)
    flow = np.asarray(_flows(fixed, chosen, len(times), jnp.asarray(grid.reshape(-1, 2))))
    flow = flow.reshape(-1, POINTS, POINTS, 2)
    if np.ptp(flow, axis=(1, 2)).max() < 1e-6:
        flow = flow[:, :1, :1]
    return {"water": flow, "water_area": np.stack([low, high]).astype(np.float32)}


def _moments(arrays: Any) -> np.ndarray:
    """The control steps whose water is kept: the first alone if it is the same in all."""
    every = [np.asarray(x) for x in jax.tree.leaves(arrays)]
    if all((x == x[:1]).all() for x in every):
        return np.zeros(1, int)
    steps = len(every[0])
    return np.round(np.linspace(0, steps - 1, min(steps, MOMENTS))).astype(int)


@eqx.filter_jit
def _flows(
    fixed: Current, arrays: Any, moments: int, points: Float[Array, "point 2"]
) -> Float[Array, "moment point 2"]:
    """The velocity at points (m) at each moment."""

    def at(part: Any) -> Array:
        return eqx.combine(part, fixed).flow(points).velocity

    return jax.vmap(at, axis_size=moments)(arrays)
