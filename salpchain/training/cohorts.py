"""Episodes counted by when they began, so that success is told of all of them, not of the short.

An episode that succeeds ends early and one that fails lasts to the time limit. Whoever counts the
episodes that ended in some rollouts therefore sees successes first: in the first time limit of a
run, successes alone. Here the episodes that began in one rollout are one cohort, and a cohort
counts when its last episode has ended, which is known beforehand: a time limit later.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from salpchain.devices import AXIS
from salpchain.training.rollout import Outcome


class Tally(eqx.Module):
    """Sums over some episodes, by training length."""

    episodes: Float[Array, "*age length"]
    goals: Float[Array, "*age length"]  # of these, reached
    closed: Float[Array, "*age length"]  # of their closed fractions
    lasted: Float[Array, "*age length"]  # control steps
    returns: Float[Array, "*age length"]  # by the paper's reward: distance closed (m) + goal


def lag(step_limit: int, rollout: int) -> int:
    """Rollouts after its own until the last episode of a cohort has ended for certain."""
    return (step_limit + rollout - 2) // rollout


def no_cohorts(step_limit: int, rollout: int, lengths: int) -> Tally:
    """Open cohorts before the first rollout, by age in rollouts."""
    zeros = jnp.zeros((lag(step_limit, rollout) + 1, lengths))
    return Tally(*(zeros,) * 5)


def count(cohorts: Tally, outcomes: Outcome, lengths: tuple[int, ...]) -> tuple[Tally, Tally]:
    """The open cohorts one rollout later, and the oldest of them, which is whole now.

    `outcomes` has axes (step, env). Episodes that started on their targets are left out. Before
    the first cohort is whole, its tally is zero.
    """
    aged = jax.tree.map(lambda x: jnp.roll(x, 1, axis=0).at[0].set(0.0), cohorts)
    ages = aged.episodes.shape[0]
    ended = (outcomes.terminated | outcomes.truncated) & outcomes.is_scored
    age = jnp.clip(_age(outcomes.time), 0, ages - 1)[..., None] == jnp.arange(ages)
    length = outcomes.length[..., None] == jnp.array(lengths)

    def totals(x: Float[Array, "step env"]) -> Float[Array, "age length"]:
        kept = jnp.where(ended, x, 0.0)[..., None] * age
        return jax.lax.psum(jnp.einsum("sea,sel->al", kept, length.astype(x.dtype)), AXIS)

    goal = outcomes.goal.astype(jnp.float32)
    now = Tally(
        episodes=totals(jnp.ones_like(outcomes.closed)),
        goals=totals(goal),
        closed=totals(outcomes.closed),
        lasted=totals(outcomes.time.astype(jnp.float32)),
        returns=totals(outcomes.metres + goal),
    )
    after = jax.tree.map(jnp.add, aged, now)
    return after, jax.tree.map(lambda x: x[-1], after)


def _age(time: Int[Array, "step env"]) -> Int[Array, "step env"]:
    """Rollouts before this one in which the episodes began that stand at these times (steps)."""
    steps = time.shape[0]
    began = jnp.arange(steps)[:, None] + 1 - time  # in steps of this rollout
    return -(began // steps)
