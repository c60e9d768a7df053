"""The search for best-known solutions: its steps through the engine, on little work."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.evaluation.best import play
from salpchain.physics.chain import step
from studies.best import descent
from studies.best.run import shaken, squeezed

PLACES = [(2, 0), (3, 1), (3, 2)]
STEPS = 6


@pytest.fixture(scope="module")
def posed():
    chains, targets = play.poses(PLACES, 3)
    thrusts = np.random.default_rng(0).uniform(-1, 1, (STEPS, 3, len(PLACES)))
    return chains, targets, jnp.asarray(thrusts, jnp.float32)


def test_where_it_ends_is_where_the_engine_ends_at_each_horizon(posed):
    chains, targets, thrusts = posed
    horizons = np.array([2, 4, 6])
    off = np.asarray(descent.ends(descent.problem(chains, targets, horizons), thrusts))
    move = jax.jit(jax.vmap(step))
    for time in range(1, STEPS + 1):
        chains = move(chains, thrusts[time - 1].T)
        for swim in np.flatnonzero(horizons == time):
            length = PLACES[swim][0]
            apart = np.asarray(chains.units.position - targets)[swim, :length]
            np.testing.assert_allclose(off[:, :length, swim].T, apart, atol=2e-5)
            assert (off[:, length:, swim] == 0).all()


def test_a_dead_unit_pushes_nothing_and_its_thrust_is_left_alone(posed):
    chains, targets, thrusts = posed
    live = np.array([[True, False, True], [False, True, True], [True, True, True]])
    full = np.full(len(PLACES), STEPS)
    task = descent.problem(chains, targets, full, jnp.asarray(live))
    silent = jnp.where(live.T, thrusts, 0.0)
    plain = descent.ends(descent.problem(chains, targets, full), silent)
    np.testing.assert_array_equal(descent.ends(task, thrusts), plain)
    assert (
        np.asarray(descent.ends(descent.problem(chains, targets, full), thrusts)) != plain
    ).any()
    after, _, _ = descent.sooner(task, thrusts, jnp.full(3, 0.2))
    changed = np.asarray(after != thrusts).any(axis=0)  # (unit, swim)
    assert not changed[~live.T].any() and changed[0, 0] and changed[1, 1]


def test_a_step_comes_nearer_within_its_trust_and_leaves_what_is_there(posed):
    chains, targets, thrusts = posed
    near = targets.at[2].set(chains.units.position[2])  # the third may stay where it is
    task = descent.problem(chains, near, np.full(3, STEPS))
    still = thrusts.at[..., 2].set(0.0)
    before = np.asarray(descent.loss(descent.ends(task, still)))
    after, trust, left = descent.sooner(task, still, jnp.full(3, 0.2))
    assert (np.asarray(left)[:2] < before[:2]).all() and float(left[2]) == 0
    assert float(jnp.abs(after - still).max()) <= 0.2 + 1e-6
    assert float(jnp.abs(after).max()) <= 1 and (np.asarray(after)[..., 2] == 0).all()
    assert (np.asarray(trust) > 0).all()


def test_squeezed_thrusts_begin_and_end_as_before():
    thrusts = np.linspace(-1, 1, 9)[:, None] * np.ones(2)
    np.testing.assert_allclose(squeezed(thrusts, 5), thrusts[::2])
    noisy = shaken(thrusts, 0.5, np.random.default_rng(0))
    assert noisy.shape == thrusts.shape and np.abs(noisy).max() <= 1
