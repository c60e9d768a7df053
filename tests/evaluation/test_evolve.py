"""Breeding policies for each start: nothing gets worse, and a swim is what is replayed."""

from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.named import controller
from salpchain.evaluation.best.play import MARGIN, poses, replay
from salpchain.tasks.config import GOAL_LIMIT
from salpchain.tasks.reach.task import SCLD
from studies.best.evolve import begun, bred, mutated
from studies.best.phases import parts
from studies.best.run import swims_of

PLACES = [(2, start) for start in range(6)]


@pytest.fixture(scope="module")
def generations():
    policy = controller("any-length")
    env = SCLD(policy.card.task(2, tolerance=GOAL_LIMIT - MARGIN, most_steps=40))
    first, rest = begun(policy, len(PLACES), 40, 2)
    chains, targets = poses(PLACES, 2)
    told = [bred(rest, env, chains, targets, first, jr.key(0))]
    told[0] = eqx.tree_at(lambda one: one.shake, told[0], jnp.full(len(PLACES), 0.3))
    for number in range(1, 9):
        told.append(bred(rest, env, chains, targets, told[-1], jr.key(number)))
    return told


def test_the_first_parents_swim_as_the_policy_does(generations):
    _, own = swims_of("any-length", PLACES, 2, GOAL_LIMIT - MARGIN)
    np.testing.assert_allclose(generations[0].steps, own, atol=1)  # its thrusts are not rounded


def test_breeding_makes_swims_shorter_and_none_longer(generations):
    steps = np.array([one.steps for one in generations])
    assert (np.diff(steps, axis=0) <= 0).all()
    assert steps[-1].sum() < steps[0].sum()


def test_as_many_steps_count_only_when_the_units_come_nearer(generations):
    for before, after in pairwise(generations):
        same = np.asarray(before.steps == after.steps)
        assert (np.asarray(after.apart)[same] <= np.asarray(before.apart)[same]).all()


def test_what_was_bred_is_what_is_replayed(generations):
    last = generations[-1]
    swims = [one[:end] for one, end in zip(np.asarray(last.thrusts), last.steps, strict=True)]
    assert replay(PLACES, swims, GOAL_LIMIT - MARGIN).steps.tolist() == last.steps.tolist()
    np.testing.assert_allclose(parts(PLACES, swims).sum(axis=1), last.steps)


def test_a_start_without_shake_keeps_its_weights():
    weights = {"some": jnp.ones((2, 5, 3)), "bias": jnp.ones((2, 4))}
    after = mutated(weights, jnp.array([0.0, 0.2]), jr.key(0))
    for name, array in after.items():
        np.testing.assert_array_equal(array[0], weights[name][0])
        assert 0.05 < np.std(array[1]) < 0.5
