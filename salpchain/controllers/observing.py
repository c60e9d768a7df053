"""A policy whose units are told more than they were trained with."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array

from salpchain.controllers.policy import Policy, PolicyCard, as_policy
from salpchain.controllers.storage import network_shapes
from salpchain.errors import InputError
from salpchain.networks.actor_critic import ActorCritic
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.tasks.features import layout


def observing(policy: Policy, observation: str) -> Policy:
    """The policy with an observation that begins with its own; what else is seen counts for 0.

    Raises:
        InputError: the observation begins otherwise, or the policy has one network for a whole
            chain.
    """
    card = policy.card
    if observation == card.observation:
        return policy
    had = layout(card.observation)
    if layout(observation)[: len(had)] != had:
        raise InputError(
            f"{card.name} observes {card.observation}, with which what units observe here"
            f" ({observation}) does not begin"
        )
    if card.control.model in SINGLE_LENGTH:
        raise InputError(f"an {card.control.model} observes {card.observation} and nothing else")
    more = replace(card, observation=observation)
    return as_policy(padded(policy.network, more), more)


def padded(network: ActorCritic, card: PolicyCard) -> ActorCritic:
    """The weights in a network of this card, whose arrays are larger; 0 where there were none."""

    def put(new: jax.ShapeDtypeStruct, old: Array) -> Array:
        return jnp.pad(old, [(0, n - m) for m, n in zip(old.shape, new.shape, strict=True)])

    return jax.tree.map(put, network_shapes(card), network)
