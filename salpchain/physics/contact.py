"""Contact of units: boxes that repel when closer than a small gap (VMAS 1.5.2).

Arrays have the batch last: vectors are (2, unit, batch) or (2, pair, batch). Each chain has a list
of pairs of units that may touch.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from salpchain.physics.boxes import Boxes, closest_points, cross, overlap, repulsion, square
from salpchain.physics.substeps import Load, Motion


class Pairs(NamedTuple):
    """Units that may touch, in lists that are gone through one by one.

    Lists are padded with pairs (i, i), which exert nothing.
    """

    first: Int[Array, "list pair batch"]
    second: Int[Array, "list pair batch"]
    lists: Int[Array, ""] | int  # that hold any pairs; they come first


def touching_distance(physics: Any) -> Any:
    """Distance of centres (m) above which two units never touch: VMAS compares bounding circles."""
    return jnp.sqrt(physics.unit_length**2 + physics.unit_width**2)


def contact_load(rig: Any, pairs: Pairs, units: Motion) -> Load:
    """What the units of each pair exert on each other, summed over pairs for every unit.

    Shapes are looked at only where some pair is near.
    """
    turn = _turn(units)

    def add(index: Array, total: Array) -> Array:
        some = _listed(rig, pairs, units, index)
        return jax.lax.cond(
            some.near.any(), lambda: total + _exerted(rig, some, turn), lambda: total
        )

    nothing = jnp.zeros((3, *units.angle.shape))
    total = jax.lax.fori_loop(0, pairs.lists, add, nothing)
    return Load(total[:2], total[2])


def every_contact_load(rig: Any, pairs: Pairs, units: Motion) -> Load:
    """`contact_load` of all lists, in operations that have derivatives of both modes."""
    turn = _turn(units)

    def add(total: Array, index: Array) -> tuple[Array, None]:
        return total + _exerted(rig, _listed(rig, pairs, units, index), turn), None

    nothing = jnp.zeros((3, *units.angle.shape))
    total, _ = jax.lax.scan(add, nothing, jnp.arange(len(pairs.first)))
    return Load(total[:2], total[2])


def _exerted(rig: Any, some: "Listed", turn: Array) -> Float[Array, "3 unit batch"]:
    """Force (N, x and y) and torque (N m) on each unit by its pairs in a list."""
    boxes = some.offset, _at(turn, some.first), _at(turn, some.second)
    force, first, second = _box_against_box(rig.physics, *boxes, some.never)
    loads = jnp.stack([*force, first]), jnp.stack([*-force, second])
    return _sum_for_units(some, turn[0], *(jnp.where(some.near, x, 0.0) for x in loads))


class Listed(NamedTuple):
    """The pairs of one list, and how they lie."""

    first: Int[Array, "pair batch"]
    second: Int[Array, "pair batch"]
    offset: Float[Array, "2 pair batch"]  # m, from first to second
    near: Bool[Array, "pair batch"]  # bounding circles meet, as VMAS has it

    @property
    def never(self) -> Bool[Array, ""]:
        """False, for `once`."""
        return self.near.sum() < 0


def _listed(rig: Any, pairs: Pairs, units: Motion, index: Array) -> Listed:
    first, second = pairs.first[index], pairs.second[index]
    offset = _at(units.position, second) - _at(units.position, first)
    near = square(offset) <= touching_distance(rig.physics) ** 2
    return Listed(first, second, offset, near & (first != second))


def _turn(units: Motion) -> Float[Array, "2 unit batch"]:
    return jnp.stack([jnp.cos(units.angle), jnp.sin(units.angle)])


def _at(x: Shaped[Array, "*xy unit batch"], index: Int[Array, "pair batch"]) -> Array:
    """The rows of each chain's units, with the coordinates in front if there are any."""
    if x.ndim == 3:
        return jnp.stack([_at(row, index) for row in x])
    return jnp.take_along_axis(x, index, axis=0)


def _sum_for_units(
    some: Listed, like: Array, first: Array, second: Array
) -> Float[Array, "3 unit batch"]:
    """For each unit, the sum of what its pairs give it, (3, pair, batch) to either unit."""
    num, batch = like.shape
    unit = jnp.concatenate([some.first, some.second])
    given = jnp.moveaxis(jnp.concatenate([first, second], axis=1), 0, -1)
    total = jnp.zeros((num, batch, 3)).at[unit, jnp.arange(batch)].add(given)
    return jnp.moveaxis(total, -1, 0)


def _box_against_box(
    physics: Any, offset: Array, turn: Array, other_turn: Array, never: Any = False
) -> tuple[Float[Array, "2 pair batch"], Float[Array, "pair batch"], Float[Array, "pair batch"]]:
    """Force (N) on a unit at the origin by a unit at `offset`, and torques (N m).

    The other unit feels the opposite force. The torques are that on the first unit and that on the
    second. Units whose sides cross exert nothing on each other: VMAS finds the same point twice.
    """
    half = (physics.unit_length / 2, physics.unit_width / 2)
    boxes = Boxes(half, half, offset, turn, other_turn)
    gap, here, normal = closest_points(boxes, never)
    acts = (gap <= physics.contact_gap) & ~overlap(boxes)
    force = jnp.where(acts, repulsion(physics, gap), 0.0) * normal
    there = here - gap * normal - offset
    return force, cross(here, force), -cross(there, force)
