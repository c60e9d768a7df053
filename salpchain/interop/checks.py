"""What users of the bridges give, checked: settings, sizes, seeds, actions."""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from salpchain.checks import check_seed, one_of
from salpchain.errors import InputError
from salpchain.given import index, told, whole
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
        InputError: they are of another, or of links that are cut, which VMAS's own physics cannot
            play.
    """
    if config.action == "grip":
        raise InputError("VMAS cannot cut links: action must be thrust or pair, got grip")
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
    number = index(num_envs)
    if number is None or not 1 <= number <= MOST_ENVS:
        raise InputError(f"num_envs must be 1 to {MOST_ENVS:,}, got {told(num_envs)}")
    return number


def limit_of(config: TaskConfig, max_steps: int | None) -> int:
    """Control steps until an episode is truncated: `max_steps`, or else those of the task.

    Raises:
        InputError: not a whole number of steps, at least 1.
    """
    if max_steps is None:
        return config.step_limit
    return whole("max_steps", max_steps, least=1)


def checked_seed(seed: Any) -> int:
    """The seed; one by chance for none.

    Raises:
        InputError: not a whole number, or out of range.
    """
    if seed is None:
        return secrets.randbits(32)
    return check_seed(seed)


def check_options(options: Mapping[str, Any] | None, known: tuple[str, ...]) -> Mapping[str, Any]:
    """The options of a reset; none are no options.

    Raises:
        InputError: no dict, or an option that is not known.
    """
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"options must be a dict, or None, got {told(options)}")
    for name in options or {}:
        if name not in known:
            there = ", ".join(known) or "there are none here"
            raise InputError(f"unknown option {name!r} of reset: {there}")
    return options or {}


def checked_render_mode(mode: Any, known: Sequence[str]) -> str | None:
    """How pictures are given; None for no pictures.

    Raises:
        InputError: neither None nor a known one.
    """
    if mode is not None:
        one_of("render mode", mode, known)
    return mode


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
