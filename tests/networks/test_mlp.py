"""The fixed-length baseline."""

import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import load, save_policy
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig

CONFIG = ControlConfig(model="mlp")


@pytest.fixture
def policy():
    return Policy(actor_critic(jr.key(0), CONFIG, 22, 1, 4), PolicyCard("mlp-4", CONFIG, length=4))


def test_each_units_action_and_the_value_depend_on_every_unit(policy):
    obs = jr.normal(jr.key(1), (4, 22))
    present, joined = jnp.ones(4, bool), jnp.ones(3, bool)
    action, value = policy.network(obs, present, joined)
    for unit in range(4):
        changed_action, changed_value = policy.network(obs.at[unit].add(1.0), present, joined)
        assert (changed_action != action).all()
        assert changed_value != value


def test_it_serves_its_own_length_and_refuses_all_others_in_one_line(policy):
    assert len(run_trials([policy], 4, 1, "fixed", 0)[0]) == 1
    with pytest.raises(InputError, match="mlp-4 is an mlp and works at 4 units only, got length 5"):
        run_trials([policy], 5, 1, "fixed", 0)


def test_it_comes_back_from_its_file(policy, tmp_path):
    save_policy(policy, tmp_path / "mlp.safetensors")
    again = load(tmp_path / "mlp.safetensors")
    obs = jr.normal(jr.key(1), (4, 22))
    assert again.card == policy.card
    assert np.array_equal(again.network.act(obs, None, None), policy.network.act(obs, None, None))
