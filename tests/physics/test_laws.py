"""Laws that the dynamics keep: conservation, symmetry, closed forms, and no explosion.

Symmetries are tested in double precision: VMAS's joints jump from nothing to 0.6 N as they open by
a micrometre, which makes a millimetre of single precision's last digit within a second.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from salpchain.physics.chain import step
from salpchain.physics.state import Bodies, Chain, Physics, at_rest, heading, wrap
from tests.physics import poses
from tests.physics.poses import (
    bent,
    in_double_precision,
    largest_difference,
    lively,
    opening,
    resting,
    thrusts,
)

NUM = 8
few = settings(max_examples=15, deadline=None, derandomize=True)
seeds = st.integers(0, 2**31 - 1)
metres = st.floats(-10, 10)
radians = st.floats(-7, 7)
step_freely = jax.jit(functools.partial(step, physics=Physics(drag=0.0)))
step_one = jax.jit(step)
step_apart = jax.jit(functools.partial(step, contact=False))
step_far = jax.jit(lambda chain, thrust: step(step(chain, thrust), thrust))


def crowd(rng) -> Chain:
    """A moving chain, bent so much that some of its units press on each other."""
    return lively(rng, NUM, bend=2.6)


def bodies(chain):
    """Units and links with their masses (kg) and moments of inertia (kg m2)."""
    return (
        (chain.units, poses.UNIT_MASS, poses.UNIT_INERTIA),
        (chain.links, poses.LINK_MASS, poses.LINK_INERTIA),
    )


def momentum(chain):
    """Total momentum, kg m/s."""
    return sum(mass * np.asarray(x.velocity, float).sum(0) for x, mass, _ in bodies(chain))


def angular_momentum(chain):
    """Total angular momentum about the origin, kg m2/s."""
    total = 0.0
    for body, mass, inertia in bodies(chain):
        (x, y), (vx, vy) = np.asarray(body.position, float).T, np.asarray(body.velocity, float).T
        spin = np.asarray(body.angular_velocity, float)
        total += (mass * (x * vy - y * vx) + inertia * spin).sum()
    return total


def transformed(chain, point, angle, sign=1.0) -> Chain:
    """The chain with `point` applied to positions, `angle` to angles, `sign` to what turns.

    `point` is linear in velocities: a shift cancels out.
    """

    def one(x: Bodies) -> Bodies:
        velocity = point(x.velocity) - point(jnp.zeros(2))
        return Bodies(point(x.position), angle(x.angle), velocity, sign * x.angular_velocity)

    rest = sign * chain.rest_angle
    parts = (one(chain.units), one(chain.links), rest)
    return eqx.tree_at(lambda c: (c.units, c.links, c.rest_angle), chain, parts)


def turned(chain, by) -> Chain:
    matrix = jnp.array([[jnp.cos(by), jnp.sin(by)], [-jnp.sin(by), jnp.cos(by)]])
    return transformed(chain, lambda p: p @ matrix, lambda a: a + by)


def shifted(chain, by) -> Chain:
    return transformed(chain, lambda p: p + jnp.array(by), lambda a: a)


def mirrored(chain) -> Chain:
    return transformed(chain, lambda p: p * jnp.array([1.0, -1.0]), lambda a: -a, sign=-1.0)


def reversed_order(chain) -> Chain:
    """The same bodies counted from the other end: a link then points the other way."""
    chain = jax.tree.map(lambda x: x[::-1] if x.ndim else x, chain)
    half_turn = chain.links.angle + jnp.pi, chain.rest_angle[:, ::-1] + jnp.pi
    return eqx.tree_at(lambda c: (c.links.angle, c.rest_angle), chain, half_turn)


def units_turned_round(chain) -> Chain:
    half_turn = chain.units.angle + jnp.pi, chain.rest_angle - jnp.pi
    return eqx.tree_at(lambda c: (c.units.angle, c.rest_angle), chain, half_turn)


def assert_same(one, other):
    assert largest_difference(one, other) <= 1e-8


def test_contact_acts_in_these_crowds():
    crowds = [crowd(np.random.default_rng(seed)) for seed in range(20)]
    still = jnp.zeros(NUM)
    moved = [largest_difference(step_one(c, still), step_apart(c, still)) > 1e-3 for c in crowds]
    assert sum(moved) >= 10


@few
@given(seeds)
def test_momentum_is_conserved_without_drag_and_thrust(seed):
    chain = crowd(np.random.default_rng(seed))
    scale = 0.1 * np.sqrt(15)  # kg m/s: 15 bodies of 1 kg at about 0.1 m/s
    after = chain
    for _ in range(5):
        after = step_freely(after, jnp.zeros(NUM))
    assert np.abs(after.units.velocity - chain.units.velocity).max() > 0.01
    assert np.abs(momentum(after) - momentum(chain)).max() <= 1e-4 * scale


@few
@given(seeds)
def test_angular_momentum_is_conserved_without_drag_and_thrust(seed):
    chain = crowd(np.random.default_rng(seed))
    scale = 0.1 * np.sqrt(15) * 0.2  # kg m2/s: the same momentum, 0.2 m from the origin
    after = chain
    for _ in range(5):
        after = step_freely(after, jnp.zeros(NUM))
    assert abs(angular_momentum(after) - angular_momentum(chain)) <= 1e-4 * scale


def assert_symmetric(seed, change, change_thrust=lambda thrust: thrust):
    """A changed chain, under the changed thrusts, ends as the chain does, changed."""
    rng = np.random.default_rng(seed)
    chain, thrust = crowd(rng), thrusts(rng, NUM)
    assert_same(step_far(change(chain), change_thrust(thrust)), change(step_far(chain, thrust)))


@few
@given(seeds, radians)
@in_double_precision
def test_turning_the_world_turns_the_result(seed, by):
    assert_symmetric(seed, lambda chain: turned(chain, by))


@few
@given(seeds, metres, metres)
@in_double_precision
def test_shifting_the_world_shifts_the_result(seed, x, y):
    assert_symmetric(seed, lambda chain: shifted(chain, (x, y)))


@few
@given(seeds)
@in_double_precision
def test_a_mirrored_chain_with_opposite_thrusts_moves_mirrored(seed):
    """A heading is a quarter turn ahead of its unit, and mirrored a quarter turn behind."""
    assert_symmetric(seed, mirrored, np.negative)


@few
@given(seeds)
@in_double_precision
def test_counting_units_from_the_other_end_changes_nothing(seed):
    assert_symmetric(seed, reversed_order, np.flip)


@few
@given(seeds)
@in_double_precision
def test_units_turned_round_with_opposite_thrusts_move_alike(seed):
    assert_symmetric(seed, units_turned_round, np.negative)


@few
@given(radians)
def test_wrapping_keeps_the_direction(angle):
    wrapped = float(wrap(jnp.float32(angle)))
    assert -np.pi - 1e-6 <= wrapped < np.pi + 1e-6
    assert np.allclose(np.exp(1j * wrapped), np.exp(1j * np.float32(angle)), atol=2e-6)


def test_a_heading_is_a_quarter_turn_ahead_of_the_unit():
    ours = heading(jnp.array([0.0, np.pi / 2, np.pi]))
    assert np.allclose(ours, [[0, 1], [-1, 0], [0, -1]], atol=1e-6)


def test_a_chain_at_rest_stays_at_rest():
    starts = resting(*bent(np.random.default_rng(0), 20, NUM, 0.5))
    for index in range(20):
        start = jax.tree.map(lambda x, i=index: x[i], starts)
        after = step_freely(start, jnp.zeros(NUM))
        assert largest_difference(start.units.position, after.units.position) <= 1e-6


def test_drag_takes_a_quarter_of_every_velocity_at_each_control_step():
    free = at_rest(jnp.array([[0.0, 0.0], [1.0, 0.0]]), jnp.zeros(2), linked=jnp.array([False]))
    moving = eqx.tree_at(lambda c: c.units.velocity, free, jnp.ones((2, 2)))
    moving = eqx.tree_at(lambda c: c.units.angular_velocity, moving, jnp.ones(2))
    after = step_apart(step_apart(moving, jnp.zeros(2)), jnp.zeros(2))
    assert np.allclose(after.units.velocity, 0.75**2)
    assert np.allclose(after.units.angular_velocity, 0.75**2)


@pytest.mark.parametrize(("linked", "speed"), [(False, 0.4), (True, 0.8 / 3)])
def test_a_pair_reaches_the_speed_at_which_drag_takes_what_thrust_gives(linked, speed):
    """v = 0.75 v + 0.1 s F / m: 0.4 m/s for 1 N on 1 kg, a third less with 1 kg of link for two."""
    start = at_rest(jnp.array([[0.0, 0.0], [0.07, 0.0]]), jnp.zeros(2), linked=jnp.array([linked]))
    end = start
    for _ in range(100):
        end = step_apart(end, jnp.ones(2))
    moving = [end.units.velocity] + ([end.links.velocity] if linked else [])
    assert np.allclose(np.concatenate(moving).mean(0), [0.0, speed], atol=1e-4)


def swing(substeps, angle=0.01):
    """A unit's angle (rad) after one period, let go `angle` away from its place on a heavy link."""
    # small swings on a torque of 0.1 N m/rad; the link is too heavy to turn
    period = 2 * np.pi * np.sqrt(poses.UNIT_INERTIA / 0.1)
    constants = Physics(drag=0.0, link_mass=1e9, control_step=period, substeps=substeps)
    chain = at_rest(jnp.array([[0.0, 0.0], [0.07, 0.0]]), jnp.zeros(2))
    chain = eqx.tree_at(lambda c: c.units.angle, chain, jnp.array([angle, 0.0]))
    return float(step(chain, jnp.zeros(2), constants, contact=False).units.angle[0])


@in_double_precision
def test_a_unit_swings_about_its_link_with_the_period_of_its_inertia():
    # a hundredth of a radian makes the torque 0.5 % stiffer, and the phase 0.01 rad too early
    assert abs(swing(2000) / 0.01 - 1) <= 1e-3


@in_double_precision
def test_halving_the_substep_halves_the_error():
    exact = swing(16000)
    coarse, fine = (swing(substeps) - exact for substeps in (250, 500))
    assert 1.8 <= coarse / fine <= 2.3


def test_the_fence_clamps_every_body():
    start = resting(*bent(np.random.default_rng(0), 20, 4, 0.3))
    fences = jnp.linspace(0.05, 0.3, 20)
    fenced = jax.jit(jax.vmap(functools.partial(step, physics=None, contact=False)))
    chains = start
    for _ in range(30):
        chains = fenced(chains, jnp.ones((20, 4)), fence=fences)
        for x in (chains.units, chains.links):
            assert (np.abs(x.position).max((1, 2)) <= fences).all()
    assert (np.abs(chains.units.position).max((1, 2)) == fences).sum() >= 15


LENGTHS = ["unit_length", "unit_width", "link_length", "softness"]
MASSES = ["unit_mass", "link_mass"]
STIFFNESSES = ["joint_stiffness", "contact_stiffness"]


@pytest.mark.parametrize("constant", [*LENGTHS, *MASSES, *STIFFNESSES, "control_step"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_a_constant_that_must_be_positive_is_refused_by_name(constant, value):
    with pytest.raises(ValueError, match=rf"Physics\.{constant} must be positive .*{value}"):
        Physics(**{constant: value})


@pytest.mark.parametrize("substeps", [0, -15])
def test_a_count_of_substeps_that_cannot_be_is_refused(substeps):
    with pytest.raises(ValueError, match=rf"Physics\.substeps must be positive .*{substeps}"):
        Physics(substeps=substeps)


@pytest.mark.parametrize("drag", [-0.1, 1.0, 2.0, float("nan")])
def test_a_drag_that_cannot_be_is_refused(drag):
    with pytest.raises(ValueError, match=r"Physics\.drag must lie in \[0, 1\)"):
        Physics(drag=drag)


@functools.partial(jax.jit, static_argnums=(1, 2, 3))
def long_run(key, num, batch, steps):
    """Full thrust, to either side at random, held for a while: the widest joint (m), the end."""

    def one(carry, key):
        chains, thrust, widest = carry
        side_key, change_key = jr.split(key)
        side = jr.rademacher(side_key, (batch, num), float)
        thrust = jnp.where(jr.uniform(change_key, (batch, 1)) < 0.2, side, thrust)
        chains = jax.vmap(step)(chains, thrust)
        return (chains, thrust, jnp.maximum(widest, opening(chains).max())), None

    straight = jnp.stack([poses.LINK * jnp.arange(num), jnp.zeros(num)], -1)
    start = jax.vmap(lambda _: at_rest(straight, jnp.zeros(num)))(jnp.arange(batch))
    carry = (start, jnp.zeros((batch, num)), 0.0)
    (chains, _, widest), _ = jax.lax.scan(one, carry, jr.split(key, steps))
    return widest, chains


# Chains, steps: 100,000 in all; in a row for short chains, side by side for long ones, which fold
# within a hundred steps and then cost 20 to 200 times as much.
RUNS = {2: (1, 100_000), 8: (1, 100_000), 64: (100, 1_000), 256: (400, 250)}


@pytest.mark.parametrize("num", [*list(RUNS)[:3], pytest.param(256, marks=pytest.mark.slow)])
def test_full_random_thrust_never_tears_a_chain(num):
    widest, chains = long_run(jr.key(0), num, *RUNS[num])
    assert widest <= 0.015
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(chains))
