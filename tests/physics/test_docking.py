"""Links that are cut and closed: what acts, how gently, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.physics.chain import step
from salpchain.physics.docking import attach, detach, dockable, grip, openings, shut
from salpchain.physics.state import Chain, Latch, Physics, at_rest
from tests.physics.poses import (
    LINK,
    LINK_INERTIA,
    LINK_MASS,
    UNIT_INERTIA,
    UNIT_MASS,
    in_double_precision,
    largest_difference,
    lively,
    thrusts,
)

NUM, CUT = 6, 2
LATCH, PHYSICS = Latch(), Physics()
MOST_GAIN = 0.01  # J, that closing may add to the kinetic energy (stated in docs/tasks.md)
still = jax.jit(lambda chain: step(chain, jnp.zeros(len(chain.present)), Physics(drag=0.0)))
step_one = jax.jit(step)


@pytest.fixture
def rng():
    return np.random.default_rng(28)


@jax.jit
def held_step(chain: Chain, hold, thrust):
    return step(grip(chain, hold, PHYSICS), thrust)


def kinetic(chain: Chain) -> float:
    """J, of all units and links."""
    total = 0.0
    for bodies, mass, inertia in (
        (chain.units, UNIT_MASS, UNIT_INERTIA),
        (chain.links, LINK_MASS, LINK_INERTIA),
    ):
        total += mass / 2 * jnp.square(bodies.velocity).sum()
        total += inertia / 2 * jnp.square(bodies.angular_velocity).sum()
    return float(total)


def row(num=NUM) -> Chain:
    """A straight chain at rest that can dock."""
    place = jnp.stack([LINK * jnp.arange(num), jnp.zeros(num)], axis=1)
    return dockable(at_rest(place, jnp.zeros(num)), record=True)


def apart(gap=(0.0, 0.0), turn=0.0, speed=0.0, num=NUM) -> Chain:
    """The row cut after unit CUT, its second part moved by `gap` (m), turned about its first unit
    by `turn` (rad), and coming back at `speed` (m/s)."""
    chain = detach(row(num), CUT)
    pivot = chain.units.position[CUT + 1]
    cos, sin = np.cos(turn), np.sin(turn)
    spin = jnp.array([[cos, sin], [-sin, cos]])
    towards = -np.asarray(gap) / max(np.hypot(*gap), 1e-9) * speed

    def moved(bodies, first):
        rows = jnp.arange(len(bodies.angle)) >= first
        place = (bodies.position - pivot) @ spin + pivot + jnp.asarray(gap)
        return eqx.tree_at(
            lambda b: (b.position, b.angle, b.velocity),
            bodies,
            (
                jnp.where(rows[:, None], place, bodies.position),
                jnp.where(rows, bodies.angle + turn, bodies.angle),
                jnp.where(rows[:, None], jnp.asarray(towards), bodies.velocity),
            ),
        )

    parts = moved(chain.units, CUT + 1), moved(chain.links, CUT + 1)
    return eqx.tree_at(lambda c: (c.units, c.links), chain, parts)


def test_a_chain_that_could_be_cut_but_is_not_moves_as_a_fixed_one(rng):
    chain, pushes = lively(rng, NUM), thrusts(rng, 20, NUM)
    fixed, free = chain, dockable(chain)
    for push in pushes:
        fixed = step_one(fixed, push)
        free = held_step(free, jnp.ones(NUM - 1, bool), push)
    assert largest_difference((fixed.units, fixed.links), (free.units, free.links)) < 2e-3


def test_a_cut_link_stays_with_its_first_unit_and_pulls_no_other(rng):
    chain, hold = row(), jnp.arange(NUM - 1) != CUT
    push = jnp.where(jnp.arange(NUM) <= CUT, 1.0, 0.0)
    for _ in range(30):
        chain = held_step(chain, hold, push)
    assert float(chain.units.position[: CUT + 1, 1].min()) > 0.1
    np.testing.assert_array_equal(chain.units.velocity[CUT + 1 :], 0.0)
    half = LINK / 2 * jnp.stack([jnp.cos(chain.links.angle), jnp.sin(chain.links.angle)], -1)
    hangs = chain.links.position[CUT] - half[CUT] - chain.units.position[CUT]
    assert float(jnp.linalg.norm(hangs)) < 5e-3


@in_double_precision
def test_closing_keeps_momentum_and_angular_momentum():
    chain = grip(apart((0.02, 0.015), 0.3, 0.05), jnp.ones(NUM - 1, bool), PHYSICS)
    assert bool(chain.linked[CUT])

    def momenta(c):
        parts = ((c.units, UNIT_MASS, UNIT_INERTIA), (c.links, LINK_MASS, LINK_INERTIA))
        linear = sum(m * b.velocity.sum(0) for b, m, _ in parts)
        x, v = (lambda b: b.position.T), (lambda b: b.velocity.T)
        angular = sum(
            (m * (x(b)[0] * v(b)[1] - x(b)[1] * v(b)[0]) + i * b.angular_velocity).sum()
            for b, m, i in parts
        )
        return jnp.append(linear, angular)

    before = momenta(chain)
    for _ in range(15):
        chain = still(chain)
    assert bool(shut(chain).all())
    np.testing.assert_allclose(momenta(chain), before, atol=2e-3)


@pytest.mark.parametrize("gap", [(0.039, 0.0), (0.0, 0.039), (0.02, -0.03), (0.001, 0.0)])
@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("speed", [0.0, 0.09])
def test_closing_is_gentle_and_comes_to_an_end(gap, turn, speed):
    chain = apart(gap, turn, speed)
    start, fastest = kinetic(chain), 0.0
    chain = grip(chain, jnp.ones(NUM - 1, bool), PHYSICS)
    assert bool(chain.linked[CUT]) and int(chain.docking.catches[CUT]) == 1
    most = start
    for _ in range(20):
        chain = still(chain)
        most = max(most, kinetic(chain))
        fastest = max(fastest, float(jnp.abs(chain.units.velocity).max()))
    assert most - start < MOST_GAIN
    assert fastest < 0.2
    assert bool(shut(chain).all())
    assert float(openings(chain, PHYSICS)[CUT, 0]) < 0.01


@pytest.mark.parametrize(
    ("gap", "turn", "speed"), [((0.041, 0.0), 0.0, 0.0), ((0.01, 0.0), 0.6, 0.0),
                               ((0.02, 0.0), 0.0, 0.15)],
)  # fmt: skip
def test_nothing_closes_that_is_too_far_too_askew_or_too_fast(gap, turn, speed):
    chain = grip(apart(gap, turn, speed), jnp.ones(NUM - 1, bool), PHYSICS)
    assert not bool(chain.linked[CUT])
    with pytest.raises(InputError, match=r"at most 0\.04 m"):
        attach(apart(gap, turn, speed), CUT, CUT + 1)


def test_a_piece_that_has_turned_round_closes_as_if_it_had_not():
    chain = apart((0.01, 0.0))
    turned = chain.units.angle + 2 * jnp.pi * (jnp.arange(NUM) > CUT)
    links = chain.links.angle + 2 * jnp.pi * (jnp.arange(NUM - 1) > CUT)
    other = eqx.tree_at(lambda c: (c.units.angle, c.links.angle), chain, (turned, links))
    one, two = (grip(c, jnp.ones(NUM - 1, bool), PHYSICS) for c in (chain, other))
    for _ in range(10):
        one, two = still(one), still(two)
    np.testing.assert_allclose(one.units.position, two.units.position, atol=5e-3)
    assert abs(float(two.docking.twist[CUT])) < 1e-3


def test_what_is_not_there_is_not_cut_and_no_ring_is_closed():
    chain = row()
    with pytest.raises(InputError, match=r"link 2 cannot be cut: units 2 and 3 are not joined"):
        detach(detach(chain, 2), 2)
    with pytest.raises(InputError, match="link must be a whole number, 0 to 4, got 9"):
        detach(chain, 9)
    with pytest.raises(InputError, match="would close a ring"):
        attach(chain, 0, NUM - 1)
    with pytest.raises(InputError, match="joined already"):
        attach(chain, 1, 2)
    with pytest.raises(InputError, match="link i joins units i and i"):
        attach(detach(chain, 2), 0, 4)
    assert bool(attach(detach(chain, 2), 3, 2).linked.all())


@pytest.mark.parametrize("bad", [{"distance": 0.0}, {"angle": 4.0}, {"closing": -1.0}])
def test_a_latch_that_cannot_be_is_refused(bad):
    with pytest.raises(InputError, match=f"Latch.{next(iter(bad))}"):
        Latch(**bad)


def test_each_chain_of_a_batch_closes_for_itself():
    chains = [apart((0.01, 0.0)), apart((0.08, 0.0)), row()]
    many = jax.tree.map(lambda *x: jnp.stack(x), *chains)
    hold = jnp.ones((3, NUM - 1), bool)
    after = jax.jit(jax.vmap(lambda c, h: step(grip(c, h, PHYSICS), jnp.zeros(NUM))))(many, hold)
    assert after.linked[:, CUT].tolist() == [True, False, True]
    for index, chain in enumerate(chains):
        alone = held_step(chain, hold[0], jnp.zeros(NUM))
        mine = jax.tree.map(lambda x, index=index: x[index], after)
        assert largest_difference(alone.units, mine.units) < 1e-5
