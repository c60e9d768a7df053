"""Policies with fresh weights, whose actions are large enough to be told apart and clipped."""

import equinox as eqx
import jax.random as jr

from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import ACTION_SIZES
from salpchain.tasks.features import observation_size


def fresh(model="gcn", graph="mixed", observation="body", action="thrust", length=8, **settings):
    control = ControlConfig(model=model, graph=graph, **settings)
    card = PolicyCard(name=f"{model}-{graph}", control=control, observation=observation,
                      action=action, length=length, lengths=(length,))  # fmt: skip
    sizes = observation_size(observation), ACTION_SIZES[action]
    network = actor_critic(jr.key(3), control, *sizes, length)
    last = lambda network: network.actor.layers[-1].weight  # noqa: E731
    return Policy(eqx.tree_at(last, network, 1500 * last(network)), card)
