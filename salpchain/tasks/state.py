"""The state of an episode, and what a task says of its start and of each control step."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.physics.state import Chain
from salpchain.tasks.reach.reward import Distances
from salpchain.world.sensing import Senses
from salpchain.world.world import World

Terms = dict[str, Float[Array, ""]]


class State(eqx.Module):
    """One episode after some step, with what the last step gave."""

    chain: Chain
    target: Float[Array, "unit 2"]  # m, one point for each unit
    thrust: Float[Array, " unit"]  # N, of the last step
    force: Float[Array, "unit 2"]  # N, of the last step, as it acted, in world axes
    distances: Distances
    start_distance: Float[Array, ""]  # m, mean distance at reset
    time: Int[Array, ""]  # control steps since reset
    obs: Float[Array, "unit feature"]
    reward: Float[Array, ""]  # weighted sum of the terms
    terms: Terms
    terminated: Bool[Array, ""]  # goal reached, at the fence, or invalid: nothing follows
    truncated: Bool[Array, ""]  # out of time: the episode would have gone on
    invalid: Bool[Array, ""]  # the last action held NaN or infinity: the chain was stopped
    key: PRNGKeyArray  # of the next episode
    world: World  # what this episode's world has of its own; the rest is the task's
    senses: Senses | None = None  # of the sensors, where the world has faulty ones
    plan: Any = None  # what the task itself remembers

    @property
    def done(self) -> Bool[Array, "*batch"]:
        """Whether the episode is over, for either reason."""
        return self.terminated | self.truncated

    @property
    def goal(self) -> Bool[Array, "*batch"]:
        """Whether the target pose is taken; never in a task without the term `goal`."""
        return self.terms["goal"] > 0 if "goal" in self.terms else jnp.zeros_like(self.invalid)

    @property
    def seen(self) -> Chain:
        """The chain as its sensors tell it: what a controller may know."""
        return self.chain if self.senses is None else self.senses.of(self.chain)

    @property
    def length(self) -> Int[Array, "*batch"]:
        """Number of units present."""
        return self.chain.present.sum(axis=-1)

    @property
    def closed_fraction(self) -> Float[Array, "*batch"]:
        """1 - mean distance now / mean distance at reset; 0 of a chain that began at its target."""
        away = self.start_distance > 0
        start = jnp.where(away, self.start_distance, 1.0)
        return jnp.where(away, 1.0 - self.distances.mean / start, 0.0)


class Start(NamedTuple):
    """What an episode begins with."""

    chain: Chain
    target: Float[Array, "unit 2"]  # m
    plan: Any = None  # what the task itself remembers


class Moment(NamedTuple):
    """Where a control step led."""

    chain: Chain
    target: Float[Array, "unit 2"]  # m
    distances: Distances
    valid: Bool[Array, ""]  # whether the action was numbers; otherwise the chain was stopped


class Judgement(NamedTuple):
    """What a control step was worth."""

    terms: Terms  # each before its weight
    ended: Bool[Array, ""]  # nothing follows; fence and invalid actions end an episode anyway
