"""Sorting chains by length leaves out work, and changes no number."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import make_task
from salpchain.training.config import PPOConfig
from salpchain.training.ppo import TrainingSample, _gradient
from salpchain.training.rollout import _known, _sample, _tell
from salpchain.training.widths import at_width, by_length, widths_of

SLOTS, CHAINS = 9, 64
ENV = make_task(TaskConfig(length=SLOTS))
MODELS = [("gcn", "mixed"), ("gatv2", "mixed"), ("gt", "full"), ("gcn", "hub")]
QUICK, SLOW = (
    [("gcn", "mixed", ""), ("gcn", "hub", "sea")],
    [("gatv2", "mixed", ""), ("gt", "full", "")],
)
CRITICS = [*QUICK, *[pytest.param(*one, marks=pytest.mark.slow) for one in SLOW]]


@pytest.mark.parametrize(
    ("lengths", "wanted"),
    [
        ((8,), (8,)),
        ((2, 3), (2, 3)),
        (range(2, 17), (5, 9, 13, 16)),
        ((4, 64), (4, 64)),
        (range(1, 6), (2, 3, 4, 5)),
    ],
)
def test_widths_share_out_the_lengths_and_the_last_serves_all(lengths, wanted, monkeypatch):
    assert widths_of(tuple(lengths)) == wanted
    monkeypatch.setattr("salpchain.training.widths.on_cpu", lambda: False)
    assert widths_of(tuple(lengths)) == wanted[-1:]


def test_every_chain_is_in_one_part_with_its_likes():
    lengths = jr.randint(jr.key(0), (CHAINS,), 2, SLOTS + 1)
    present = jnp.arange(SLOTS) < lengths[:, None]
    parts = by_length(present, 16)
    assert sorted(parts.ravel().tolist()) == list(range(CHAINS))
    assert (np.diff(lengths[parts.ravel()]) >= 0).all()
    for length in range(2, SLOTS + 1):
        width = at_width((3, 6, 9), present[lengths <= length], int)
        assert width == min(w for w in (3, 6, 9) if w >= length)


@pytest.fixture(scope="module")
def states():
    lengths = jr.randint(jr.key(3), (CHAINS,), 2, SLOTS + 1)
    return jax.jit(jax.vmap(ENV.reset))(jr.split(jr.key(4), CHAINS), lengths)


def network(model, graph, critic=""):
    config = ControlConfig(model=model, graph=graph, critic=critic)
    return actor_critic(jr.key(0), config, ENV.observation_size, ENV.action_size, SLOTS)


@pytest.mark.parametrize(("model", "graph", "critic"), [*CRITICS, ("gcn", "hub", "")])
def test_actions_and_values_are_the_same_with_fewer_slots(states, model, graph, critic):
    policy = network(model, graph, critic)
    tell, known = eqx.filter_jit(partial(_tell, policy)), _known(ENV, policy, states)
    whole, sorted_ = tell(states, (), known), tell(states, (3, 6, 9), known)
    present = states.chain.present[..., None]
    np.testing.assert_allclose(sorted_[1], whole[1], rtol=1e-4, atol=1e-5)
    one, other = (np.where(present, told[0], 0) for told in (whole, sorted_))
    assert np.abs(one).max() > 1e-4
    np.testing.assert_allclose(other, one, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("credit", ["chain", "unit"])
@pytest.mark.parametrize(("model", "graph", "critic"), CRITICS)
def test_gradients_are_the_same_with_fewer_slots(states, model, graph, critic, credit):
    policy = network(model, graph, critic)
    known = _known(ENV, policy, states)
    mean, value, _ = _tell(policy, states, (), known)
    keys = jr.split(jr.key(5), CHAINS)
    sample = jax.vmap(partial(_sample, policy))(states, mean, value, keys, known)
    gain = jr.normal(jr.key(6), (CHAINS, SLOTS if credit == "unit" else 1))
    flat = jax.vmap(TrainingSample)(sample, gain, jr.normal(jr.key(7), (CHAINS,)))
    config = PPOConfig(ratio="unit", credit=credit)
    chosen = jr.permutation(jr.key(8), CHAINS)

    @partial(jax.jit, static_argnums=0)
    def gradient(widths):
        return _gradient(policy, config, flat, chosen, 0.01, widths, None)

    whole, sorted_ = gradient(()), gradient((3, 6, 9))
    for one, other in zip(*map(jax.tree.leaves, (whole, sorted_)), strict=True):
        np.testing.assert_allclose(other, one, rtol=2e-3, atol=2e-5)
    assert max(float(jnp.abs(x).max()) for x in jax.tree.leaves(whole[0])) > 1e-2
