"""Walls and posts: units stay out of them, far ones change nothing, and near ones are all found."""

import functools
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.physics import broadphase, chain
from salpchain.physics.chain import step
from salpchain.physics.state import at_rest
from salpchain.world.obstacles import make_obstacles, room
from tests.physics.poses import bent, largest_difference, lively, resting, thrusts

SIDE = 0.7  # m, of the free square in the room
ROOM = make_obstacles(room(SIDE, SIDE))


def cluttered(side):
    """A room with posts, none of which covers the start of a swim; with empty slots."""
    at = 0.42 * side
    return make_obstacles(room(side, side), [((at, at), 0.05), ((-at, at), 0.02)], (5, 3))


def corners(units):
    """Positions (m) of the four corners of each unit, (corner, ..., 2)."""
    axis = jnp.stack([jnp.cos(units.angle), jnp.sin(units.angle)], -1)
    across = jnp.stack([-axis[..., 1], axis[..., 0]], -1)
    sides = [(a, b) for a in (-0.02, 0.02) for b in (-0.025, 0.025)]
    return jnp.stack([units.position + a * axis + b * across for a, b in sides])


def starts(num, batch, seed):
    """Bent chains at rest around the origin."""
    position, angle = bent(np.random.default_rng(seed), batch, num, 0.5)
    return resting(position - position.mean(1, keepdims=True), angle)


def random_swim(num, batch, steps, around, seed=0, move=step):
    """Chains before and after every step, and thrusts (N), full or random, held 1 to 10 steps."""
    every = jnp.arange(batch)[:, None] % 10 + 1
    full = jnp.arange(batch)[:, None] % 2 == 0

    def one(carry, now):
        chains, thrust = carry
        fresh = jr.uniform(jr.fold_in(jr.key(seed), now), (batch, num), minval=-1.0)
        thrust = jnp.where(now % every == 0, jnp.where(full, jnp.sign(fresh), fresh), thrust)
        after = jax.vmap(functools.partial(move, obstacles=around))(chains, thrust)
        return (after, thrust), (chains, thrust, after)

    carry = starts(num, batch, seed), jnp.zeros((batch, num))
    return jax.jit(lambda carry: jax.lax.scan(one, carry, jnp.arange(steps))[1])(carry)


def test_chains_in_a_room_stay_in_it():
    """`STEPS=10000 pytest -k room` is the long run that docs/world.md tells of."""
    _, _, after = random_swim(8, 20, int(os.environ.get("STEPS", "600")), ROOM)
    depth = np.abs(corners(after.units)).max((0, -2, -1)) - SIDE / 2
    assert np.mean(depth > -4 / 600) > 0.02  # at a wall
    assert depth.max() <= 2e-3


@pytest.mark.parametrize("num", [8, 64])
def test_many_units_pushing_one_wall_do_not_get_in(num):
    """All push along the chain, which stands end on to a wall whose face is at y = 0.5 m."""
    wall = make_obstacles([((-5, 0.525), (5, 0.525), 0.05)])
    y = 0.46 - 0.07 * jnp.arange(num)[::-1]
    start = at_rest(jnp.stack([0 * y, y], -1), jnp.zeros(num))

    def one(chain, _):
        chain = step(chain, jnp.ones(num), obstacles=wall)
        return chain, corners(chain.units)[..., 1].max() - 0.5

    _, depth = jax.jit(lambda chain: jax.lax.scan(one, chain, None, 60))(start)
    assert depth.max() > -4 / 600
    assert depth.max() <= 2e-3


def test_a_unit_that_starts_inside_a_wall_is_pushed_out_the_shortest_way():
    wall = make_obstacles([((-1, 0), (1, 0), 0.1)])
    apart = jnp.array([[0.2, 0.06], [0.2, 0.5]])
    unit = at_rest(apart, jnp.array([0.3, 0.0]), linked=jnp.array([False]))
    move = jax.jit(functools.partial(step, obstacles=wall))
    for _ in range(10):
        unit = move(unit, jnp.zeros(2))
    assert unit.units.position[0, 1] > 0.05 + 0.02
    assert abs(unit.units.position[0, 0] - 0.2) < 0.01


def test_the_force_is_continuous_where_unit_and_wall_begin_to_overlap():
    def pushed(depth):
        height = 0.05 + 0.025 * np.cos(0.2) + 0.02 * np.sin(0.2) - depth
        position = jnp.array([[0.0, height], [0.0, 1.0]])
        unit = at_rest(position, jnp.array([0.2, 0.0]), linked=jnp.array([False]))
        wall = make_obstacles([((-1, 0), (1, 0), 0.1)])
        move = functools.partial(step, obstacles=wall)
        substep = eqx.tree_at(lambda p: p.control_step, chain.Physics(substeps=1), 1e-3)
        after = move(unit, jnp.zeros(2), substep).units
        return np.append(after.velocity[0], after.angular_velocity[0])

    before, after, deeper = (pushed(depth) for depth in (-1e-5, 1e-5, 1e-3))
    assert before[1] > 0.009
    np.testing.assert_allclose(before, after, rtol=0.03, atol=1e-5)
    assert deeper[1] > 1.5 * after[1]


def test_obstacles_that_are_far_or_not_there_change_nothing():
    rng = np.random.default_rng(0)
    chains, push = lively(rng, 8, batch=12), thrusts(rng, 12, 8)
    far = make_obstacles([((50, 0), (50, 1), 0.1)], [((0, 60), 1.0)], slots=(3, 2))
    nobody = jax.tree.map(lambda x: jnp.zeros_like(x) if x.dtype == bool else x, cluttered(SIDE))
    plain = jax.jit(jax.vmap(step))(chains, push)
    for around in (far, nobody, make_obstacles()):
        moved = jax.jit(jax.vmap(functools.partial(step, obstacles=around)))(chains, push)
        assert largest_difference(plain, moved) == 0


def test_without_obstacles_nothing_of_them_is_traced(monkeypatch):
    """That the program is that of before they existed was seen by comparing compiled programs."""

    def refuse(*_):
        raise AssertionError("traced")

    for module, name in [
        (chain, "solids"), (chain, "near_solids"), (chain, "obstruction"),
        (chain, "every_obstruction"),
    ]:  # fmt: skip
        monkeypatch.setattr(module, name, refuse)
    one = lively(np.random.default_rng(0), 5)
    step(one, jnp.ones(5))
    jax.grad(lambda push: step(one, push).units.position.sum())(jnp.ones(5))
    with pytest.raises(AssertionError, match="traced"):
        step(one, jnp.ones(5), obstacles=ROOM)


@pytest.mark.parametrize(
    ("num", "batch", "steps"), [(8, 100, 100), pytest.param(17, 30, 150, marks=pytest.mark.slow)]
)
def test_looking_at_what_is_near_only_gives_the_same_as_looking_at_all(
    recompiling, num, batch, steps
):
    farthest = np.abs(starts(num, batch, 3).units.position).max()
    around = cluttered(2 * float(farthest) + 0.075)
    before, push, after = random_swim(num, batch, steps, around, seed=3)
    passing = jax.lax.map(lambda some: jax.vmap(step)(*some), (before, push))
    recompiling(broadphase, "SLACK", 1e2)
    looking = jax.vmap(functools.partial(step, obstacles=around))
    every = jax.jit(lambda *all: jax.lax.map(lambda some: looking(*some), all))(before, push)
    effect = np.abs(passing.units.position - every.units.position).max((2, 3)) > 1e-4
    assert np.count_nonzero(effect) > 20
    assert largest_difference(after.units.position, every.units.position) <= 1e-5


def test_each_chain_of_a_batch_may_have_obstacles_of_its_own():
    rng = np.random.default_rng(1)
    chains, push = lively(rng, 4, batch=6), thrusts(rng, 6, 4)
    places = rng.uniform(-0.1, 0.3, (6, 2, 2))
    own = [
        make_obstacles([((*p[0],), (*(p[0] + 0.1),), 0.03)], [((*p[1],), 0.03)][: k % 2], (2, 1))
        for k, p in enumerate(places)
    ]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *own)
    together = jax.jit(jax.vmap(lambda c, t, o: step(c, t, obstacles=o)))(chains, push, stacked)
    moved = 0
    for k, obstacle in enumerate(own):
        one = jax.tree.map(lambda x, k=k: x[k], chains)
        alone = step(one, push[k], obstacles=obstacle)
        ours = jax.tree.map(lambda x, k=k: x[k], together)
        assert largest_difference(ours.units.position, alone.units.position) <= 1e-6
        free = step(one, push[k]).units.position
        moved += largest_difference(alone.units.position, free) > 1e-3
    assert moved > 1


def test_a_chain_that_records_it_knows_that_an_obstacle_pushed_it():
    start = at_rest(jnp.array([[0.0, 0.0], [0.07, 0.0]]), jnp.zeros(2))
    start = eqx.tree_at(lambda c: c.blocked, start, jnp.array(False), is_leaf=lambda x: x is None)
    near, far = (make_obstacles(posts=[((0.0, y), 0.05)]) for y in (0.078, 0.2))
    for around, blocked in ((near, True), (far, False), (None, False)):
        after = step(start, jnp.zeros(2), obstacles=around)
        assert bool(after.blocked) == blocked
        assert not after.touching


@pytest.mark.slow
@pytest.mark.parametrize("contact", [True, False])
def test_derivatives_at_a_wall_are_those_of_finite_differences_in_both_modes(contact):
    with jax.enable_x64(True):
        wall = jax.tree.map(
            lambda x: x if x.dtype == bool else x.astype(float),
            make_obstacles([((-1, 0.097), (1, 0.1), 0.08)], [((0.14, -0.03), 0.03)]),
        )
        start = at_rest(jnp.array([[0.0, 0.03], [0.07, 0.025], [0.14, 0.03]]), jnp.zeros(3))
        exact = chain.Physics(joint_derivative="exact")
        weights = jnp.arange(6.0).reshape(3, 2) + 1

        @jax.jit
        def out(push, around):
            moved = step(start, push, exact, None, contact, around)
            return (weights * moved.units.position).sum()

        push, change = jnp.array([0.3, -0.2, 0.5]), jnp.array([1.0, 0.5, -0.7])
        backward = float(jax.grad(out)(push, wall) @ change)
        forward = float(jax.jvp(lambda p: out(p, wall), (push,), (change,))[1])
        size = 1e-7
        ends = [float(out(push + s * size * change, wall)) for s in (1, -1)]
        assert abs(out(push, wall) - out(push, None)) > 1e-3
        assert forward == pytest.approx(backward, rel=1e-9)
        assert (ends[0] - ends[1]) / (2 * size) == pytest.approx(backward, rel=1e-4)
        assert abs(jax.grad(out, 1, allow_int=True)(push, wall).walls.width[0]) > 1e-3
