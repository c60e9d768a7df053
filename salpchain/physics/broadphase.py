"""What units may touch in a control step, told from where they are and how they move before it.

Arrays have the batch last: vectors are (2, unit, batch).
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.boxes import square
from salpchain.physics.candidates import AWAY, Candidates, listed, marked, scattered
from salpchain.physics.contact import once, touching_distance
from salpchain.physics.obstacles import distance_squared_beyond
from salpchain.physics.substeps import Motion, Rig
from salpchain.xla import materialise

# How much closer two units may come in one control step, beyond what their speeds bring them
# (chosen; a test compares with all pairs): full thrust moves a free unit by 1 cm.
SLACK = 0.02  # m

AROUND = 8  # units up to so many slots apart are looked at singly (chosen)
BLOCK = 4  # neighbouring units in one bounding circle (chosen)


def far_pairs(rig: Rig, units: Motion) -> Candidates | None:
    """The pairs of units that are no neighbours and may touch in this control step; None if all
    units are neighbours.

    `other` is one less than how many slots on, counted round, the second unit of a pair is.
    """
    num = len(units.angle)
    most = num // 2
    if most == 1:
        return None
    speed = jnp.where(rig.present, jnp.sqrt(square(units.velocity)), 0.0)
    way = speed * rig.physics.control_step
    circles = jnp.concatenate([scattered(rig.present, units.position), way[None]])
    twice = jnp.concatenate([circles, circles], axis=1)
    reach = touching_distance(rig.physics) + SLACK
    unit = jnp.arange(num)[:, None]
    never = rig.present[0].sum() < 0

    def near(other: Any) -> Bool[Array, "unit batch"]:
        onward = jax.lax.dynamic_slice_in_dim(twice, other + 1, num, axis=1)
        inside = square(onward[:2] - circles[:2]) < (reach + onward[2] + way) ** 2
        return materialise(inside & once(num, unit, other + 1), never)

    words = [marked(near, range(1, min(most, AROUND)))]
    if most > AROUND:
        far = jax.eval_shape(lambda: marked(near, range(AROUND, most)))
        words.append(
            jax.lax.cond(
                _far_units_near(rig, circles, reach),
                lambda: marked(near, range(AROUND, most)),
                lambda: jnp.zeros(far.shape, far.dtype),
            )
        )
    return listed(jnp.concatenate(words), num, 1)


def _far_units_near(rig: Rig, units: Float[Array, "3 unit batch"], reach: Any) -> Bool[Array, ""]:
    """Whether the circles (m; centre and radius) of any units that are two blocks apart or more,
    counted round, come within reach of each other.

    The bounding circles of blocks of neighbouring units are looked at.
    """
    centre, radius = _blocks(units[:2], rig.present, units[2])
    num, batch = radius.shape
    circles = jnp.concatenate([centre, radius[None]])
    twice = jnp.concatenate([circles, circles], axis=1)

    def look(shift: Array, near: Array) -> Array:
        other = jax.lax.dynamic_slice_in_dim(twice, shift, num, axis=1)
        apart = jnp.maximum(radius + other[2] + reach, 0.0)
        return near | (square(other[:2] - centre) < apart**2).any(axis=0)

    return jax.lax.fori_loop(2, num // 2 + 1, look, jnp.zeros(batch, bool)).any()


def _blocks(
    place: Float[Array, "2 unit batch"],
    present: Bool[Array, "unit batch"],
    way: Float[Array, "unit batch"],
) -> tuple[Float[Array, "2 block batch"], Float[Array, "block batch"]]:
    """Bounding circles of each block's present units, that go a way (m) in this control step; the
    radius is -inf where there are none."""
    num, batch = present.shape
    rows = jnp.arange(-(-num // BLOCK) * BLOCK)
    split = (-1, BLOCK, batch)
    alive = (present[jnp.minimum(rows, num - 1)] & (rows < num)[:, None]).reshape(split)
    inside = place[:, jnp.minimum(rows, num - 1)].reshape(2, *split)
    low = jnp.where(alive, inside, AWAY).min(axis=2)
    high = jnp.where(alive, inside, -AWAY).max(axis=2)
    centre = (low + high) / 2
    distance = jnp.sqrt(square(inside - centre[:, :, None]))
    distance += way[jnp.minimum(rows, num - 1)].reshape(split)
    return centre, jnp.where(alive, distance, -jnp.inf).max(axis=1)


def near_solids(rig: Rig, units: Motion) -> Candidates:
    """The units and obstacles that may touch in this control step, at any speed that is in the
    chain: units pass it on to each other. `other` is the solid."""
    speed = jnp.where(rig.present, jnp.sqrt(square(units.velocity)), 0.0).max(axis=0)
    reach = touching_distance(rig.physics) / 2 + rig.physics.contact_gap
    reach += SLACK + speed * rig.physics.control_step
    place = scattered(rig.present, units.position)

    def near(solid: Any) -> Array:
        one = jax.tree.map(lambda x: x[solid], rig.obstacles)
        return distance_squared_beyond(one, place, reach) < 0

    return listed(marked(near, range(len(rig.obstacles.rim))), len(units.angle))
