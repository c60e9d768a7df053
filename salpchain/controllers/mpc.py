"""Model-predictive control by sampling, a slow yardstick for short chains.

How it compares: docs/any-length-results.md.

Random search with elites, as in the cross-entropy method (Rubinstein 1999; de Boer et al. 2005),
but with spreads that shrink by a fixed factor. Smooth changes of the thrusts planned so far are
tried on the engine itself, anew at every control step, warm-started from the step before.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.controllers.greedy import as_action
from salpchain.controllers.named import controller
from salpchain.controllers.policy import Controller, PolicyCard
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.given import instance, is_scalar, told, whole
from salpchain.physics.state import Chain, Physics
from salpchain.switches import standard_promotion
from salpchain.tasks.checks import check_state
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.reward import distances, reached
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from salpchain.world.world import World

PLAN_STREAM = 2  # sets a planner's random numbers apart from those of the episode (chosen)
AWAY = 0.5  # cost of each control step before the goal, beside the log distance (chosen)
NEAR = 0.35  # N, of the first changes to what a guide would do (chosen)


class Plan(NamedTuple):
    """What a planner carries from one control step to the next."""

    thrusts: Float[Array, "time unit"]  # N, at each control step of the horizon
    key: PRNGKeyArray


class MPC(eqx.Module):
    """Thrusts that take the chain to its target soon: many are tried, the best refined.

    In each round `samples` plans near the best so far swim over the horizon; they differ from it by
    thrusts that are piecewise linear in time. The mean of the `elites` best is the next round's
    middle. It knows the physics and the whole state, which a robot's controller does not. The best
    found is not the best there is: from 3 units on a trained policy is sooner at its target. With a
    guide, what that would do from here is a plan too, and taken where it is better than the last
    one: see `guided`.
    """

    physics: Physics = eqx.field(default_factory=Physics)
    guide: Controller | None = None  # speaks the same observation and action
    observation: str = eqx.field(static=True, default="body")
    action: str = eqx.field(static=True, default="thrust")
    samples: int = eqx.field(static=True, default=256)  # plans in a round (chosen)
    elites: int = eqx.field(static=True, default=4)  # sooner there than 16, from 3 units on
    rounds: int = eqx.field(static=True, default=3)
    knots: int = eqx.field(static=True, default=11)
    every: int = eqx.field(static=True, default=6)  # control steps between knots
    noise: float = 0.7  # N, of a knot in the first round
    shrink: float = 0.5  # of the noise from round to round
    late: float = 6.0  # weight of where a plan ends, in control steps

    def __check_init__(self) -> None:
        _ = self.card  # is refused with an unknown observation or action
        instance("physics", self.physics, Physics, "a Physics")
        if self.guide is not None:
            controller(self.guide)
        for name, least in {"samples": 1, "elites": 1, "rounds": 0, "knots": 2, "every": 1}.items():
            whole(name, getattr(self, name), least)
        for name in ("noise", "shrink", "late"):
            if not is_scalar(getattr(self, name)):
                raise InputError(f"{name} must be a number, got {told(getattr(self, name))}")

    @property
    def card(self) -> PolicyCard:
        """Works at any length; was never trained."""
        return PolicyCard(name="mpc", observation=self.observation, action=self.action)

    @classmethod
    def guided(cls, guide: Controller | StrPath) -> "MPC":
        """The planner that looks for something better near what the guide would do.

        Never seen slower than the guide, and the nearest to an oracle for short chains that there
        is here; it takes the single best plan of each round, and starts with smaller changes.
        """
        guide = controller(guide)
        card = guide.card
        return cls(
            guide=guide, observation=card.observation, action=card.action, elites=1, noise=NEAR
        )

    @property
    def horizon(self) -> int:
        """Control steps that a plan looks ahead."""
        return (self.knots - 1) * self.every

    @standard_promotion
    def begin(self, state: State) -> Plan:
        """A plan before the first step: no thrust."""
        check_state(state, "begin")
        nothing = jnp.zeros((self.horizon, state.thrust.shape[0]))
        return Plan(nothing, jr.fold_in(state.key, PLAN_STREAM))

    @standard_promotion
    def plan(self, state: State, plan: Plan) -> tuple[Float[Array, "unit act"], Plan]:
        """The first thrusts of the best plan found, and that plan one control step later."""
        check_state(state, "plan")
        instance("plan", plan, Plan, "what begin or plan gave")
        next_key, *keys = jr.split(plan.key, self.rounds + 1)
        best = plan.thrusts
        if self.guide is not None:
            other = self._guided(self.guide, state)
            best = jnp.where(self._cost(state, other) < self._cost(state, best), other, best)
        for number, key in enumerate(keys):
            best = self._refine(state, best, self.noise * self.shrink**number, key)
        later = jnp.concatenate([best[1:], best[-1:]])
        return as_action(best[0], self.action), Plan(later, next_key)

    def act(self, state: State) -> Float[Array, "unit act"]:
        """The first thrusts of a plan made from nothing."""
        return self.plan(state, self.begin(state))[0]

    def _guided(self, guide: Controller, state: State) -> Float[Array, "time unit"]:
        """What the guide would do over the horizon."""
        task = TaskConfig(state.thrust.shape[0], self.observation, self.action)
        env = SCLD(task, self.physics)

        def swim(state: State, _: None) -> tuple[State, Array]:
            after = env.step(state, guide.act(state))
            return after, after.thrust

        return jax.lax.scan(swim, state, length=self.horizon)[1]

    def _refine(
        self, state: State, best: Float[Array, "time unit"], noise: float, key: PRNGKeyArray
    ) -> Float[Array, "time unit"]:
        """The mean of the best plans near this one, itself among those tried."""
        change = noise * jr.normal(key, (self.samples, self.knots, best.shape[1]))
        smooth = jax.vmap(self._between)(change.at[0].set(0.0))
        tried = jnp.clip(best + smooth, -1.0, 1.0)
        cost = jax.vmap(lambda one: self._cost(state, one))(tried)
        return tried[jnp.argsort(cost)[: self.elites]].mean(axis=0)

    def _between(self, knots: Float[Array, "knot unit"]) -> Float[Array, "time unit"]:
        """Thrusts at every control step of the horizon, linear from knot to knot."""
        time = jnp.arange(self.horizon) / self.every
        left = jnp.minimum(time.astype(int), self.knots - 2)
        part = (time - left)[:, None]
        return (1 - part) * knots[left] + part * knots[left + 1]

    def _cost(self, state: State, thrusts: Float[Array, "time unit"]) -> Float[Array, ""]:
        """Log distance (see `reward.distances`) and `AWAY`, summed over the steps before the goal.

        What it is at the horizon counts `late` times more.
        """

        def swim(carry: tuple[Chain, Array], thrust: Array) -> tuple[tuple[Chain, Array], Array]:
            chain, done = carry
            chain = World(self.physics).step(chain, thrust)
            done |= reached(chain, state.target)
            return (chain, done), jnp.where(done, 0.0, distances(chain, state.target).log + AWAY)

        start = (state.seen, jnp.zeros((), bool))
        (_, _), costs = jax.lax.scan(swim, start, thrusts)
        return costs.sum() + self.late * costs[-1]
