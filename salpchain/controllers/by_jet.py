"""One policy of two: for units whose jets push both ways, and for those whose jets push one way."""

from dataclasses import replace
from typing import Any

from salpchain.controllers.policy import Policy, as_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import ByJet

ALIKE = "control", "observation", "action", "task_name", "task_settings"  # of both cards


def by_jet(both_ways: Policy, one_way: Policy, name: str) -> Policy:
    """The policy by which a unit acts as `one_way` where its jet pushes one way, else `both_ways`.

    Its units observe their own jet (`jets`, `sea`). Of what the card tells, lengths are those of
    both, the steps are added up, and the world is that of `both_ways`.

    Raises:
        InputError: they differ in network, observation, action or task; units do not observe their
            jets, or remember; one has two networks already.
    """
    card, other = both_ways.card, one_way.card
    for what in ALIKE:
        mine, theirs = getattr(card, what), getattr(other, what)
        if mine != theirs:
            raise InputError(
                f"both policies must have the same {what}: {card.name} has {mine}, {other.name}"
                f" {theirs}"
            )
    if card.control.by_jet:
        raise InputError(f"{card.name} has two networks already: give policies of one each")
    lengths = sorted({*(card.lengths or (card.length,)), *(other.lengths or (other.length,))})
    joined = replace(
        card,
        name=name,
        control=replace(card.control, by_jet=True),
        length=lengths[-1],
        lengths=tuple(lengths),
        steps=card.steps + other.steps,
    )
    networks: list[Any] = [both_ways.network, one_way.network]
    return as_policy(ByJet(*networks), joined)
