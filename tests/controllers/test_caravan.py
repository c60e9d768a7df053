"""The planner of sizes: pieces that fit, an order that keeps them apart, whole chains behind."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

import salpchain
from salpchain.controllers.caravan import BERTH, LEGS, WAIT, Caravan, _hold, _stage
from salpchain.controllers.policy import PolicyCard
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.tasks.parting.config import DockConfig, PassageConfig
from salpchain.tasks.registry import make_task

LINK, UNIT = 0.07, 0.04


def begun(length, slots=None, **settings):
    """A passage's first state, and what the planner makes of it."""
    slots = slots or length
    env = make_task(PassageConfig(slots, action="grip", **settings))
    state = jax.jit(lambda key: env.reset(key, length))(jr.key(5))
    return env, state, Caravan().begin(state)


@pytest.mark.parametrize(("length", "opening"), [(8, 0.5), (16, 0.25), (16, 0.5), (11, 0.7)])
def test_pieces_fit_the_opening_and_differ_by_one_unit_at_most(length, opening):
    _, _, convoy = begun(length, length + 2, opening=opening)
    rank = np.asarray(convoy.route.rank)[:length]
    sizes = np.bincount(rank)
    assert len(sizes) == int(convoy.route.count) and np.ptp(sizes) <= 1
    free = opening * length * LINK
    assert (sizes.max() - 1) * LINK + UNIT + 2 * 0.012 <= free
    steps = np.diff(rank)
    assert set(np.abs(steps)) <= {0, 1} and len({*np.sign(steps[steps != 0])}) == 1


def test_a_chain_that_fits_is_not_cut():
    _, state, convoy = begun(8, opening=1.2)
    assert int(convoy.route.count) == 1
    caravan = Caravan()
    action, _ = jax.jit(lambda *now: caravan.plan(*now))(state, convoy)
    assert (action[:, 1] == 0.0).all()


def test_one_piece_leaves_first_and_the_others_wait_where_they_are():
    env, state, convoy = begun(8, opening=0.5)
    caravan, step = Caravan(), jax.jit(env.step)
    plan = jax.jit(lambda *now: caravan.plan(*now))
    for _ in range(30):
        action, convoy = plan(state, convoy)
        state = step(state, action)
    stages = np.asarray(_stage(convoy))[: int(convoy.route.count)]
    assert stages[0] > WAIT and (stages[1:] == WAIT).all()
    joined = np.asarray(state.chain.joined)
    rank = np.asarray(convoy.route.rank)
    cut = np.flatnonzero(~joined)
    assert len(cut) == 1 and {rank[cut[0]], rank[cut[0] + 1]} == {0, 1}


@pytest.mark.parametrize(("length", "way"), [(8, 42), (32, 112)])
def test_a_joint_waits_longer_for_a_longer_last_way(length, way):
    """Of 0.255 m and 0.675 m at 6 cm/s; it closes from afar no sooner than 6 s beyond that."""
    env = make_task(DockConfig(length, action="grip"))
    state = jax.jit(env.reset)(jr.key(5))
    caravan = Caravan()
    convoy = jax.jit(lambda now: caravan.begin(now))(state)
    there = jnp.full(length, BERTH * LEGS)
    holds = [
        bool(
            _hold(state, convoy._replace(progress=there, clock=jnp.full(length, clock)))[
                length // 2 - 1
            ]
        )
        for clock in (way, way + 59, way + 62)
    ]
    assert holds == [False, False, True]


def test_elsewhere_it_is_the_policy_below_it():
    policy = salpchain.load("any-length")
    env = make_task(policy.card.task(5))
    state = jax.jit(env.reset)(jr.key(2))
    caravan = Caravan(policy)
    action, _ = caravan.plan(state, caravan.begin(state))
    np.testing.assert_allclose(action[:, :1], jnp.clip(policy.act(state), -1, 1), atol=1e-5)


def test_a_guide_that_cannot_serve_is_refused():
    class Late:
        card = PolicyCard(name="late", observation="jets*4")

        def act(self, state):
            return state

    with pytest.raises(InputError, match="observes one control step, got late"):
        Caravan(Late())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "length"),
    [(PassageConfig(opening=0.5), 8), (DockConfig(), 8)],
    ids=["passage", "dock"],
)
def test_chains_are_one_again_where_they_should_be(task, length):
    trials = run_trials([Caravan()], length, 8, "scaled", 28, task=task)[0]
    assert trials["success"].mean() >= 0.75
    assert trials["joined"][trials["success"]].all()
