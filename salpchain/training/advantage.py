"""Generalised advantage estimation (Schulman et al. 2016), time limits bootstrapped."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def next_values(
    value: Float[Array, "step env"],
    last_value: Float[Array, " env"],
    final_value: Float[Array, "step env"],
    truncated: Bool[Array, "step env"],
) -> Float[Array, "step env"]:
    """Value of what truly came next: of the last observation of an episode out of time, else of
    the next step's."""
    following = jnp.concatenate([value[1:], last_value[None]])
    return jnp.where(truncated, final_value, following)


def advantages(
    reward: Float[Array, "step env"],
    value: Float[Array, "step env"],
    next_value: Float[Array, "step env"],
    terminated: Bool[Array, "step env"],
    truncated: Bool[Array, "step env"],
    gamma: float,
    lam: float,
) -> Float[Array, "step env"]:
    """Advantage of each step: a terminated episode is worth nothing more, a truncated one is."""
    alive = 1.0 - terminated
    going = 1.0 - (terminated | truncated)
    delta = reward + gamma * alive * next_value - value

    def back(tail: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        delta, going = now
        tail = delta + gamma * lam * going * tail
        return tail, tail

    start = jnp.zeros_like(delta[0])
    return jax.lax.scan(back, start, (delta, going), reverse=True)[1]
