"""The drag-dominated chain, held against its equations written out, and the laws it keeps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.dynamics.landsalp import JETS, JOINTS, MEASURED, LandSalp, chain_parts
from salpchain.dynamics.robot import Part
from salpchain.errors import InputError
from salpchain.world.current import Uniform
from studies.landsalp.gaits import PERIOD, PUBLISHED
from tests.dynamics.dense import Dense


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def dense_robot():
    kinds = zip((JETS[0], JETS[1], JETS[0]), MEASURED, strict=True)
    return Dense([(jet, at, d, True) for (jet, at), d in kinds], JOINTS, sets_speed=True)


def dense_chain(length, robot):
    parts = [robot.parts[i % 2] for i in range(length)]
    links = [(p.jet, p.at, p.drag, p.on_wheel) for p in parts]
    drags, spring = [robot.joint_drag[0]] * (length - 1), robot.angle_stiffness
    return Dense(links, drags, sets_speed=robot.sets_speed, stiffness=spring)


def rates(robot, length, bends, thrust):
    """q' of the first link's middle, its direction and the joints, told by one tiny step."""
    tiny = eqx.tree_at(lambda r: r.control_step, robot, 1e-12)
    units = jax.jit(lambda c, u: tiny.advance(c, u).units)(robot.straight(length, bends), thrust)
    turning = np.asarray(units.angular_velocity)
    return np.concatenate([units.velocity[0], turning[:1], np.diff(turning)])


def test_the_published_gait_goes_30_mm_in_a_cycle():
    """From the equations alone; the numbers that were published are rounded, see the study."""

    def speeds(t):
        phase = 2 * np.pi * t / PERIOD
        return PUBLISHED[0] + PUBLISHED[1] * np.sin(phase) + PUBLISHED[2] * np.cos(phase)

    chain = dense_robot()
    path = chain.swim(np.zeros(5), speeds, PERIOD, 60)
    way = np.linalg.norm(chain.middles(path[-1]).mean(0) - chain.middles(path[0]).mean(0))
    assert way == pytest.approx(0.03, abs=1e-4)
    turn = (chain.directions(path[-1]) - chain.directions(path[0])).mean()
    assert abs(np.degrees(turn)) / PERIOD < 1e-3
    assert np.degrees(np.abs(path[:, 3:]).max()) == pytest.approx(10.4, abs=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_three_links_move_as_their_equations_say(seed):
    dice = np.random.default_rng(seed)
    bends, u = dice.uniform(-1.5, 1.5, 2), dice.uniform(-1, 1, 3)
    expected = dense_robot().rate(np.array([0.0, 0.0, 0.0, *bends]), u)
    assert rates(LandSalp.robot(jet=1.0), 3, bends, u) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("length", [1, 2, 7, 24])
@pytest.mark.parametrize("across, spring, wheels", [(3.0, 0.0, False), (10.0, 0.15, True)])
def test_chains_of_any_length_move_as_their_equations_say(length, across, spring, wheels):
    given = {"parts": chain_parts(across), "angle_stiffness": spring, "sets_speed": wheels}
    robot, dice = LandSalp(**given), np.random.default_rng(length)
    bends, u = dice.uniform(-1, 1, length - 1), dice.uniform(-1, 1, length)
    q = np.concatenate([np.zeros(3), bends])
    expected = dense_chain(length, robot).rate(q, u * robot.jet)
    assert rates(robot, length, bends, u) == pytest.approx(expected, rel=1e-7, abs=1e-9)


def swim(robot, chain, thrusts):
    def step(chain, thrust):
        chain = robot.advance(chain, thrust)
        return chain, chain.units.position

    return jax.jit(lambda c, u: jax.lax.scan(step, c, u))(chain, thrusts)


def test_halving_the_step_quarters_the_error():
    thrusts, bends = jnp.array([[0.3, -0.2, 0.5, 0.1]]), jnp.array([0.4, -0.3, 0.2])
    ends = [
        swim(LandSalp(substeps=n), LandSalp().straight(4, bends), thrusts)[1] for n in (2, 4, 32)
    ]
    coarse, fine = (float(jnp.abs(end - ends[-1]).max()) for end in ends[:2])
    assert fine < 0.35 * coarse and fine < 1e-3


def with_dead_slots(chain, slots):
    """The same chain with empty slots after it."""
    length = len(chain.present)

    def padded(x):
        more = [(0, slots - length if x.shape[:1] in ((length,), (length - 1,)) else 0)]
        return jnp.pad(x, more + [(0, 0)] * (x.ndim - 1)) if x.ndim else x

    return jax.tree.map(padded, chain)


def test_empty_slots_change_nothing_and_stay():
    robot, bends = LandSalp(), jnp.array([0.4, -0.3])
    alone = robot.straight(3, bends)
    thrusts = jax.random.uniform(jax.random.key(0), (5, 3), minval=-1)
    many = with_dead_slots(alone, 6)
    moved, _ = swim(robot, many, jnp.pad(thrusts, ((0, 0), (0, 3)), constant_values=1.0))
    expected, _ = swim(robot, alone, thrusts)
    assert np.allclose(moved.units.position[:3], expected.units.position, atol=1e-12)
    assert np.array_equal(moved.units.position[3:], many.units.position[3:])
    assert not np.any(moved.units.velocity[3:])


def test_a_cut_chain_swims_as_two():
    robot, bends = LandSalp(angle_stiffness=0.15), jnp.array([0.4, -0.3, 0.2])
    whole = robot.straight(4, bends)
    cut = eqx.tree_at(lambda c: c.linked, whole, jnp.array([True, False, True]))
    thrusts = jax.random.uniform(jax.random.key(0), (3, 4), minval=-1)
    halves, _ = swim(robot, cut, thrusts)
    first, _ = swim(robot, robot.straight(2, bends[:1]), thrusts[:, :2])
    assert np.allclose(halves.units.position[:2], first.units.position, atol=1e-12)
    assert np.allclose(halves.units.angle[:2], first.units.angle, atol=1e-12)


def test_joints_stay_closed():
    robot = LandSalp()
    thrusts = jax.random.uniform(jax.random.key(0), (200, 8), minval=-1)
    chain, _ = swim(robot, robot.straight(8), thrusts)
    angle = robot.directions(chain)
    half = robot.link_length / 2 * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    gaps = (chain.units.position + half)[:-1] - (chain.units.position - half)[1:]
    assert float(jnp.abs(gaps).max()) < 1e-12
    assert float(jnp.abs(jnp.diff(angle)).max()) > 0.5  # it did bend


def test_a_turned_chain_swims_a_turned_way():
    robot, bends, turn = LandSalp(), jnp.array([0.4, -0.3]), 1.1
    thrusts = jax.random.uniform(jax.random.key(0), (5, 3), minval=-1)
    plain, other = robot.straight(3, bends), robot.straight(3, bends)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    angle = other.units.angle + turn
    other = eqx.tree_at(
        lambda c: (c.units.position, c.units.angle), other, (plain.units.position @ matrix.T, angle)
    )
    (_, path), (_, turned) = (swim(robot, chain, thrusts) for chain in (plain, other))
    assert np.allclose(path @ matrix.T, turned, atol=1e-12)


def test_no_chain_is_faster_than_the_bound():
    robot = LandSalp()
    thrusts = jnp.tile(jnp.ones(6), (5, 1))
    chain, _ = swim(robot, robot.straight(6), thrusts)
    speed = float(jnp.linalg.norm(chain.units.velocity.mean(axis=0)))
    assert 0.03 < speed < float(robot.top_speed(6))


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"Part\.drag must be positive"):
        Part(90.0, drag=(1.0, 0.0, 1.0))
    with pytest.raises(InputError, match="parts must be a tuple of Part"):
        LandSalp(parts=())
    with pytest.raises(InputError, match="moves on the ground"):
        LandSalp().advance(LandSalp().straight(2), jnp.zeros(2), Uniform((0.1, 0.0)))
