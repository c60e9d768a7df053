"""What may touch in a control step, in one flat list for all chains of a batch.

Each unit may touch several others: units of its own chain, or obstacles. Whether it does is a bit;
the bits that are set are gathered into a list, which the substeps go through in chunks, so that a
control step costs what may touch, in whichever chains that is.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from salpchain.errors import InputError
from salpchain.xla import materialise, on_cpu

AWAY = 1e4  # m, where what is not there is put (chosen)
WORD = 32  # bits
UNROLLED = 8  # so many others are looked at without a loop (chosen)
MOST = 8  # candidates for each unit that the list has room for (chosen)
CHUNK = 8  # candidates gone through at once, as a part of the batch's units (chosen)
LEAST, MOST_AT_ONCE = 32, 128  # but no fewer, and on a CPU no more than these (chosen)

Words = UInt32[Array, "other part batch"]
# For units of the whole batch (unit * batch + chain) what they are given: force (N, x and y) and
# torque (N m), each (candidate,).
Pushes = list[tuple[Array, list[Array]]]
# Given are unit and other of some candidates, whether they are any, and a false flag of which XLA
# does not know that.
Exert = Callable[[Array, Array, Array, Array], Pushes]


class Candidates(NamedTuple):
    """What may touch: other * (num * batch) + unit * batch + chain, as one number each.

    Where there are more than the list has room for, every unit is tried with every other.
    """

    code: Int[Array, " slot"]
    count: Int[Array, ""]
    first: int  # of the others that a unit may touch
    others: int  # how many they are

    def at(self, slot: Int[Array, " some"], size: int) -> Int[Array, " some"]:
        """The codes of some candidates, of `size` units in the batch."""
        listed = self.code.at[slot].get(mode="clip")
        return jnp.where(self.overfull, self.first * size + slot, listed)

    def tried(self, size: int) -> Int[Array, ""]:
        """How many are tried, of `size` units in the batch."""
        return jnp.where(self.overfull, self.others * size, self.count)

    @property
    def overfull(self) -> Bool[Array, ""]:
        """Whether there are more than the list has room for."""
        return self.count > len(self.code)


def marked(near: Callable[[Any], Bool[Array, "unit batch"]], others: range) -> Words:
    """A bit for each unit and other that are near, 32 neighbouring units to a word."""
    if len(others) <= UNROLLED:
        return jnp.stack([packed(near(other)) for other in others])
    return jax.lax.map(lambda other: packed(near(other)), jnp.arange(others.start, others.stop))


def packed(near: Bool[Array, "unit batch"]) -> UInt32[Array, "part batch"]:
    """The bits of units, 32 to a word."""
    num, batch = near.shape
    parts = -(-num // WORD)
    bits = jnp.pad(near, ((0, parts * WORD - num), (0, 0))).reshape(parts, WORD, batch)
    value = jnp.uint32(1) << jnp.arange(WORD, dtype=jnp.uint32)
    return jnp.where(bits, value[:, None], jnp.uint32(0)).sum(axis=1, dtype=jnp.uint32)


def listed(words: Words, num: int, first: int = 0) -> Candidates:
    """The candidates whose bits are set; the others are counted from `first` on.

    Raises:
        InputError: more pairs than numbers of 32 bits can tell apart.
    """
    others, parts, batch = words.shape
    if (first + others) * num * batch >= 2**31:
        raise InputError(
            f"{batch} chains of {num} units are too many at once: fewer than"
            f" {2**31 // ((first + others) * num)} of them may step together"
        )
    room = min(others, MOST) * num * batch
    if not on_cpu():
        bits = (words[:, :, None] >> jnp.arange(WORD, dtype=jnp.uint32)[:, None]) & 1
        flat = bits.reshape(others, parts * WORD, batch)[:, :num].reshape(-1)
        code = jnp.nonzero(flat, size=room, fill_value=0)[0].astype(jnp.int32)
        return Candidates(code + first * num * batch, flat.sum(dtype=jnp.int32), first, others)
    other, part = jnp.divmod(jnp.arange(others * parts, dtype=jnp.int32), jnp.int32(parts))
    begin = ((first + other) * num + part * WORD)[:, None] * batch
    begin = (begin + jnp.arange(batch, dtype=jnp.int32)).reshape(-1)
    bits = words.reshape(-1)

    def look(index: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        def add(inner: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            left, code, count = inner
            lowest = left & (~left + 1)
            place = jax.lax.population_count(lowest - 1).astype(jnp.int32)
            code = _put(code, begin[index] + place * batch, jnp.minimum(count, room))
            return left ^ lowest, code, count + 1

        return jax.lax.while_loop(lambda inner: inner[0] != 0, add, (bits[index], *found))[1:]

    nothing = jnp.zeros(room + 1, jnp.int32), jnp.zeros((), jnp.int32)  # one more is written over
    code, count = jax.lax.fori_loop(0, len(bits), look, nothing)
    return Candidates(code[:room], count, first, others)


def _put(array: Array, value: Array, at: Array) -> Array:
    return jax.lax.dynamic_update_index_in_dim(array, value, at, 0)


def pushed(
    lists: Sequence[Candidates], exert: Exert, num: int, batch: int
) -> Float[Array, "3 unit batch"]:
    """Force (N, x and y) and torque (N m) on every unit, by all candidates."""
    size = num * batch
    chunk = max(size // CHUNK, LEAST)
    chunk = min(chunk, MOST_AT_ONCE) if on_cpu() else chunk
    ends = jnp.cumsum(jnp.stack([some.tried(size) for some in lists]))

    def add(index: Array, totals: list[Array]) -> list[Array]:
        slot = index * chunk + jnp.arange(chunk, dtype=jnp.int32)
        code = lists[0].at(slot, size)
        for some, end in zip(lists[1:], ends, strict=False):
            code = jnp.where(slot < end, code, some.at(slot - end, size))
        other, unit = jnp.divmod(code, jnp.int32(size))
        never = ends[-1] < 0
        pushes = materialise(exert(unit, other, slot < ends[-1], never), never)
        return _sum(totals, pushes, jnp.minimum(chunk, ends[-1] - index * chunk))

    totals = jax.lax.fori_loop(0, -(-ends[-1] // chunk), add, [jnp.zeros(size)] * 3)
    return jnp.stack(totals).reshape(3, num, batch)


def _sum(totals: list[Array], pushes: Pushes, filled: Array) -> list[Array]:
    """The totals of all units with what the first `filled` candidates give them.

    On a CPU a loop over candidates is compiled with the substeps as one function, while with XLA's
    own scatter they would be many.
    """
    if not on_cpu():
        for to, values in pushes:
            totals = [total.at[to].add(value) for total, value in zip(totals, values, strict=True)]
        return totals

    def one(which: Array, totals: list[Array]) -> list[Array]:
        for to, values in pushes:
            at = to[which]
            totals = [
                _put(total, total[at] + value[which], at)
                for total, value in zip(totals, values, strict=True)
            ]
        return totals

    return jax.lax.fori_loop(0, filled, one, totals)


def of_each(constants: Any, chain: Int[Array, " candidate"]) -> Any:
    """Constants, those that differ between chains as they are for each candidate."""
    return jax.tree.map(lambda x: x[chain] if jnp.ndim(x) else x, constants)


def scattered(
    present: Bool[Array, "unit batch"], place: Float[Array, "2 unit batch"]
) -> Float[Array, "2 unit batch"]:
    """Positions (m), with dead slots far from all others and from each other."""
    away = AWAY * (1.0 + jnp.arange(len(present))[:, None])
    return jnp.where(present, place, away)
