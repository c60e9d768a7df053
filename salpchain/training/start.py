"""Weights that a run begins with: those of a policy that was trained before."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from salpchain.controllers.gripping import gripping
from salpchain.controllers.observing import observing
from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.networks.actor_critic import ActorCritic, ByJet
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.training.config import TrainConfig


def policy_to_start(config: TrainConfig) -> Policy | None:
    """The policy whose weights the run begins with, if it does not begin with fresh ones.

    Raises:
        InputError: there is none, it has another network or other actions (but that units which
            thrust can begin to grip), or what it observes is not what units of this run observe
            first.
    """
    if not config.start:
        return None
    task = config.task
    try:
        given = load(config.start)
    except InputError as error:
        raise InputError(f"start: {error}") from None
    if task.action == "grip" and given.card.action == "thrust":
        given = _able(gripping, given, config.start)
    card, own = given.card, config.control
    two = card.control.by_jet or own.by_jet
    had_trunk = replace(card.control, critic=own.critic, memory=own.memory, by_jet=two)
    for what, wanted_one, other in (
        ("control", own, had_trunk),
        ("action", task.action, card.action),
    ):
        if wanted_one != other:
            raise InputError(
                f"start {config.start} has another {what}: {other}, this run {wanted_one}"
            )
    if card.control.model in SINGLE_LENGTH and card.length != task.length:
        raise InputError(f"start {config.start} works at {card.length} units, got {task.length}")
    return _able(lambda policy: observing(policy, task.observation), given, config.start)


def _able(change: Callable[[Policy], Policy], given: Policy, start: str) -> Policy:
    """The policy with more to observe or to do; a refusal names the start."""
    try:
        return change(given)
    except InputError as error:
        raise InputError(f"start {start}: {error}") from None


def with_weights(fresh: ActorCritic, policy: Policy, fresh_spread: bool = False) -> ActorCritic:
    """The network with the weights of the policy, which observes what the network does.

    The spread of its actions is that of a fresh one, or the policy's where that is larger and
    `fresh_spread` does not forbid it: some policies hardly explore at the end of their training,
    and others have means so far beyond the largest thrust that a fresh spread would never turn one
    round. Its critic is a fresh one unless both have the same kind, and so is its memory, which
    counts for nothing at first, unless both have one. Of two networks by jet both begin with the
    weights of a policy that has one.
    """
    given: Any = policy.network
    if isinstance(fresh, ByJet):
        ours = fresh.both_ways, fresh.one_way
        theirs = (given.both_ways, given.one_way) if isinstance(given, ByJet) else (given, given)
        both = zip(ours, theirs, strict=True)
        return ByJet(*(_with_weights(new, old, fresh_spread) for new, old in both))
    return _with_weights(fresh, given, fresh_spread)


def _with_weights(fresh: Any, given: Any, fresh_spread: bool) -> Any:
    """One network with the weights of another, as `with_weights` says."""
    if given.critic_observes != fresh.critic_observes:
        judge = "critic", "score", "critic_trunk", "critic_observes"
        given = replace(given, **{name: getattr(fresh, name) for name in judge})
    if (given.recall is None) != (fresh.recall is None):
        given = replace(given, recall=fresh.recall)
    # Copies: a run gives its arrays' memory away, so no two networks may share what they begin with
    weights: Any = jax.tree.map(lambda new, old: jnp.array(old, new.dtype), fresh, given)
    spread = fresh.log_std
    same = given.log_std.shape == spread.shape  # not if one for each unit, of another length
    if same and not fresh_spread:
        spread = jnp.maximum(spread, weights.log_std)
    return eqx.tree_at(lambda network: network.log_std, weights, spread)
