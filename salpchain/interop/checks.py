"""What users of the bridges give, checked: settings, sizes, seeds, actions."""

import secrets
from dataclasses import fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from salpchain.checks import check_seed, one_of
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.starting import check_can_compute
from salpchain.tasks.config import PLAYED_LIMIT, TaskConfig
from salpchain.tasks.registry import config_class, name_of
from salpchain.world.config import WorldConfig
from salpchain.world.randomise import WorldLike, as_world
from salpchain.world.world import World

MOST_ENVS = 1_000_000  # chains that one may ask for (chosen)


def task_of(settings: dict[str, Any]) -> TaskConfig:
    """The task with these settings, by the names of `TaskConfig`; `task` names or is another.

    The time limit is the scaled one unless `time_limit` says otherwise: up to 16 units the paper's.

    Raises:
        InputError: an unknown setting, or an invalid one.
    """
    settings = dict(settings)
    task = name_of(settings.pop("task", TaskConfig.name))
    kind = config_class(task)
    for name in settings:
        one_of(
            "setting of the task",
            name,
            ["task", *(f.name for f in fields(kind) if f.name != "name")],
        )
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in settings.items()}
    return kind(**{"time_limit": PLAYED_LIMIT, "name": task, **plain})


def reach_alone(config: TaskConfig) -> TaskConfig:
    """The settings, if they are of the paper's task.

    Raises:
        InputError: they are of another, which VMAS's own physics cannot play.
    """
    if config.name != TaskConfig.name:
        raise InputError(f"VMAS plays the task {TaskConfig.name} alone, got {config.name}")
    return config


def checked_world(world: WorldLike, length: int) -> World:
    """The world in which chains of this length swim.

    Raises:
        InputError: no world, an unknown name, or thrusters of another number of units.
    """
    if isinstance(world, str | WorldConfig):
        check_can_compute()  # a world to draw from is made with JAX
    made = as_world(world)
    thrusters = () if made.thrusters is None else (made.thrusters.gain, made.thrusters.fails_at)
    for each in thrusters:
        if each is not None and jnp.shape(each) != (length,):
            raise InputError(
                f"the world's thrusters must be those of {length} units, got {told(each)}"
            )
    return made


def checked_envs(num_envs: Any) -> int:
    """The number of chains.

    Raises:
        InputError: not a whole number, or out of range.
    """
    whole = isinstance(num_envs, int | np.integer) and not isinstance(num_envs, bool)
    if not whole or not 1 <= num_envs <= MOST_ENVS:
        raise InputError(f"num_envs must be 1 to {MOST_ENVS:,}, got {num_envs!r}")
    return int(num_envs)


def limit_of(config: TaskConfig, max_steps: int | None) -> int:
    """Control steps until an episode is truncated: `max_steps`, or else those of the task.

    Raises:
        InputError: not a whole number of steps, at least 1.
    """
    if max_steps is None:
        return config.step_limit
    whole = isinstance(max_steps, int | np.integer) and not isinstance(max_steps, bool)
    if not whole or max_steps < 1:
        raise InputError(f"max_steps must be a whole number, at least 1, got {max_steps!r}")
    return int(max_steps)


def checked_seed(seed: Any) -> int:
    """The seed; one by chance for none.

    Raises:
        InputError: not a whole number, or out of range.
    """
    if seed is None:
        return secrets.randbits(32)
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool):
        raise InputError(f"seed must be a whole number, got {seed!r}")
    return check_seed(int(seed))


def check_options(options: dict[str, Any] | None, known: tuple[str, ...]) -> dict[str, Any]:
    """The options of a reset; none are no options.

    Raises:
        InputError: an option that is not known.
    """
    for name in options or {}:
        if name not in known:
            there = ", ".join(known) or "there are none here"
            raise InputError(f"unknown option {name!r} of reset: {there}")
    return options or {}


def checked_actions(action: Any, shape: tuple[int, ...]) -> Any:
    """The actions in JAX's precision, (env, unit, act) or of one chain (unit, act).

    Raises:
        InputError: another shape, not floating point, or not finite (which environment and unit is
            named).
    """
    lib = jnp if isinstance(action, jax.Array) else np  # stays on its device
    try:
        action = lib.asarray(action)
    except ValueError:
        raise InputError(f"actions must have shape {shape}, got rows of unlike lengths") from None
    if not jnp.issubdtype(action.dtype, jnp.floating):
        raise InputError(f"actions must be floating point numbers, got {action.dtype}")
    if action.shape != shape:
        raise InputError(f"actions must have shape {shape}, got {action.shape}")
    action = lib.asarray(action, jax.dtypes.canonicalize_dtype(float))
    if not lib.isfinite(action).all():
        *envs, unit, act = (int(i) for i in np.argwhere(~np.isfinite(np.asarray(action)))[0])
        whose = f"environment {envs[0]}, unit {unit}," if envs else f"unit {unit}"
        raise InputError(
            f"the action of {whose} holds {action[(*envs, unit, act)]}:"
            " actions must be finite; nothing was stepped"
        )
    return action
