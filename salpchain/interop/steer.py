"""Our controllers in other tools' loops: from observations to actions, both NumPy."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from salpchain.control.policy import Policy
from salpchain.errors import InputError
from salpchain.interop.batch import task_of

Steer = Callable[[np.ndarray], np.ndarray]


def steering(policy: Policy, **task: Any) -> Steer:
    """What maps observations (..., unit, feature) to mean actions (..., unit, act), clipped.

    Args:
        policy: as `salpchain.load` gives it.
        **task: the settings that the environment was made with.

    Raises:
        InputError: the policy observes or acts in another way than the environment, or cannot
            serve its length; an unknown setting.
    """
    config, card = task_of(task), policy.card
    for what in ("observation", "action"):
        ours, theirs = getattr(card, what), getattr(config, what)
        if ours != theirs:
            raise InputError(
                f"{card.name} speaks the {what} {ours!r}, the environment {theirs!r}: make it with"
                f" {what}={ours!r}"
            )
    card.check_serves(config.length)
    present, joined = jnp.ones(config.length, bool), jnp.ones(config.length - 1, bool)

    @jax.jit
    def act(rows: jax.Array) -> jax.Array:
        actions = jax.vmap(lambda obs: policy.network.act(obs, present, joined))(rows)
        return jnp.clip(actions, -1.0, 1.0)

    def steer(obs: np.ndarray) -> np.ndarray:
        obs = np.asarray(obs, np.float32)
        actions = np.array(act(obs.reshape(-1, *obs.shape[-2:])))
        return actions.reshape(*obs.shape[:-1], -1)

    return steer
