"""Contact of units: the law of two boxes, and which pairs are looked at when."""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.physics import broadphase, candidates, contact
from salpchain.physics.boxes import turned
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from tests.physics.poses import along, bent, largest_difference, resting, thrusts

GAP = 4 / 600  # m, VMAS's LINE_MIN_DIST: boxes closer than this repel


step_one = jax.jit(step)


def random_pairs(rng, count):
    """Offsets (m) and angles (rad) of two boxes: far apart, near, pressing and crossing."""
    distance, bearing = rng.uniform(0.03, 0.075, count), rng.uniform(0, 2 * np.pi, count)
    offset = distance * np.array([np.cos(bearing), np.sin(bearing)])
    return offset.astype(np.float32), rng.uniform(-7, 7, (2, count)).astype(np.float32)


def vmas_boxes(offset, angle):
    """VMAS's force (2, pair) N on the first box of each pair, and torques (pair,) N m on both."""
    vmas_chain = pytest.importorskip("tests.physics.vmas_chain")
    chains = vmas_chain.VmasChains(np.stack([0 * offset, offset], 0).transpose(2, 0, 1), angle.T)
    return chains.box_on_box()


def our_boxes(offset, angle):
    """Ours."""
    first, second = (turned(jnp.asarray(a)) for a in angle)
    force, *torques = contact.box_against_box(Physics(), tuple(offset), first, second)
    return np.stack(force), *torques


def test_two_boxes_press_on_each_other_as_in_vmas():
    offset, angle = random_pairs(np.random.default_rng(0), 20_000)
    # VMAS leaves out pairs whose bounding circles are apart only if that holds for all its pairs
    theirs, ours = vmas_boxes(offset, angle), our_boxes(offset, angle)
    pressing = np.abs(theirs[0]).max(0) > 0
    assert 0.1 < pressing.mean() < 0.9
    for their, our, bar in zip(theirs, ours, (5e-3, 1e-4, 1e-4), strict=True):  # N, N m
        error = np.abs(their - np.asarray(our))
        error = error.max(0) if error.ndim == 2 else error
        # a pair at the very threshold is pressed in one and free in the other: about 1 in 10,000
        assert np.mean(error > bar) <= 1e-3
        assert np.median(error[pressing]) <= bar / 10


def pair(distance, angles=(0.0, 0.0)):
    """Two free units, the second `distance` (m) ahead of the first one's heading."""
    position = jnp.array([[0.0, 0.0], [0.0, distance]])
    return at_rest(position, jnp.array(angles), linked=jnp.array([False]))


def test_two_free_units_driven_at_each_other_stop_with_a_gap_between_them():
    """1 N presses the boxes (0.05 m across) to just where VMAS's contact sets in, with 1.04 N."""
    chain = pair(0.065)
    for _ in range(40):
        chain = step_one(chain, jnp.array([1.0, -1.0]))
    gap = chain.units.position[1, 1] - chain.units.position[0, 1] - 0.05
    assert 0.5 * GAP < gap < 1.5 * GAP


def test_units_that_cross_exert_nothing_on_each_other():
    after = step_one(pair(0.03), jnp.zeros(2))
    assert largest_difference(after.units, pair(0.03).units) == 0


def test_units_touch_where_their_boxes_are_closer_than_the_gap_and_do_not_cross():
    rng = np.random.default_rng(0)
    position = rng.uniform(-0.045, 0.045, (400, 2, 2)).astype(np.float32)
    angle = rng.uniform(0, 2 * np.pi, (400, 2)).astype(np.float32)

    def touching(position, angle):
        chain = at_rest(position, angle, linked=jnp.zeros(1, bool))
        return step(chain, jnp.zeros(2)).touching

    found = jax.jit(jax.vmap(touching))(position, angle)
    gaps = np.array([gap_of_boxes(p, a) for p, a in zip(position, angle, strict=True)])
    apart = np.linalg.norm(position[:, 0] - position[:, 1], axis=-1)
    clear = np.abs(gaps - GAP) > 1e-6
    expected = (gaps > 0) & (gaps <= GAP) & (apart <= np.hypot(0.04, 0.05))
    np.testing.assert_array_equal(np.asarray(found)[clear], expected[clear])
    assert 0.05 < expected.mean() < 0.8


def gap_of_boxes(position, angle):
    """Gap of two boxes, 0 where they overlap, from all pairs of their sides."""
    corners = [place(p, a) for p, a in zip(position.astype(float), angle, strict=True)]
    sides = [list(zip(c, np.roll(c, -1, 0), strict=True)) for c in corners]
    pairs = list(itertools.product(*sides))
    if any(cross(*one, *other) for one, other in pairs):
        return 0.0
    return min(
        min(point_to_side(p, *t) for p in s)
        for one, other in pairs
        for s, t in ((one, other), (other, one))
    )


def place(centre, angle):
    corners = np.array([[0.02, 0.025], [-0.02, 0.025], [-0.02, -0.025], [0.02, -0.025]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return centre + corners @ turn.T


def cross(a, b, c, d):
    def turn(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


def point_to_side(point, begin, end):
    share = np.clip((point - begin) @ (end - begin) / ((end - begin) @ (end - begin)), 0, 1)
    return np.linalg.norm(begin + share * (end - begin) - point)


def test_without_contact_units_pass_through_each_other():
    step_through = jax.jit(functools.partial(step, contact=False))
    chain = pair(0.1)
    for _ in range(10):
        chain = step_through(chain, jnp.array([1.0, -1.0]))
    assert chain.units.position[0, 1] > chain.units.position[1, 1]


def violent_run(num, batch, steps):
    """A function of a seed: chains before every step, thrusts (N), and chains after it.

    Full thrust, to either side at random, held for 1, 2, ..., 10 steps, folds the chains.
    """
    every = jnp.arange(batch)[:, None] % 10 + 1

    def one(key, carry, now):
        chains, thrust = carry
        side = jr.rademacher(jr.fold_in(key, now), (batch, num), float)
        thrust = jnp.where(now % every == 0, side, thrust)
        after = jax.vmap(step)(chains, thrust)
        return (after, thrust), (chains, thrust, after)

    @jax.jit
    def run(key, start):
        carry = (start, jnp.zeros((batch, num)))
        return jax.lax.scan(functools.partial(one, key), carry, jnp.arange(steps))[1]

    def from_seed(seed):
        return run(jr.key(seed), resting(*bent(np.random.default_rng(seed), batch, num, 0.5)))

    return from_seed


def step_each(contact=True):
    """A function that steps every chain of (steps, batch)."""
    many = jax.vmap(functools.partial(step, contact=contact))
    return jax.jit(lambda *all: jax.lax.map(lambda some: many(*some), all))


# With these seeds chains bend and joints give more than in most others.
@pytest.mark.parametrize(
    ("num", "batch", "steps", "seeds"),
    [
        (8, 200, 80, (3, 6, 7)),
        pytest.param(17, 40, 60, (0,), marks=pytest.mark.slow),
        (33, 20, 60, (33,)),
    ],
)
def test_looking_at_near_pairs_only_gives_the_same_as_looking_at_all(
    recompiling, num, batch, steps, seeds
):
    runs = [*map(violent_run(num, batch, steps), seeds)]
    recompiling(broadphase, "SLACK", 1e3)
    looking, passing = step_each(), step_each(contact=False)
    touched = 0
    for before, pushes, after in runs:
        expected = looking(before, pushes).units.position
        effect = np.abs(expected - passing(before, pushes).units.position)
        touched += np.count_nonzero(effect.max((2, 3)) > 1e-4)
        assert largest_difference(after.units.position, expected) <= 1e-5
    assert touched >= 10


def crowd(num, batch):
    """Chains rolled up: each unit near many others."""
    turns = np.linspace(0.9, 0.5, num - 1)[None].repeat(batch, 0)
    turns[:, 0] += np.linspace(0, 3, batch)
    return resting(*along(np.cumsum(turns, 1)))


@pytest.mark.parametrize(
    ("module", "name", "value"),
    [
        (candidates, "MOST", 1),  # for each unit: too little room in the list
        (candidates, "on_cpu", lambda: False),  # as on an accelerator
    ],
)
def test_other_ways_to_the_same_forces(recompiling, module, name, value):
    chains, push = crowd(20, 12), thrusts(np.random.default_rng(0), 12, 20)
    expected = jax.jit(jax.vmap(step))(chains, push)
    passing = jax.jit(jax.vmap(functools.partial(step, contact=False)))(chains, push)
    assert largest_difference(expected.units.position, passing.units.position) > 1e-3
    recompiling(module, name, value)
    other = jax.jit(jax.vmap(step))(chains, push)
    assert largest_difference(other, expected) <= 1e-5
    assert bool((other.touching == expected.touching).all())


def test_units_far_apart_in_the_chain_are_found_when_they_meet():
    """A cut chain: the second half stands upright on unit 5, 15 slots from its own first unit."""
    ahead = 0.07 * np.arange(20)
    lying = np.stack([ahead, 0 * ahead], -1)
    upright = np.stack([0 * ahead + 0.35, 0.05 + ahead], -1)
    angle = np.repeat([0.0, np.pi / 2], 20)
    linked = jnp.arange(39) != 19
    for shift, meets in ((0.0, True), (0.05, False)):
        place = jnp.asarray(np.concatenate([lying, upright + np.array([0.0, shift])]), float)
        after = step_one(at_rest(place, jnp.asarray(angle, float), linked=linked), jnp.zeros(40))
        assert bool(after.touching) == meets


def test_shapes_are_looked_at_only_when_some_units_are_near(recompiling):
    looks = []
    narrow = contact.box_against_box

    def counted(*args):
        jax.debug.callback(lambda: looks.append(1))
        return narrow(*args)

    recompiling(contact, "box_against_box", counted)
    step_all = jax.jit(jax.vmap(step))
    straight = resting(*bent(np.random.default_rng(0), 20, 8, 0.1))
    jax.block_until_ready(step_all(straight, jnp.ones((20, 8))))
    jax.effects_barrier()
    assert not looks
    near = straight.units.position.at[3, 7].set(straight.units.position[3, 0] + 0.045)
    folded = eqx.tree_at(lambda c: c.units.position, straight, near)
    jax.block_until_ready(step_all(folded, jnp.ones((20, 8))))
    jax.effects_barrier()
    assert looks
