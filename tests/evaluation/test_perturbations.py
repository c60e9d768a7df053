import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.evaluation.perturbations import Delayed, Noisy, changed
from salpchain.evaluation.trials import run_trials
from salpchain.physics.chain import step
from salpchain.physics.state import Physics
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

ENV = SCLD(TaskConfig(length=4, contact=False))
START = jax.jit(ENV.reset)(jr.key(0))
go = jax.jit(ENV.step)


def test_a_delayed_controller_does_what_it_would_have_done_a_step_before():
    late = Delayed(Greedy())
    state, memory, before = START, late.begin(START), jnp.zeros((4, 1))
    for _ in range(4):
        action, memory = late.plan(state, memory)
        np.testing.assert_allclose(action, before, atol=1e-6)
        before = Greedy().act(state)
        state = go(state, action)
    assert float(jnp.abs(before).max()) > 0.1 and not late.act(START).any()


def test_noise_of_nothing_changes_nothing_and_noise_changes_with_time():
    np.testing.assert_allclose(Noisy(Greedy()).act(START), Greedy().act(START), atol=1e-6)
    noisy = Noisy(Greedy(), 0.01, 0.01)
    first = noisy.act(START)
    later = noisy.act(eqx.tree_at(lambda state: state.time, START, jnp.int32(1)))
    assert float(jnp.abs(first - later).max()) > 1e-3
    np.testing.assert_array_equal(noisy.act(START), first)


def test_what_is_seen_differs_by_the_noise_that_was_asked_for():
    @jax.jit
    @jax.vmap
    def seen(key):
        state = eqx.tree_at(lambda state: state.key, START, key)
        return Noisy(Greedy(), 0.02, 0.3)._seen(state)

    told = seen(jr.split(jr.key(1), 2000))
    place = np.asarray(told.chain.units.position - START.chain.units.position)
    angle = np.asarray(told.chain.units.angle - START.chain.units.angle)
    assert place.std() == pytest.approx(0.02, rel=0.05)
    assert angle.std() == pytest.approx(0.3, rel=0.05)
    assert np.asarray(told.obs).std(axis=0).max() > 0.1


def test_a_larger_thrust_limit_is_a_larger_thrust():
    plain = stronger = START.chain
    thrust = jnp.array([1.0, -0.5, 0.3, 1.0])
    one = jax.jit(lambda chain: step(chain, 1.2 * thrust, Physics(), contact=False))
    other = jax.jit(lambda chain: step(chain, thrust, changed(thrust=1.2), contact=False))
    for _ in range(20):
        plain, stronger = one(plain), other(stronger)
    moved = plain.units.position - START.chain.units.position
    np.testing.assert_allclose(stronger.units.position, plain.units.position, atol=2e-4)
    assert float(jnp.abs(moved).max()) > 0.02


@pytest.mark.slow
def test_trials_are_played_with_the_physics_given():
    heavy, plain = (
        run_trials([Greedy()], 4, 8, "fixed", 0, world=physics)[0]
        for physics in (changed(mass=3.0), Physics())
    )
    assert (heavy.fewest_steps > plain.fewest_steps).all()
    assert heavy.start_distance.equals(plain.start_distance)
