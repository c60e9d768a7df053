import jax
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.gripping import gripping
from salpchain.controllers.policy import PolicyCard, as_policy
from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.actions import LET_GO
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import observation_size
from salpchain.tasks.registry import make_task
from salpchain.training.settings import preset
from salpchain.training.start import policy_to_start, with_weights


def test_a_policy_that_can_grip_thrusts_as_before_and_holds_on():
    policy = load("any-length")
    more = gripping(policy)
    env = make_task(TaskConfig(length=6, observation="proximity"))
    state = jax.jit(env.reset)(jr.key(1))
    action = np.asarray(more.act(state))
    assert action.shape == (6, 2) and more.card.action == "grip"
    np.testing.assert_allclose(action[:, :1], policy.act(state), rtol=1e-6)
    # Noise in training has a spread of 0.6: fewer than one unit in a hundred lets go in a step
    assert (action[:, 1] > LET_GO + 2.4 * np.exp(-0.5)).all()
    assert gripping(more) is more


def test_a_run_that_grips_begins_with_a_policy_that_thrusts():
    settings = {"task.action": "grip", "task.observation": "around", "start": "any-length"}
    start = policy_to_start(preset(length="4..6", settings=settings))
    assert start is not None
    assert (start.card.action, start.card.observation) == ("grip", "around")
    fresh = actor_critic(jr.key(0), start.card.control, observation_size("around"), 2, 6)
    spread = with_weights(fresh, start).log_std
    assert spread[0] == load("any-length").network.log_std[0] and spread[1] == -0.5


@pytest.mark.parametrize(("model", "action"), [("mlp", "thrust"), ("gcn", "pair")])
def test_what_cannot_learn_to_grip_says_so(model, action):
    control, sizes = ControlConfig(model=model), {"thrust": 1, "pair": 2}
    network = actor_critic(jr.key(0), control, observation_size("body"), sizes[action], 4)
    card = PolicyCard(name="no", observation="body", action=action, control=control, length=4)
    with pytest.raises(InputError, match=f"no cannot learn to grip.* got {model} with .*{action}"):
        gripping(as_policy(network, card))
