"""The drag-dominated chain, held against its equations written out, and the laws it keeps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.dynamics.landsalp import JETS, JOINTS, MEASURED, LandSalp, chain_parts
from salpchain.errors import InputError
from salpchain.physics.state import Chain
from studies.landsalp.__main__ import PERIOD, PUBLISHED
from tests.dynamics.dense import Dense


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def robot(**others):
    return LandSalp.robot(jet=1.0, **others)


def dense_robot():
    kinds = [JETS[0], JETS[1], JETS[0]]
    links = [(jet, at, d, True) for (jet, at), d in zip(kinds, MEASURED, strict=True)]
    return Dense(links, JOINTS, sets_speed=True)


def dense_chain(length, dynamics):
    parts = [dynamics.parts[i % 2] for i in range(length)]
    links = [(p.jet, p.at, p.drag, p.on_wheel) for p in parts]
    drags = [dynamics.joint_drag[0]] * (length - 1)
    return Dense(links, drags, sets_speed=dynamics.sets_speed, stiffness=dynamics.angle_stiffness)


def rates(dynamics, chain, thrust):
    """q' of the first link's middle, its direction and the joints, told by one tiny step."""
    still = type(dynamics)
    given = {f: getattr(dynamics, f) for f in ("parts", "joint_drag", "jet", "sets_speed")}
    tiny = still(control_step=1e-9, substeps=1, angle_stiffness=dynamics.angle_stiffness, **given)
    units = tiny.advance(chain, jnp.asarray(thrust)).units
    turning = np.asarray(units.angular_velocity)
    return np.concatenate([units.velocity[0], turning[:1], np.diff(turning)])


def speeds(t):
    phase = 2 * np.pi * t / PERIOD
    return PUBLISHED[0] + PUBLISHED[1] * np.sin(phase) + PUBLISHED[2] * np.cos(phase)


def test_the_published_gait_goes_30_mm_in_a_cycle_and_does_not_turn():
    chain = dense_robot()
    q = np.zeros(5)
    for _ in range(60):
        q = chain.swim(q, speeds, PERIOD, 60)[-1]
    path = chain.swim(q, speeds, PERIOD, 600)
    way = np.linalg.norm(chain.middles(path[-1]).mean(0) - chain.middles(path[0]).mean(0))
    assert way == pytest.approx(0.03, abs=1e-4)
    turn = (chain.directions(path[-1]) - chain.directions(path[0])).mean()
    assert abs(np.degrees(turn)) / PERIOD < 1e-6
    assert np.degrees(np.abs(path[:, 3:]).max()) <= 10.4


@pytest.mark.parametrize("seed", range(3))
def test_three_links_move_as_their_equations_say(seed):
    dice = np.random.default_rng(seed)
    bends, u = dice.uniform(-1.5, 1.5, 2), dice.uniform(-1, 1, 3)
    q = np.array([0.0, 0.0, 0.0, *bends])
    expected = dense_robot().rate(q, u)
    assert rates(robot(), robot().straight(3, bends), u) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("length", [1, 2, 5, 8, 33])
@pytest.mark.parametrize("across, spring, wheels", [(3.0, 0.0, False), (10.0, 0.15, True)])
def test_chains_of_any_length_move_as_their_equations_say(length, across, spring, wheels):
    given = {"parts": chain_parts(across), "angle_stiffness": spring, "sets_speed": wheels}
    dynamics, dice = LandSalp(**given), np.random.default_rng(length)
    bends, u = dice.uniform(-1, 1, length - 1), dice.uniform(-1, 1, length)
    q = np.concatenate([np.zeros(3), bends])
    expected = dense_chain(length, dynamics).rate(q, u * dynamics.jet)
    told = rates(dynamics, dynamics.straight(length, bends).__class__ and _rest(dynamics, length, bends), u)
    assert told == pytest.approx(expected, rel=1e-7, abs=1e-9)


def _rest(dynamics, length, bends) -> Chain:
    return dynamics.straight(length, bends)
