"""Model-predictive control by sampling: a slow yardstick for short chains (docs/any-length.md).

The cross-entropy method (Rubinstein 1999; de Boer et al. 2005) on smooth thrust sequences, planned
anew at every control step on the engine itself, warm-started from the step before.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.control.greedy import as_action
from salpchain.control.policy import PolicyCard
from salpchain.domain.reward import distances, reached
from salpchain.domain.scld import State
from salpchain.physics.chain import Chain, Physics, step

PLAN_STREAM = 2  # sets a planner's random numbers apart from those of the episode (chosen)


class Plan(NamedTuple):
    """What a planner carries from one control step to the next."""

    knots: Float[Array, "knot unit"]  # N, thrusts, `every` control steps apart
    key: PRNGKeyArray


class MPC(eqx.Module):
    """Thrusts that would take the chain to its target soonest: many are tried, the best refined.

    A plan is piecewise linear in time. In each round `samples` plans near the best so far swim over
    the horizon; the mean of the `elites` best is the next round's middle. It knows the physics and
    the whole state, which a robot's controller does not.
    """

    physics: Physics = eqx.field(default_factory=Physics)
    observation: str = eqx.field(static=True, default="body")
    action: str = eqx.field(static=True, default="thrust")
    samples: int = eqx.field(static=True, default=256)  # plans in a round (chosen)
    elites: int = eqx.field(static=True, default=16)
    rounds: int = eqx.field(static=True, default=3)
    knots: int = eqx.field(static=True, default=11)
    every: int = eqx.field(static=True, default=6)  # control steps between knots
    noise: float = 0.7  # N, of a knot in the first round
    shrink: float = 0.5  # of the noise from round to round
    late: float = 6.0  # weight of where a plan ends, in control steps

    @property
    def card(self) -> PolicyCard:
        """Works at any length; was never trained."""
        return PolicyCard(name="mpc", observation=self.observation, action=self.action)

    def begin(self, state: State) -> Plan:
        """A plan before the first step: no thrust."""
        slots = state.thrust.shape[0]
        return Plan(jnp.zeros((self.knots, slots)), jr.fold_in(state.key, PLAN_STREAM))

    def plan(self, state: State, plan: Plan) -> tuple[Float[Array, "unit act"], Plan]:
        """The first thrusts of the best plan found, and that plan one control step later."""
        next_key, *keys = jr.split(plan.key, self.rounds + 1)
        best = plan.knots
        for number, key in enumerate(keys):
            best = self._refine(state, best, self.noise * self.shrink**number, key)
        later = self._thrusts(best)[1:]
        shifted = later[jnp.minimum(jnp.arange(self.knots) * self.every, len(later) - 1)]
        return as_action(best[0], self.action), Plan(shifted, next_key)

    def act(self, state: State) -> Float[Array, "unit act"]:
        """The first thrusts of a plan made from nothing."""
        return self.plan(state, self.begin(state))[0]

    def _refine(
        self, state: State, knots: Float[Array, "knot unit"], noise: float, key: PRNGKeyArray
    ) -> Float[Array, "knot unit"]:
        """The mean of the best plans near this one, itself among those tried."""
        change = noise * jr.normal(key, (self.samples, *knots.shape))
        tried = jnp.clip(knots + change.at[0].set(0.0), -1.0, 1.0)
        cost = jax.vmap(lambda one: self._cost(state, one))(tried)
        return tried[jnp.argsort(cost)[: self.elites]].mean(axis=0)

    def _thrusts(self, knots: Float[Array, "knot unit"]) -> Float[Array, "time unit"]:
        """The plan at every control step of the horizon."""
        time = jnp.arange((self.knots - 1) * self.every + 1) / self.every
        left = jnp.minimum(time.astype(int), self.knots - 2)
        part = (time - left)[:, None]
        return (1 - part) * knots[left] + part * knots[left + 1]

    def _cost(self, state: State, knots: Float[Array, "knot unit"]) -> Float[Array, ""]:
        """Sum over the horizon of the log distance (see `reward.distances`), 0 from the goal on."""

        def swim(carry: tuple[Chain, Array], thrust: Array) -> tuple[tuple[Chain, Array], Array]:
            chain, done = carry
            chain = step(chain, thrust, self.physics)
            done |= reached(chain, state.target)
            return (chain, done), jnp.where(done, 0.0, distances(chain, state.target).log + 0.5)

        start = (state.chain, jnp.zeros((), bool))
        (_, _), costs = jax.lax.scan(swim, start, self._thrusts(knots)[:-1])
        return costs.sum() + self.late * costs[-1]
