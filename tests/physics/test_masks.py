"""Masked slots: chains of several lengths, cut chains and dead slots in one program."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.physics.chain import step
from salpchain.physics.state import Chain, at_rest
from tests.physics.poses import largest_difference, lively, thrusts

step_one, step_all = jax.jit(step), jax.jit(jax.vmap(step))


def padded(chain: Chain, slots: int) -> Chain:
    """The same chain in a longer row of slots, the others dead and full of zeros."""
    more = slots - len(chain.present)

    def pad(x):
        return jnp.pad(x, [(0, more)] + [(0, 0)] * (x.ndim - 1)) if x.ndim else x

    return jax.tree.map(pad, chain)


def part(chain: Chain, first: int, last: int) -> Chain:
    """The slots from `first` up to, not including, `last`."""
    units = (chain.units, chain.present)
    units, present = jax.tree.map(lambda x: x[first:last], units)
    links = (chain.links, chain.rest_angle, chain.linked)
    links, rest_angle, linked = jax.tree.map(lambda x: x[first : last - 1], links)
    return Chain(units, links, rest_angle, present, linked, chain.touching)


def stack(chains):
    return jax.tree.map(lambda *x: jnp.stack(x), *chains)


def with_dead_slots(chain: Chain, garbage) -> Chain:
    """The chain with `garbage` in every number of slots 5 to 7, which are dead."""
    filled = jax.tree.map(lambda x: x.at[5:].set(garbage), (chain.units, chain.rest_angle))
    links = jax.tree.map(lambda x: x.at[4:].set(garbage), chain.links)
    present = jnp.arange(8) < 5
    parts = (filled[0], filled[1].at[:4].set(chain.rest_angle[:4]), links, present)
    return eqx.tree_at(lambda c: (c.units, c.rest_angle, c.links, c.present), chain, parts)


def travel(stepper, chain, pushes):
    """The chain after all these thrusts, each held for one control step."""
    for thrust in pushes:
        chain = stepper(chain, thrust)
    return chain


def places(chain):
    return chain.units.position, chain.links.position


def run_together_and_alone(rng, lengths, steps):
    """Chains of these lengths in one batch of 8 slots, and the same chains each by itself."""
    alone = [lively(rng, num) for num in lengths]
    pushes = thrusts(rng, steps, len(lengths), 8)
    together = travel(step_all, stack([padded(chain, 8) for chain in alone]), pushes)
    for index, num in enumerate(lengths):
        ours = part(jax.tree.map(lambda x, i=index: x[i], together), 0, num)
        yield ours, travel(step_one, alone[index], pushes[:, index, :num])


def cut_and_apart(rng, steps):
    """The halves of a chain of 8 cut in the middle, and the same halves as chains of 4."""
    chain = lively(rng, 8)
    # far from each other, or the two ends at the cut would touch
    far = chain.units.position.at[4:].add(2.0), chain.links.position.at[4:].add(2.0)
    chain = eqx.tree_at(places, chain, far)
    chain = eqx.tree_at(lambda c: c.linked, chain, chain.linked.at[3].set(False))
    pushes = thrusts(rng, steps, 8)
    cut = travel(step_one, chain, pushes)
    for first, last in ((0, 4), (4, 8)):
        apart = travel(step_one, part(chain, first, last), pushes[:, first:last])
        yield part(cut, first, last), apart


def test_chains_of_mixed_lengths_move_as_each_does_alone():
    for together, alone in run_together_and_alone(np.random.default_rng(0), (2, 5, 8), 10):
        assert largest_difference(places(together), places(alone)) <= 1e-6


def test_a_chain_cut_in_the_middle_moves_as_two_chains():
    for cut, apart in cut_and_apart(np.random.default_rng(1), 10):
        assert largest_difference(places(cut), places(apart)) <= 1e-6


def test_a_missing_unit_cuts_the_chain_on_both_sides():
    rng = np.random.default_rng(2)
    chain = lively(rng, 8)
    gone = eqx.tree_at(lambda c: c.present, chain, chain.present.at[3].set(False))
    cut = eqx.tree_at(lambda c: c.linked, gone, chain.linked.at[2:4].set(False))
    thrust = thrusts(rng, 8)
    assert largest_difference(step_one(gone, thrust).units, step_one(cut, thrust).units) == 0


@pytest.mark.parametrize("garbage", [0.0, 0.02, 1e6, -1e30, 3e38])
def test_what_dead_slots_hold_changes_nothing(garbage):
    rng = np.random.default_rng(3)
    chain = lively(rng, 8)
    pushes = thrusts(rng, 3, 8)
    ours = travel(step_one, with_dead_slots(chain, garbage), pushes)
    expected = travel(step_one, with_dead_slots(chain, 1.0), pushes)
    assert largest_difference(part(ours, 0, 5), part(expected, 0, 5)) == 0
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(ours))


def test_dead_slots_stay_where_they_are():
    chain = with_dead_slots(lively(np.random.default_rng(4), 8), 0.3)
    after = step_one(chain, jnp.ones(8))
    assert (after.units.position[5:] == chain.units.position[5:]).all()
    assert (after.links.angle[4:] == chain.links.angle[4:]).all()


def test_a_dead_unit_is_not_touched():
    """The second unit lies askew next to the third, 6 cm away, without links."""
    position = jnp.array([[0.0, 0.0], [1.0, 0.03], [1.0, 0.0]])
    nobody, alone = jnp.zeros(2, bool), jnp.array([True, False, True])
    start = at_rest(position, jnp.array([0.0, 0.8, 0.0]), linked=nobody)
    dead = eqx.tree_at(lambda c: c.present, start, alone)
    near = start.units.position.at[1, 1].set(0.06)
    start, dead = (eqx.tree_at(lambda c: c.units.position, c, near) for c in (start, dead))
    moved = [step_one(c, jnp.zeros(3)).units.position - near for c in (start, dead)]
    assert np.abs(moved[0]).max() > 1e-3
    assert np.abs(moved[1]).max() == 0


def test_a_chain_of_dead_slots_only_rests():
    straight = jnp.stack([0.07 * jnp.arange(8.0), jnp.zeros(8)], -1)
    chain = at_rest(straight, jnp.zeros(8))
    dead = eqx.tree_at(lambda c: c.present, chain, jnp.zeros(8, bool))
    assert largest_difference(step_one(dead, jnp.ones(8)), dead) == 0
