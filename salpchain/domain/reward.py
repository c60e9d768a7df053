"""Reward terms of the task and of its training (paper equations 5 to 8)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.domain.frechet import within_frechet
from salpchain.physics.chain import Chain

GOAL_LIMIT = 0.05129329438755058  # m, where exp(-Frechet distance) = 0.95 (paper equation 7)
FINE_SCALE = 0.05  # m, below which the shaping term tells distances apart (chosen)


class Terms(eqx.Module):
    """What a step is rewarded for, each before its weight."""

    approach: Float[Array, ""]  # m, decrease of the mean distance to the target (equation 6)
    goal: Float[Array, ""]  # 1 where the target pose is taken (equation 7)
    fine: Float[Array, ""]  # decrease of the mean log distance: ours, potential-based shaping


class Distances(eqx.Module):
    """The potentials whose decrease is rewarded."""

    mean: Float[Array, ""]  # m, of units to their target points (minus equation 5)
    log: Float[Array, ""]  # mean of log(1 + distance / FINE_SCALE)


def distances(chain: Chain, target: Float[Array, "unit 2"]) -> Distances:
    """Mean distance of the present units to their target points, plain and compressed."""
    error = (target - chain.units.position).T
    apart = jnp.sqrt(error[0] ** 2 + error[1] ** 2)
    share = chain.present / jnp.maximum(chain.present.sum(), 1)
    return Distances(jnp.sum(apart * share), jnp.sum(jnp.log1p(apart / FINE_SCALE) * share))


def reached(chain: Chain, target: Float[Array, "unit 2"]) -> Bool[Array, ""]:
    """Whether the chain has taken the target pose: exp(-Frechet distance) >= 0.95."""
    length = chain.present.sum()
    return within_frechet(chain.units.position, target, length, GOAL_LIMIT)


def reward_terms(before: Distances, after: Distances, goal: Bool[Array, ""]) -> Terms:
    """The terms of one step, from the potentials before and after it."""
    return Terms(
        approach=before.mean - after.mean,
        goal=goal.astype(after.mean.dtype),
        fine=before.log - after.log,
    )
