"""Contact of units: boxes that repel when closer than a small gap (VMAS 1.5.2).

Arrays have the batch last: vectors are (2, unit, batch) or (2, pair).
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.physics.boxes import (
    Boxes,
    Vector,
    closest_points,
    cross,
    overlap,
    repulsion,
    square,
    turned,
    unit_vector,
)
from salpchain.physics.candidates import (
    Candidates,
    Exert,
    Pushes,
    listed,
    of_each,
    packed,
    pushed,
    scattered,
)
from salpchain.physics.substeps import Motion, Push, Rig
from salpchain.xla import materialise


def touching_distance(physics: Any) -> Any:
    """Distance of centres (m) above which two units never touch: VMAS compares bounding circles."""
    return jnp.sqrt(physics.unit_length**2 + physics.unit_width**2)


def once(num: int, unit: Any, shift: Any) -> Any:
    """Whether a pair of this unit and the one so many slots on, counted round, is no other's
    mirror image: half way round each is met twice."""
    return (2 * shift < num) | (unit < num // 2)


def among_units(rig: Rig, far: Candidates | None, units: Motion) -> Push:
    """How units push each other: neighbours whose bounding circles meet, and those of `far`.

    `other` is one less than how many slots on, counted round, the second unit of a pair is.
    """
    num, batch = units.angle.shape
    place = scattered(rig.present, units.position)
    offset = jnp.roll(place, -1, axis=1) - place
    near = square(offset) <= touching_distance(rig.physics) ** 2
    near &= once(num, jnp.arange(num)[:, None], 1)

    def load() -> Float[Array, "3 unit batch"]:
        lists = [listed(packed(near)[None], num)]
        lists += [] if far is None else [far]
        return pushed(lists, exerted(rig, place, units.angle), num, batch)

    ever = near.any() if far is None else near.any() | (far.count > 0)
    return Push(ever, load)


def exerted(
    rig: Rig, place: Float[Array, "2 unit batch"], angle: Float[Array, "unit batch"]
) -> Exert:
    """What the two units of a pair exert on each other."""
    num, batch = angle.shape
    size = num * batch
    x, y, angle = (row.reshape(size) for row in (*place, angle))

    def exert(unit: Array, other: Array, valid: Array, never: Array) -> Pushes:
        onward = unit + (other + 1) * batch
        onward = jnp.where(onward >= size, onward - size, onward)
        valid &= once(num, unit // batch, other + 1)
        first, second = jnp.minimum(unit, onward), jnp.maximum(unit, onward)
        offset = x[second] - x[first], y[second] - y[first]
        offset, turn, other_turn = materialise(
            (offset, turned(angle[first]), turned(angle[second])), never
        )
        physics = of_each(rig.physics, first % batch)
        valid &= square(offset) <= touching_distance(physics) ** 2
        force, one, two = box_against_box(physics, offset, turn, other_turn, never)
        push = [jnp.where(valid, value, 0.0) for value in (*force, one, two)]
        return [(first, push[:3]), (second, [-push[0], -push[1], push[3]])]

    return exert


def among_all_units(rig: Rig, units: Motion) -> Push:
    """`among_units` of all pairs, in operations that have derivatives of both modes."""
    num = len(units.angle)
    unit = jnp.arange(num)[:, None]
    rows = jnp.stack([*scattered(rig.present, units.position), *turned(units.angle)])

    def add(total: Array, shift: Array) -> tuple[Array, None]:
        onward = jnp.roll(rows, -shift, axis=1)
        wraps = unit + shift >= num  # the first unit of a pair is that of the lower slot
        first, second = jnp.where(wraps, onward, rows), jnp.where(wraps, rows, onward)
        offset = second[0] - first[0], second[1] - first[1]
        near = (square(offset) <= touching_distance(rig.physics) ** 2) & once(num, unit, shift)
        force, one, two = box_against_box(
            rig.physics, offset, (first[2], first[3]), (second[2], second[3])
        )
        on_first, on_second = (
            jnp.where(near, jnp.stack(push), 0.0)
            for push in ((*force, one), (-force[0], -force[1], two))
        )
        here, there = (
            jnp.where(wraps, *pair) for pair in ((on_second, on_first), (on_first, on_second))
        )
        return total + here + jnp.roll(there, shift, axis=1), None

    nothing = jnp.zeros((3, *units.angle.shape))
    return Push(None, lambda: jax.lax.scan(add, nothing, jnp.arange(1, num // 2 + 1))[0])


def box_against_box(
    physics: Any, offset: Vector, turn: Vector, other_turn: Vector, never: Any = False
) -> tuple[Vector, Array, Array]:
    """Force (N) on a unit by another at an `offset` (m), and torques (N m) on both.

    The other unit feels the opposite force. Units whose sides cross exert nothing on each other:
    VMAS finds the same point twice.
    """
    half = (physics.unit_length / 2, physics.unit_width / 2)
    boxes = Boxes(half, half, offset, turn, other_turn)
    here, between = closest_points(boxes, never)
    gap, normal = unit_vector(between)
    acts = (gap <= physics.contact_gap) & ~overlap(boxes)
    size = jnp.where(acts, repulsion(physics, gap), 0.0)
    force = size * normal[0], size * normal[1]
    there = tuple(here[k] - between[k] - offset[k] for k in (0, 1))
    return force, cross(here, force), -cross(there, force)
