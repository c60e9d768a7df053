"""Poses from elsewhere lead to the actions that the same chain gets here."""

from functools import cache

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

import salpchain
from salpchain.errors import InputError
from salpchain.tasks.reach.task import SCLD
from tests.interop.policies import fresh

LENGTH = 5
CONTROLLERS = {
    "body": fresh(),
    "table1": fresh(observation="table1", action="pair"),
    "mlp": fresh("mlp", length=LENGTH),
    "greedy": salpchain.Greedy(),
    "approach": salpchain.Approach(action="pair"),
}


@cache
def moving(name, number=3):
    """States of chains that swim, some steps after their start."""
    controller = CONTROLLERS[name]
    env = SCLD(controller.card.task(LENGTH))
    reset, advance = (jax.jit(jax.vmap(one)) for one in (env.reset, env.step))
    states = reset(jr.split(jr.key(1), number))
    shape = (number, LENGTH, env.action_size)
    for step in range(4):
        states = advance(states, jr.uniform(jr.key(step), shape, minval=-1.0))
    return env, states


def poses(states):
    units = states.chain.units
    given = units.position, units.angle, units.velocity, units.angular_velocity, states.target
    return [np.asarray(x) for x in (*given, states.force)]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_actions_and_thrusts_are_those_of_the_simulation(name):
    controller = CONTROLLERS[name]
    env, states = moving(name)
    steer = salpchain.steering(controller, LENGTH)
    actions = jnp.clip(jax.vmap(controller.act)(states), -1, 1)
    np.testing.assert_allclose(steer(*poses(states)), actions, atol=1e-5)
    thrusts = jax.vmap(env.thrust)(states.chain, actions)
    np.testing.assert_allclose(steer.thrust(*poses(states)), thrusts, atol=1e-5)


def test_one_chain_and_any_axes_in_front_give_the_same():
    controller = CONTROLLERS["greedy"]
    steer, given = salpchain.steering(controller, LENGTH), poses(moving("greedy", 4)[1])
    all_at_once = steer(*given)
    one = steer(*(x[2] for x in given))
    assert one.shape == (LENGTH, 1)
    np.testing.assert_allclose(one, all_at_once[2], atol=1e-6)
    square = steer(*(x.reshape(2, 2, *x.shape[1:]) for x in given))
    np.testing.assert_allclose(square.reshape(all_at_once.shape), all_at_once, atol=1e-6)


def test_lists_and_no_force_will_do():
    steer = salpchain.steering(salpchain.Greedy(), 2)
    place, still = [[0.0, 0.0], [0.07, 0.0]], [0.0, 0.0]
    thrusts = steer.thrust(place, still, [still, still], still, [[0.0, 1.0], [0.07, -1.0]])
    np.testing.assert_allclose(thrusts, [1.0, -1.0])


@pytest.mark.parametrize(
    ("which", "wrong", "says"),
    [
        (0, np.zeros((LENGTH + 1, 2)), r"position must have shape \(..., 5, 2\), got \(6, 2\)"),
        (1, np.zeros(()), r"angle must have shape \(..., 5\), got \(\)"),
        (3, np.zeros((1, LENGTH)), r"angular_velocity must have shape"),
        (4, np.zeros((LENGTH, 3)), r"target must have shape"),
        (0, np.full((LENGTH, 2), np.nan), "position of unit 0 is not finite: send no thrust"),
        (1, np.array([0, 0, 0, np.inf, 0]), "angle of unit 3 is not finite"),
    ],
)
def test_poses_that_cannot_be_used_are_refused(which, wrong, says):
    given = [x[0] for x in poses(moving("greedy", 1)[1])]
    given[which] = wrong
    with pytest.raises(InputError, match=says):
        salpchain.steering(salpchain.Greedy(), LENGTH)(*given)


def test_what_cannot_be_steered_by_poses_is_refused():
    greedy = salpchain.steering(salpchain.Greedy(), 3)
    with pytest.raises(InputError, match=r"angle must have shape \(..., 3\) as that of position, "):
        greedy(*(np.zeros(shape) for shape in ((2, 3, 2), (3,), (2, 3, 2), (2, 3), (2, 3, 2))))
    with pytest.raises(InputError, match=r"give one chain or more, got position of shape \(0, 3"):
        greedy(*(np.zeros(shape) for shape in ((0, 3, 2), (0, 3), (0, 3, 2), (0, 3), (0, 3, 2))))
    with pytest.raises(InputError, match="mpc remembers, or plans on the simulation"):
        salpchain.steering(salpchain.MPC(), 4)
    with pytest.raises(InputError, match=r"body\*2, several control steps at once: poses"):
        salpchain.steering(fresh(observation="body*2"), 4)
    with pytest.raises(InputError, match="works at 5 units only, got length 4"):
        salpchain.steering(CONTROLLERS["mlp"], 4)
    with pytest.raises(InputError, match="2 to 1024"):
        salpchain.steering(salpchain.Greedy(), 1)
