"""Which chains of a batch need contact in a control step, and the step with contact for just these.

Arrays have the batch last: vectors are (2, unit, batch). The whole batch steps without contact; the
chains in which units may touch are then gathered, chunk by chunk, and stepped again with it.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from salpchain.physics.batching import redo, where
from salpchain.physics.contact import Pairs, contact_load, every_contact_load, touching_distance
from salpchain.physics.obstacles import Facing, distance_squared_beyond, every_load, obstacle_load
from salpchain.physics.substeps import Load, Motion, Moved, Rig, run_substeps

# How much closer two units of a chain that nothing touches may come in one control step than on
# straight ways at constant speed (chosen; 4 mm were seen, and a test compares with all pairs).
STRAY = 0.016  # m
# How much closer two units may come in one control step where others touch, beyond what their
# speeds bring them (chosen; the same test): full thrust moves a free unit by 1 cm.
SLACK = 0.02  # m
# How much farther contact elsewhere in the chain may press two neighbours together (chosen; the
# same test).
PRESSED = 0.012  # m
# What turning within a control step may add to the reach of two neighbours towards each other,
# beyond its value before and after (chosen; the same test).
TURN_SLACK = 0.003  # m

SHARE = 16  # a chunk of crowded chains is this part of the batch (chosen)
AWAY = 1e4  # m, where slots are put that nothing may touch (chosen)
BLOCK = 4  # neighbouring units in one bounding circle (chosen)


def advance(rig: Rig, units: Motion, links: Motion, push: Load, contact: bool) -> Moved:
    """Both kinds of body one control step later."""
    free = run_substeps(rig, units, links, push, None)
    contact = contact and units.angle.shape[0] > 1
    near = _flagged(rig, units, free, contact)
    if near is None:
        return free
    batch = units.angle.shape[-1]

    def with_contact(chosen: Int[Array, " some"]) -> Moved:
        return _step_crowded(contact, *_take((rig, units, links, push, free), chosen, batch))

    return redo(near, free, with_contact, _chunk(batch), axis=-1)


def advance_differentiably(
    rig: Rig, units: Motion, links: Motion, push: Load, contact: bool
) -> Moved:
    """`advance` without loops of unknown length, so that it can be differentiated backwards too.

    Which units may touch does not depend on where they are by any derivative.
    """
    obstruction = None if rig.obstacles is None else partial(every_load, rig)
    if not contact or units.angle.shape[0] < 2:
        return run_substeps(rig, units, links, push, None, obstruction)
    free = run_substeps(rig, units, links, push, None)
    fixed = jax.lax.stop_gradient((rig, units, free))
    near = _flagged(*fixed, contact)
    assert near is not None

    # Chains that touch nothing are constants here: what is not used has no derivative.
    moving = units, links, push
    units, links, push = where(near, moving, jax.lax.stop_gradient(moving), axis=-1)
    load = partial(every_contact_load, rig, _near_pairs(*fixed))
    touched = run_substeps(rig, units, links, push, load, obstruction)
    return where(near, touched, free, axis=-1)


def _flagged(rig: Rig, units: Motion, free: Moved, contact: bool) -> Bool[Array, " batch"] | None:
    """Chains in which something may touch in this control step; None if nothing ever can."""
    near = crowded(rig, units, free) if contact else None
    if rig.obstacles is None:
        return near
    at_obstacle = near_obstacle(rig, units, free)
    return at_obstacle if near is None else near | at_obstacle


def _chunk(batch: int) -> int:
    return min(batch, max(8, batch // SHARE))


def _take(tree: Any, index: Int[Array, " some"], batch: int) -> Any:
    """These chains of every array that has the batch; scalars are shared by all."""
    return jax.tree.map(
        lambda x: x[..., index] if jnp.ndim(x) and x.shape[-1] == batch else x, tree
    )


def _step_crowded(
    contact: bool, rig: Rig, units: Motion, links: Motion, push: Load, free: Moved
) -> Moved:
    load = partial(contact_load, rig, _near_pairs(rig, units, free)) if contact else None
    if rig.obstacles is None:
        return run_substeps(rig, units, links, push, load)
    obstruction = partial(obstacle_load, rig, facing_solids(rig, units))
    return run_substeps(rig, units, links, push, load, obstruction)


def crowded(rig: Rig, units: Motion, free: Moved) -> Bool[Array, " batch"]:
    """Chains in which some pair of units may touch in this control step.

    Up to the first touch a chain moves as it does without contact, so that motion tells all.
    """
    num = units.angle.shape[0]
    place, reach = _half_way(rig, units, free)
    near = _neighbours_near(rig, units, free)
    if num <= 4 * BLOCK:
        return near | (_least_square(place, rig.joined, num // 2) < reach**2)
    near |= _least_square(place, rig.joined, 2 * BLOCK - 1) < reach**2
    return near | _far_units_near(place, rig.present, reach)


def _half_way(
    rig: Rig, units: Motion, free: Moved
) -> tuple[Float[Array, "2 unit batch"], Float[Array, " batch"]]:
    """Where units are half way without contact (m), and the distance within which two may touch.

    On straight ways two units come no closer than that less half of what they move to each other.
    """
    way = free.units.position - units.position
    drift = _mean(way, rig.present)
    farthest = jnp.where(rig.present, _square(way - drift[:, None]), 0.0).max(axis=0)
    reach = touching_distance(rig.physics) + STRAY + jnp.sqrt(farthest)
    return _scattered(rig.present, units.position + way / 2), reach


def _mean(x: Float[Array, "2 unit batch"], present: Bool[Array, "unit batch"]) -> Array:
    return jnp.where(present, x, 0.0).sum(axis=1) / jnp.maximum(present.sum(axis=0), 1)


def _scattered(
    present: Bool[Array, "unit batch"], place: Float[Array, "2 unit batch"]
) -> Float[Array, "2 unit batch"]:
    """Positions (m), with dead slots far from all others and from each other."""
    away = AWAY * (1.0 + jnp.arange(len(present))[:, None])
    return jnp.where(present, place, away)


def _least_square(
    place: Float[Array, "2 unit batch"], joined: Bool[Array, "link batch"], most: int
) -> Float[Array, " batch"]:
    """Least square distance (m2) of two units of a chain up to `most` slots apart, counted round.

    Neighbours that a link joins do not count.
    """
    num = place.shape[1]
    twice = jnp.concatenate([place, place[:, :most]], axis=1)
    ends = jnp.concatenate([joined, joined if num == 2 else jnp.zeros_like(joined[:1])])
    least = _square(twice[:, 1 : num + 1] - place) + jnp.where(ends, AWAY, 0.0)
    for shift in range(2, most + 1):
        least = jnp.minimum(least, _square(twice[:, shift : num + shift] - place))
    return least.min(axis=0)


def _neighbours_near(rig: Rig, units: Motion, free: Moved) -> Bool[Array, " batch"]:
    """Chains in which two units that a link joins may touch."""
    return (_held_near(rig, units, free, 0.0) & rig.joined).any(axis=0)


def _held_near(rig: Rig, units: Motion, free: Moved, margin: float) -> Bool[Array, "link batch"]:
    """Neighbours that come near enough to touch, or within a margin (m) of it.

    Two boxes are at least as far apart as their centres less what each extends towards the other.
    """
    distance = jnp.sqrt(free.nearest) - margin
    near = distance < touching_distance(rig.physics)

    def turned_to_touch() -> Bool[Array, "link batch"]:
        extent = jnp.maximum(_extent(rig.physics, units), _extent(rig.physics, free.units))
        return near & (distance < extent + TURN_SLACK + rig.physics.contact_gap)

    return jax.lax.cond(near.any(), turned_to_touch, lambda: near)


def _extent(physics: Any, units: Motion) -> Float[Array, "link batch"]:
    """How far (m) the boxes of neighbours reach towards each other, both together."""
    gap = units.position[:, 1:] - units.position[:, :-1]
    gap = gap / jnp.maximum(jnp.sqrt(_square(gap)), 1e-9)
    turn = jnp.stack([jnp.cos(units.angle), jnp.sin(units.angle)])
    total = jnp.zeros_like(gap[0])
    for box in (turn[:, :-1], turn[:, 1:]):
        along = jnp.abs(box[0] * gap[0] + box[1] * gap[1])
        across = jnp.abs(box[0] * gap[1] - box[1] * gap[0])
        total += physics.unit_length / 2 * along + physics.unit_width / 2 * across
    return total


def _far_units_near(
    place: Float[Array, "2 unit batch"],
    present: Bool[Array, "unit batch"],
    reach: Float[Array, " batch"],
) -> Bool[Array, " batch"]:
    """Chains in which units that are two blocks apart or more, counted round, may touch.

    First the bounding circles of blocks of neighbouring units; all pairs only where two come near.
    """
    near = _some_within(*_blocks(place, present), reach)
    alone = jnp.zeros(place.shape[1:])
    return jax.lax.cond(near.any(), lambda: _some_within(place, alone, reach), lambda: near)


def _some_within(
    centre: Float[Array, "2 circle batch"],
    radius: Float[Array, "circle batch"],
    reach: Float[Array, " batch"],
) -> Bool[Array, " batch"]:
    """Chains in which some two circles that are no neighbours, counted round, are within reach."""
    num, batch = radius.shape
    circles = jnp.concatenate([centre, radius[None]])
    twice = jnp.concatenate([circles, circles], axis=1)

    def look(shift: Array, near: Array) -> Array:
        other = jax.lax.dynamic_slice_in_dim(twice, shift, num, axis=1)
        apart = jnp.maximum(radius + other[2] + reach, 0.0)
        return near | (_square(other[:2] - centre) < apart**2).any(axis=0)

    return jax.lax.fori_loop(2, num // 2 + 1, look, jnp.zeros(batch, bool))


def _blocks(
    place: Float[Array, "2 unit batch"], present: Bool[Array, "unit batch"]
) -> tuple[Float[Array, "2 block batch"], Float[Array, "block batch"]]:
    """Bounding circles of each block's present units; the radius is -inf where there are none."""
    num, batch = present.shape
    rows = jnp.arange(-(-num // BLOCK) * BLOCK)
    split = (-1, BLOCK, batch)
    alive = (present[jnp.minimum(rows, num - 1)] & (rows < num)[:, None]).reshape(split)
    inside = place[:, jnp.minimum(rows, num - 1)].reshape(2, *split)
    low = jnp.where(alive, inside, AWAY).min(axis=2)
    high = jnp.where(alive, inside, -AWAY).max(axis=2)
    centre = (low + high) / 2
    distance = jnp.sqrt(_square(inside - centre[:, :, None]))
    return centre, jnp.where(alive, distance, -jnp.inf).max(axis=1)


def _square(vector: Array) -> Array:
    return vector[0] ** 2 + vector[1] ** 2


def _near_pairs(rig: Rig, units: Motion, free: Moved) -> Pairs:
    """The pairs of units that may touch in this control step.

    Two neighbours that are known to stay apart are left out.
    """
    num, batch = units.angle.shape
    apart = rig.joined & ~_held_near(rig, units, free, PRESSED)
    near = _may_touch(rig, units, apart)
    rank = jnp.cumsum(near, axis=0, dtype=jnp.int32)
    lists = -(-rank[-1].max() // (num // 2))

    def add(index: Array, chosen: Int[Array, "list pair batch"]) -> Array:
        wanted = 1 + index * (num // 2) + jnp.arange(num // 2)
        place = jax.vmap(jnp.searchsorted, in_axes=(1, None), out_axes=1)(rank, wanted)
        return chosen.at[index].set(jnp.where(place < len(near), place, -1))

    none = jnp.full((-(-len(near) // (num // 2)), num // 2, batch), -1)
    chosen = jax.lax.fori_loop(0, lists, add, none)
    one = jnp.where(chosen < 0, 0, chosen % num)
    other = jnp.where(chosen < 0, 0, (one + chosen // num + 1) % num)
    return Pairs(jnp.minimum(one, other), jnp.maximum(one, other), lists)


def _may_touch(
    rig: Rig, units: Motion, apart: Bool[Array, "link batch"]
) -> Bool[Array, "pair batch"]:
    """For every two units (in order of slots apart, counted round) whether they may touch."""
    num, batch = units.angle.shape
    way = units.velocity * rig.physics.control_step
    state = jnp.concatenate([_scattered(rig.present, units.position), way])
    twice = jnp.concatenate([state, state], axis=1)
    apart = jnp.concatenate([apart, jnp.zeros_like(apart[:1])])

    def near(shift: Array) -> Array:
        other = jax.lax.dynamic_slice_in_dim(twice, shift, num, axis=1)
        gap = other - state
        closing = jnp.sqrt(_square(gap[2:]))
        if rig.obstacles is not None:  # they may turn one of the two round
            closing = jnp.sqrt(_square(other[2:])) + jnp.sqrt(_square(state[2:]))
        reach = touching_distance(rig.physics) + SLACK + closing
        once = (2 * shift < num) | (jnp.arange(num) < num // 2)  # the far side comes twice
        return (_square(gap) < reach**2) & once[:, None] & ~(apart & (shift == 1))

    return jax.lax.map(near, jnp.arange(1, num // 2 + 1)).reshape(-1, batch)


def near_obstacle(rig: Rig, units: Motion, free: Moved) -> Bool[Array, " batch"]:
    """Chains in which some unit may touch an obstacle in this control step.

    Half way without contact (see `_half_way`; an obstacle does not move, so it is half as much).
    """
    way = free.units.position - units.position
    reach = _unit_reach(rig) + (STRAY + jnp.sqrt(_square(way))) / 2
    place = _scattered(rig.present, units.position + way / 2)

    def look(index: Array, least: Array) -> Array:
        solid = jax.tree.map(lambda x: x[index], rig.obstacles)
        return jnp.minimum(least, distance_squared_beyond(solid, place, reach))

    num = rig.obstacles.rim.shape[0]
    least = jax.lax.fori_loop(0, num, look, jnp.full_like(units.angle, jnp.inf))
    return least.min(axis=0) < 0


def _unit_reach(rig: Rig) -> Any:
    """Distance (m) from a unit's centre beyond which it touches no surface."""
    return touching_distance(rig.physics) / 2 + rig.physics.contact_gap


def facing_solids(rig: Rig, units: Motion) -> Facing:
    """For each unit the obstacles that it may touch in this control step, at any speed that is in
    the chain: units pass it on to each other."""
    speed = jnp.where(rig.present, jnp.sqrt(_square(units.velocity)), 0.0).max(axis=0)
    reach = _unit_reach(rig) + SLACK + speed * rig.physics.control_step
    place = _scattered(rig.present, units.position)
    near = jax.lax.map(lambda one: distance_squared_beyond(one, place, reach) < 0, rig.obstacles)
    rank = jnp.cumsum(near, axis=0, dtype=jnp.int32)

    def add(index: Array, chosen: Int[Array, "list unit batch"]) -> Array:
        wanted = near & (rank == index + 1)
        return chosen.at[index].set(jnp.where(wanted.any(axis=0), wanted.argmax(axis=0), -1))

    lists = rank[-1].max()
    return Facing(jax.lax.fori_loop(0, lists, add, jnp.full(near.shape, -1)), lists)
