"""Reward terms of the task and of its training (paper equations 5 to 8)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.derivatives import root
from salpchain.physics.state import Chain
from salpchain.tasks.config import GOAL_LIMIT
from salpchain.tasks.reach.frechet import within_frechet

FINE_SCALE = 0.05  # m, below which the shaping term tells distances apart (chosen)


def own_progress(
    before: Chain,
    after: Chain,
    target: Float[Array, "unit 2"],
    fine_weight: float,
    scale: float = 1.0,
) -> Float[Array, " unit"]:
    """How much more each unit drew near to its own target point in a step than the mean unit did.

    In units of the reward: approach, and the shaping of each unit, weighted. 0 in dead slots.
    """

    def potential(chain: Chain) -> Float[Array, " unit"]:
        apart = told(root(jnp.sum((target - chain.units.position) ** 2, axis=-1)), scale)
        return apart + fine_weight / 2 * jnp.log1p(apart / FINE_SCALE)

    gained = jnp.where(after.present, potential(before) - potential(after), 0.0)
    return jnp.where(after.present, gained - gained.sum() / after.present.sum(), 0.0)


def told(length: Float[Array, "*shape"], scale: float) -> Float[Array, "*shape"]:
    """A length (m) where links are `scale` times as long as the paper's, as if they were those."""
    return length if scale == 1.0 else length / scale


class Distances(eqx.Module):
    """The potentials whose decrease is rewarded."""

    mean: Float[Array, ""]  # m, of units to their target points (minus equation 5)
    log: Float[Array, ""]  # of distances in `FINE_SCALE`: see `distances`


def distances(chain: Chain, target: Float[Array, "unit 2"], scale: float = 1.0) -> Distances:
    """Mean distance of the present units to their targets, and its log-compressed counterpart.

    The compressed one is half the mean over units of log(1 + distance / scale), which rewards the
    last centimetres of each unit, and half that logarithm of the root mean square distance, which
    counts the farthest most. The first alone leaves long chains half in place, half folded away.
    """
    error = (target - chain.units.position).T
    square = jnp.where(chain.present, error[0] ** 2 + error[1] ** 2, 0.0)
    apart = root(square)
    share = 1.0 / jnp.maximum(chain.present.sum(), 1)
    fine = FINE_SCALE * scale
    each = jnp.sum(jnp.log1p(apart / fine)) * share
    together = jnp.log1p(root(jnp.sum(square) * share) / fine)
    return Distances(jnp.sum(apart) * share, (each + together) / 2)


def reached(
    chain: Chain, target: Float[Array, "unit 2"], tolerance: float = GOAL_LIMIT
) -> Bool[Array, ""]:
    """Whether the chain has taken the target pose: exp(-Frechet distance) >= 0.95.

    `tolerance` (m) is another Frechet distance at which it counts as taken.
    """
    length = chain.present.sum()
    return within_frechet(chain.units.position, target, length, tolerance)


def reward_terms(
    before: Distances, after: Distances, goal: Bool[Array, ""], scale: float = 1.0
) -> dict[str, Float[Array, ""]]:
    """The terms of one step, each before its weight, from the potentials before and after it.

    approach: m, decrease of the mean distance to the target (equation 6), `told` by the scale;
    goal: 1 where the target pose is taken (equation 7); fine: decrease of the log distance (ours,
    an undiscounted potential).
    """
    return {
        "approach": told(before.mean - after.mean, scale),
        "goal": goal.astype(after.mean.dtype),
        "fine": before.log - after.log,
    }
