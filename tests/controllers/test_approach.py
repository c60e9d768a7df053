"""The hand-written controller that turns, approaches and bends; and controllers by name."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers import named
from salpchain.controllers.approach import Approach, pose
from salpchain.controllers.greedy import Greedy
from salpchain.controllers.policy import Controller
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

ENV = SCLD(TaskConfig(length=9))
act = eqx.filter_jit(lambda controller, state: controller.act(state))


def swimming(length=9):
    """A chain that random thrusts have bent, and its target."""
    state = jax.jit(ENV.reset)(jr.key(4), length)
    thrusts = jr.uniform(jr.key(5), (25, 9, 1), minval=-1.0)
    return jax.jit(lambda s: jax.lax.scan(lambda s, a: (ENV.step(s, a), None), s, thrusts))(state)[
        0
    ]


@pytest.mark.slow
def test_it_takes_targets_that_greedy_cannot():
    for length, share in ((3, 1.0), (9, 0.9)):
        (ours,), (greedy,) = (
            run_trials([c], length, 30, "scaled", 7) for c in (Approach(), Greedy())
        )
        assert ours.success.mean() >= share > greedy.success.mean() + 0.3


def test_a_straight_chain_beside_its_target_turns_first():
    """What lies along the chain's own axis cannot be reached sideways: a unicycle turns for it."""
    state = jax.jit(ENV.reset)(jr.key(0))
    axis = state.chain.units.position[1] - state.chain.units.position[0]
    beside = eqx.tree_at(lambda s: s.target, state, state.chain.units.position + 20 * axis)
    thrust = np.asarray(act(Approach(), beside))[:, 0]
    assert abs(thrust.sum()) < 0.5 and thrust[0] * thrust[-1] < -0.5


def test_it_does_the_same_wherever_the_world_lies():
    state = swimming()
    turn, shift = 0.7, jnp.array([3.0, -2.0])
    rotation = jnp.array([[jnp.cos(turn), -jnp.sin(turn)], [jnp.sin(turn), jnp.cos(turn)]])
    units = state.chain.units
    moved = eqx.tree_at(
        lambda s: (
            s.chain.units.position, s.chain.units.velocity, s.chain.units.angle, s.target,
        ),
        state,
        (units.position @ rotation.T + shift, units.velocity @ rotation.T, units.angle + turn,
         state.target @ rotation.T + shift),
    )  # fmt: skip
    np.testing.assert_allclose(act(Approach(), moved), act(Approach(), state), atol=2e-4)


def test_dead_slots_thrust_nothing_and_change_nothing():
    state = swimming(length=6)
    slots = {9: 6, 8: 5}  # units, links
    cut = jax.tree.map(lambda x: x[: slots[len(x)]] if x.ndim and len(x) in slots else x, state)
    action = np.asarray(act(Approach(), state))
    np.testing.assert_allclose(action[:6], act(Approach(), cut), atol=1e-5)
    assert not action[6:].any() and np.isfinite(action).all()


def test_a_pair_of_actions_gives_the_same_thrust():
    state = swimming()
    one, two = act(Approach(), state), act(Approach(action="pair"), state)
    pair = SCLD(TaskConfig(length=9, action="pair"))
    np.testing.assert_allclose(
        pair.thrust(state.chain, two), ENV.thrust(state.chain, one), atol=1e-6
    )


def test_the_course_of_a_straight_chain_is_its_heading():
    state = jax.jit(ENV.reset)(jr.key(2))
    body = pose(state.chain.units.position, state.chain.present)
    turn = body.course - (state.chain.units.angle[0] + np.pi / 2)
    np.testing.assert_allclose([np.sin(turn), np.cos(turn)], [0, 1], atol=1e-5)
    np.testing.assert_allclose(body.arms.sum(axis=0), 0, atol=1e-5)


@pytest.mark.parametrize("name", named.WRITTEN)
def test_hand_written_controllers_are_found_by_name(name):
    controller = named.load(name)
    assert isinstance(controller, Controller) and controller.card.name == name


def test_a_name_that_is_none_lists_those_that_are():
    with pytest.raises(
        InputError, match=r"policy: gready \(a path, or one of .*greedy, approach, mpc"
    ):
        named.load("gready")
