"""Batches: any nesting of `jax.vmap` gives what a loop over single chains gives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from salpchain.physics.batching import redo
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from tests.physics.poses import bent, largest_difference, lively, resting, thrusts

step_one = jax.jit(step)
apart = functools.partial(step, contact=False)
step_apart = jax.jit(apart)


def select(tree, *index):
    return jax.tree.map(lambda x: x[index], tree)


def test_redo_replaces_the_flagged_chains_and_no_others_whatever_the_chunk():
    flags = np.random.default_rng(0).uniform(size=23) < 0.4
    old = {"a": jnp.arange(23.0), "b": jnp.arange(46.0).reshape(23, 2)}

    def make(chosen):
        return {"a": -old["a"][chosen], "b": -old["b"][chosen]}

    for chunk in (1, 4, 23):
        new = redo(jnp.asarray(flags), old, make, chunk)
        for name, values in old.items():
            sign = np.where(flags, -1, 1).reshape(-1, *(1,) * (values.ndim - 1))
            assert np.array_equal(new[name], sign * values)


def assert_same_places(one, other):
    assert largest_difference(one.units.position, other.units.position) <= 1e-6
    assert largest_difference(one.links.position, other.links.position) <= 1e-6


def test_nested_batches_of_crowded_chains_equal_a_loop_over_chains():
    rng = np.random.default_rng(0)
    chains, push = lively(rng, 5, bend=2.6, batch=40), thrusts(rng, 40, 5)
    nested = jax.tree.map(lambda x: x.reshape(4, 10, *x.shape[1:]), (chains, push))
    ours = jax.jit(jax.vmap(jax.vmap(step)))(*nested)
    touched = 0
    for index in range(40):
        one = select(chains, index), push[index]
        assert_same_places(select(ours, index // 10, index % 10), step_one(*one))
        touched += largest_difference(step_one(*one), step_apart(*one)) > 1e-3
    assert touched > 8  # chains with contact are stepped eight at a time here


def test_chains_and_thrusts_on_different_axes_equal_a_loop_over_both():
    rng = np.random.default_rng(1)
    chains, push = lively(rng, 5, batch=2), thrusts(rng, 3, 5)
    over_thrusts, over_chains = ({"in_axes": axes} for axes in ((None, 0), (0, None)))
    ours = jax.vmap(jax.vmap(apart, **over_thrusts), **over_chains)
    swapped = jax.vmap(jax.vmap(apart, **over_chains), **over_thrusts)
    ours, swapped = (jax.jit(stepper)(chains, push) for stepper in (ours, swapped))
    for first in range(2):
        for second in range(3):
            alone = step_apart(select(chains, first), push[second])
            assert_same_places(select(ours, first, second), alone)
            assert_same_places(select(swapped, second, first), alone)


def test_other_batch_axes_than_the_first_work_too():
    rng = np.random.default_rng(2)
    chains, push = lively(rng, 5, batch=3), thrusts(rng, 3, 5)
    ours = jax.jit(jax.vmap(apart, in_axes=(0, 1), out_axes=0))(chains, push.T)
    for index in range(3):
        assert_same_places(select(ours, index), step_apart(select(chains, index), push[index]))


MASS = jnp.array([0.8, 1.0, 1.5])  # kg
DRAG = jnp.array([0.0, 0.25, 0.5])
LENGTH = jnp.array([0.065, 0.07, 0.08])  # m


def random_physics():
    return jax.vmap(lambda *some: Physics(unit_mass=some[0], drag=some[1], link_length=some[2]))(
        MASS, DRAG, LENGTH
    )


def plain_physics(index):
    mass, drag, length = (float(x[index]) for x in (MASS, DRAG, LENGTH))
    return Physics(unit_mass=mass, drag=drag, link_length=length)


def test_a_batch_of_physics_equals_separate_runs():
    rng = np.random.default_rng(3)
    chains, push = lively(rng, 5, bend=2.6, batch=3), thrusts(rng, 3, 5)
    ours = jax.jit(jax.vmap(step))(chains, push, random_physics())
    for index in range(3):
        alone = step_one(select(chains, index), push[index], plain_physics(index))
        assert_same_places(select(ours, index), alone)


def test_physics_on_the_outer_axis_only_equals_separate_runs():
    rng = np.random.default_rng(4)
    chains, push = lively(rng, 5, batch=4), thrusts(rng, 4, 5)
    inner = jax.vmap(apart, in_axes=(0, 0, None))
    ours = jax.jit(jax.vmap(inner, in_axes=(None, None, 0)))(chains, push, random_physics())
    for index in range(3):
        for place in range(4):
            alone = step_apart(select(chains, place), push[place], plain_physics(index))
            assert_same_places(select(ours, index, place), alone)


def test_constants_may_be_traced():
    """A unit of twice the mass goes half as far under the same thrust."""
    chain = at_rest(jnp.array([[0.0, 0.0], [1.0, 0.0]]), jnp.zeros(2), linked=jnp.array([False]))

    def way(mass):
        return apart(chain, jnp.ones(2), Physics(unit_mass=mass)).units.position[0, 1]

    light, heavy = jax.jit(way)(jnp.float32(1.0)), jax.jit(way)(jnp.float32(2.0))
    assert np.isclose(light, 2 * heavy)


def test_resetting_one_chain_leaves_the_others_bit_identical():
    rng = np.random.default_rng(5)
    chains = lively(rng, 8, bend=2.6, batch=12)
    fresh = select(resting(*bent(rng, 1, 8, 0.3)), 0)
    reset = jax.tree.map(lambda x, new: x.at[4].set(new), chains, fresh)
    others = np.arange(12) != 4
    step_all = jax.jit(jax.vmap(step))
    for _ in range(5):
        push = thrusts(rng, 12, 8)
        chains, reset = step_all(chains, push), step_all(reset, push)
        assert largest_difference(select(chains, others), select(reset, others)) == 0


def test_a_step_is_compiled_once_for_each_shape():
    stepper = jax.jit(jax.vmap(apart))
    rng = np.random.default_rng(6)
    chains = lively(rng, 4, batch=3)
    for _ in range(3):
        chains = stepper(chains, thrusts(rng, 3, 4))
    cut = eqx.tree_at(lambda c: c.linked, chains, jnp.zeros_like(chains.linked))
    stepper(cut, thrusts(rng, 3, 4))
    assert stepper._cache_size() == 1
