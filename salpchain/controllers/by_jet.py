"""One policy of two: for units whose jets push both ways, and for those whose jets push one way."""

from dataclasses import replace
from typing import Any

from salpchain.controllers.observing import observing
from salpchain.controllers.policy import Policy, as_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import ByJet

ALIKE = "control", "action", "task_name", "task_settings"  # of both cards


def by_jet(both_ways: Policy, one_way: Policy, name: str) -> Policy:
    """The policy by which a unit acts as `one_way` where its jet pushes one way, else `both_ways`.

    Its units observe what those of `one_way` do, their own jet with it (`jets`, `sea`); what those
    of `both_ways` observe may end earlier. Of what the card tells, lengths are those of both, the
    steps are added up, and the world is that of `both_ways`.

    Raises:
        InputError: they differ in network, action or task, or in what units observe first; units do
            not observe their jets, or remember; one has two networks already.
    """
    both_ways = observing(both_ways, one_way.card.observation)
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
