"""A policy of thrusts as one whose units can also let go of each other."""

from dataclasses import replace
from typing import Any

import equinox as eqx

from salpchain.controllers.observing import padded
from salpchain.controllers.policy import Policy, as_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import START_LOG_STD
from salpchain.networks.config import SINGLE_LENGTH

HOLD = 1.0  # second number of an action at first (chosen): noise of training seldom lets go


def gripping(policy: Policy) -> Policy:
    """The policy with the action `grip`: it thrusts as before, and every unit holds the next one.

    Raises:
        InputError: its action is not `thrust`, or it has one network for a whole chain or two.
    """
    card = policy.card
    if card.action == "grip":
        return policy
    kind = "two networks by jet" if card.control.by_jet else card.control.model
    if card.action != "thrust" or card.control.by_jet or kind in SINGLE_LENGTH:
        raise InputError(
            f"{card.name} cannot learn to grip: that takes one graph network for every unit and the"
            f" action thrust, got {kind} with action {card.action}"
        )
    more = replace(card, action="grip")
    network: Any = padded(policy.network, more)
    last = network.actor.layers[-1]
    network = eqx.tree_at(lambda n: n.actor.layers[-1].bias, network, last.bias.at[1].set(HOLD))
    spread = network.log_std.at[1].set(START_LOG_STD)
    network = eqx.tree_at(lambda n: n.log_std, network, spread)
    return as_policy(network, more)
