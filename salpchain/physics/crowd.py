"""Which chains of a batch need contact in a control step, and the step with contact for just these.

Arrays have the batch last: vectors are (2, unit, batch). The whole batch steps without contact; the
chains in which units may touch are then gathered, chunk by chunk, and stepped again with it.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from salpchain.physics.contact import contact_load, touching_distance
from salpchain.physics.engine import Load, Motion, Rig, run_substeps

# How much closer two units may come in one control step (chosen; a test compares with all pairs).
FREE_SLACK = 0.02  # m, beyond their present relative speed: full thrust moves a free pair by 1 cm
HELD_SLACK = 0.008  # m, for two units that a link holds apart: a joint gives by a few millimetres

MOST_PARTNERS = 8  # units that one unit may touch, before all pairs are looked at (chosen)
SHARE = 16  # a chunk of crowded chains is this part of the batch (chosen)

Moved = tuple[Motion, Motion]


def advance(rig: Rig, units: Motion, links: Motion, push: Load, contact: bool) -> Moved:
    """Units and links one control step later."""
    free = run_substeps(rig, units, links, push, None)
    if not contact or units.angle.shape[0] < 2:
        return free
    return _mend_crowded(rig, units, links, push, free)


def _mend_crowded(rig: Rig, units: Motion, links: Motion, push: Load, free: Moved) -> Moved:
    """`free`, with the crowded chains stepped again with contact."""
    batch = units.angle.shape[-1]
    chunk = min(batch, max(8, batch // SHARE))

    def mend(carry: tuple[Array, Moved]) -> tuple[Array, Moved]:
        left, moved = carry
        chosen = jnp.nonzero(left, size=chunk, fill_value=0)[0]
        few = _touching(*_take((rig, units, links, push), chosen, batch))
        slot = jnp.cumsum(left) - 1
        done = left & (slot < chunk)
        back = _take(few, jnp.clip(slot, 0, chunk - 1), chunk)
        moved = jax.tree.map(lambda new, old: jnp.where(done, new, old), back, moved)
        return left & ~done, moved

    start = (crowded(rig, units), free)
    return jax.lax.while_loop(lambda carry: carry[0].any(), mend, start)[1]


def _take(tree: Any, index: Int[Array, " some"], batch: int) -> Any:
    """These chains of every array that has the batch; scalars are shared by all."""
    return jax.tree.map(
        lambda x: x[..., index] if jnp.ndim(x) and x.shape[-1] == batch else x, tree
    )


def _touching(rig: Rig, units: Motion, links: Motion, push: Load) -> Moved:
    num, batch = units.angle.shape

    def step_with(partner: Array) -> Moved:
        def load(units: Motion) -> Load:
            return contact_load(rig, partner, units)

        return run_substeps(rig, units, links, push, load)

    if num - 1 <= MOST_PARTNERS:
        return step_with(_all_partners(num, batch))
    partner, too_few = _partners_within_reach(rig, units)
    return jax.lax.cond(
        too_few, lambda: step_with(_all_partners(num, batch)), lambda: step_with(partner)
    )


def crowded(rig: Rig, units: Motion) -> Bool[Array, " batch"]:
    """Chains in which some pair of units may touch in this control step."""
    num = units.angle.shape[0]
    near = _within_reach(rig, units, 1, _held(rig, 1))
    if num <= 16:
        for shift in range(2, num // 2 + 1):
            near |= _within_reach(rig, units, shift, None)
        return near.any(axis=0)

    def look(shift: Array, near: Array) -> Array:
        return near | _within_reach(rig, units, shift, None)

    return jax.lax.fori_loop(2, num // 2 + 1, look, near).any(axis=0)


def _held(rig: Rig, shift: int | Array) -> Bool[Array, "unit batch"]:
    """Units that a link joins to the unit `shift` slots further on, counted round."""
    after = jnp.concatenate([rig.joined, jnp.zeros_like(rig.joined[:1])])
    before = jnp.roll(after, 1, axis=0)
    num = after.shape[0]
    return (after & (shift == 1)) | (before & (shift == num - 1))


def _within_reach(
    rig: Rig, units: Motion, shift: int | Array, held: Bool[Array, "unit batch"] | None
) -> Bool[Array, "unit batch"]:
    """Units that may touch the one `shift` slots on, counted round, in this control step."""
    gap, rush = (_ahead(x, shift) - x for x in (units.position, units.velocity))
    square = gap[0] ** 2 + gap[1] ** 2
    touching = touching_distance(rig.physics)
    reach = touching + FREE_SLACK + jnp.sqrt(_square(rush)) * rig.physics.control_step
    near = square < reach * reach
    if held is not None:
        near = jnp.where(held, _turned_to_each_other(rig, units, shift, gap), near)
    return near & rig.present & _ahead(rig.present, shift)


def _turned_to_each_other(rig: Rig, units: Motion, shift: int | Array, gap: Array) -> Array:
    """Whether two units that a link joins may touch: only if both turn a corner to the other.

    Their boxes are at least as far apart as their centres less what each extends towards the other.
    """
    physics = rig.physics
    distance = jnp.sqrt(_square(gap))
    line = jnp.arctan2(gap[1], gap[0])
    extent = jnp.zeros_like(distance)
    for angle in (units.angle, _ahead(units.angle, shift)):
        along, across = jnp.abs(jnp.cos(angle - line)), jnp.abs(jnp.sin(angle - line))
        extent += physics.unit_length / 2 * along + physics.unit_width / 2 * across
    near = distance - HELD_SLACK < touching_distance(physics)
    return near & (distance - HELD_SLACK < extent + physics.contact_gap)


def _ahead(x: Array, shift: int | Array) -> Array:
    return jnp.roll(x, -shift, axis=-2)


def _square(vector: Array) -> Array:
    return vector[0] ** 2 + vector[1] ** 2


def _all_partners(num: int, batch: int) -> Int[Array, "partner unit batch"]:
    """Every other unit, for each unit."""
    lists = (jnp.arange(num) + jnp.arange(1, num)[:, None]) % num
    return jnp.broadcast_to(lists[..., None], (num - 1, num, batch))


def _partners_within_reach(
    rig: Rig, units: Motion
) -> tuple[Int[Array, "partner unit batch"], Bool[Array, ""]]:
    """For each unit those within reach, itself filling up; and whether some list is too short."""
    num = units.angle.shape[0]
    rows = jnp.arange(num)[:, None]

    def find(shift: int | Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        partner, count = carry
        near = _within_reach(rig, units, shift, _held(rig, shift))
        place = near & (count == jnp.arange(MOST_PARTNERS)[:, None, None])
        return jnp.where(place, (rows + shift) % num, partner), count + near

    nobody = jnp.broadcast_to(rows, (MOST_PARTNERS, *units.angle.shape)).astype(jnp.int32)
    start = (nobody, jnp.zeros(units.angle.shape, jnp.int32))
    partner, count = jax.lax.fori_loop(1, num, find, start)
    return partner, (count > MOST_PARTNERS).any()
