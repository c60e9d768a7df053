"""Our controllers in other tools' loops: from observations to actions, both NumPy."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from salpchain.controllers import named
from salpchain.controllers.policy import Controller, Policy, PolicyCard
from salpchain.controllers.steering import as_floats
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.given import told
from salpchain.interop.checks import checked_world, task_of
from salpchain.starting import check_can_compute
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import observation_size
from salpchain.world.randomise import WorldLike

Steer = Callable[[np.ndarray], np.ndarray]


def steering(policy: Controller | StrPath, world: WorldLike = None, **task: Any) -> Steer:
    """What maps observations (..., unit, feature) to mean actions (..., unit, act), clipped.

    Args:
        policy: a learned one, such as `salpchain.load("any-length")`, or its name or path.
        world: that of the environment; a policy steers in all alike.
        **task: the settings that the environment was made with.

    Raises:
        InputError: no learned policy, or one that observes or acts in another way than the
            environment or cannot serve its length; an unknown setting or world. Later: observations
            of another shape.
    """
    learned = named.controller(policy)
    if not isinstance(learned, Policy):
        raise InputError(f"steering takes a learned policy, such as any-length, got {told(policy)}")
    config = task_of(task)
    checked_world(world, config.length)
    _check_fits(learned.card, config)
    slots, features = config.length, observation_size(config.observation)
    present, joined = jnp.ones(slots, bool), jnp.ones(slots - 1, bool)

    @jax.jit
    def act(rows: jax.Array) -> jax.Array:
        actions = jax.vmap(lambda obs: learned.network.act(obs, present, joined))(rows)
        return jnp.clip(actions, -1.0, 1.0)

    def steer(obs: np.ndarray) -> np.ndarray:
        check_can_compute()
        obs = as_floats("observations", obs).astype(np.float32)
        if obs.shape[-2:] != (slots, features):
            raise InputError(
                f"observations must have shape (..., {slots}, {features}), got {obs.shape}"
            )
        actions = np.array(act(obs.reshape(math.prod(obs.shape[:-2]), slots, features)))
        return actions.reshape(*obs.shape[:-1], actions.shape[-1])

    return steer


def _check_fits(card: PolicyCard, config: TaskConfig) -> None:
    for what in ("observation", "action"):
        ours, theirs = getattr(card, what), getattr(config, what)
        if ours != theirs:
            raise InputError(
                f"{card.name} speaks the {what} {ours!r}, the environment {theirs!r}: make it with"
                f" {what}={ours!r}"
            )
    card.check_serves(config.length)
