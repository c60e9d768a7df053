import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.evaluation.limits import fewest_steps
from salpchain.evaluation.turning import (
    fewest_steps_straight,
    fewest_steps_turning,
    mean_turn,
)
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from salpchain.tasks.config import GOAL_LIMIT
from tests.physics.poses import LINK

PHYSICS = Physics()
MOST = 512


def straight(num):
    position = np.stack([LINK * np.arange(num), np.zeros(num)], -1)
    return at_rest(jnp.array(position, jnp.float32), jnp.zeros(num))


@eqx.filter_jit
def all_bounds(chain, away):
    given = PHYSICS, chain, chain.units.position + away, GOAL_LIMIT, MOST
    return [bound(*given) for bound in (fewest_steps, fewest_steps_turning, fewest_steps_straight)]


def bounds(num, away):
    return [int(steps) for steps in all_bounds(straight(num), jnp.array(away, jnp.float32))]


@jax.jit
def turns(chain, thrusts):
    """How far each unit has turned after each control step, (step, unit)."""

    def advance(chain, thrust):
        chain = step(chain, thrust, PHYSICS, contact=False)
        return chain, jnp.abs(chain.units.angle)

    return jax.lax.scan(advance, chain, thrusts)[1]


def patterns(num, steps):
    """Thrusts (N) that turn units fast: the whole chain round, zigzags, and by chance."""
    unit = np.arange(num)
    rows = [np.sign(unit - (num - 1) / 2 + 0.1), (-1.0) ** unit, (-1.0) ** (unit // 2)]
    for row in rows:
        yield np.tile(row, (steps, 1))
    for seed in range(20):
        yield np.sign(np.random.default_rng(seed).normal(size=(steps, num)))


@pytest.mark.parametrize("num", [2, 5])
def test_no_thrusts_turn_the_units_of_a_chain_farther_than_their_work_allows(num):
    limit = np.array([mean_turn(PHYSICS, k) for k in range(1, 5)])
    most = np.zeros(4)
    for thrusts in patterns(num, 4):
        seen = np.asarray(turns(straight(num), jnp.asarray(thrusts, jnp.float32)))
        most = np.maximum(most, seen.mean(axis=1))
    assert (most <= limit / 2).all()  # far from it: docs/bounds.md
    assert (most > 0.015).all()  # they do turn


def test_a_way_straight_ahead_takes_as_long_as_without_turning():
    assert bounds(6, (0.0, 0.5)) == [bounds(6, (0.0, 0.5))[0]] * 3


def test_a_way_along_the_chain_takes_longer_and_longest_where_it_stays_straight():
    plain, bending, stiff = bounds(6, (0.5, 0.0))
    assert plain + 1 <= bending <= plain + 3 and stiff >= bending + 4
    aslant = bounds(6, (0.35, 0.35))
    assert aslant[0] <= aslant[1] <= bending


def test_a_chain_already_there_needs_one_step():
    assert bounds(4, (0.0, 0.0)) == [1, 1, 1]
