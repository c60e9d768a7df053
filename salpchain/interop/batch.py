"""A batch of chains stepped by one compiled program: what the bridges to Python tools drive."""

import functools
import secrets
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from salpchain.domain.config import TaskConfig, check_seed, one_of
from salpchain.domain.scld import SCLD, State, renew_done
from salpchain.errors import InputError

MOST_ENVS = 1_000_000  # chains that one may ask for (chosen)


class Outcome(eqx.Module):
    """What a step gave each chain; `obs` is of the new episode where one was begun."""

    obs: Float[Array, "env unit feature"]
    reward: Float[Array, " env"]
    terminated: Bool[Array, " env"]
    truncated: Bool[Array, " env"]  # out of time, and not terminated
    final_obs: Float[Array, "env unit feature"]  # before any new episode
    distance: Float[Array, " env"]  # m, mean over units to their target points
    closed_fraction: Float[Array, " env"]
    goal: Bool[Array, " env"]
    time: Int[Array, " env"]  # control steps since the start of the episode


class Programs(NamedTuple):
    """Compiled once for each config and number of chains; batch first."""

    reset: Callable[[Array], State]  # of (env,) keys
    step: Callable[[State, Any], tuple[State, Outcome]]  # finished episodes renewed
    advance: Callable[[State, Any], tuple[State, Outcome]]  # the same, none renewed
    renew: Callable[[State, Any], State]  # new episodes where (env,) flags say so


@functools.cache
def programs(config: TaskConfig) -> Programs:
    """The compiled programs of this task; the same ones for equal configs."""
    env = SCLD(config)

    def advance(states: State, action: Array) -> tuple[State, Outcome]:
        after = jax.vmap(env.step)(states, action)
        return after, _outcome(after, after)

    def step(states: State, action: Array) -> tuple[State, Outcome]:
        after = jax.vmap(env.step)(states, action)
        renewed = renew_done(env, after)
        return renewed, _outcome(after, renewed)

    def renew(states: State, flags: Array) -> State:
        asked = _with_ends(states, flags, jnp.zeros_like(flags))
        fresh = renew_done(env, asked)
        return _with_ends(fresh, states.terminated & ~flags, states.truncated & ~flags)

    reset = jax.vmap(lambda key: env.reset(key))
    return Programs(*map(jax.jit, (reset, step, advance, renew)))


def _with_ends(states: State, terminated: Array, truncated: Array) -> State:
    where = lambda s: (s.terminated, s.truncated)  # noqa: E731
    return eqx.tree_at(where, states, (terminated, truncated))


def _outcome(after: State, renewed: State) -> Outcome:
    return Outcome(
        obs=renewed.obs,
        reward=after.reward,
        terminated=after.terminated,
        truncated=after.truncated & ~after.terminated,
        final_obs=after.obs,
        distance=after.distances.mean,
        closed_fraction=after.closed_fraction,
        goal=after.goal,
        time=after.time,
    )


class Batch:
    """`num_envs` chains that are reset and stepped together.

    Raises:
        InputError: a number of chains that cannot be.
    """

    def __init__(self, config: TaskConfig, num_envs: int = 1, renew: bool = True) -> None:
        """With `renew`, a finished episode is followed by a new one in the same step."""
        whole = isinstance(num_envs, int) and not isinstance(num_envs, bool)
        if not whole or not 1 <= num_envs <= MOST_ENVS:
            raise InputError(f"num_envs must be 1 to {MOST_ENVS:,}, got {num_envs!r}")
        self.config, self.num_envs = config, num_envs
        self.env = SCLD(config)
        self.states: State | None = None
        self._programs = programs(config)
        self._step = self._programs.step if renew else self._programs.advance

    @property
    def observation_shape(self) -> tuple[int, int]:
        """(unit, feature), of one chain."""
        return self.config.length, self.env.observation_size

    @property
    def action_shape(self) -> tuple[int, int]:
        """(unit, act), of one chain."""
        return self.config.length, self.env.action_size

    def reset(self, seed: int | Sequence[int] | None = None) -> Float[Array, "env unit feature"]:
        """Observations of new episodes of all chains; the same seed gives the same episodes.

        With one seed, chain i starts from seed + i; without any, from where its episodes have
        led, or by chance if it had none.

        Raises:
            InputError: a seed that cannot be, or not one for each chain.
        """
        if seed is None and self.states is not None:
            keys = self.states.key
        else:
            keys = jax.vmap(jr.key)(self._seeds(seed))
        self.states = self._programs.reset(keys)
        return self.states.obs

    def _seeds(self, seed: int | Sequence[int] | None) -> np.ndarray:
        first = secrets.randbits(32) if seed is None else seed
        if isinstance(first, Sequence):
            if len(first) != self.num_envs:
                raise InputError(f"seeds must be {self.num_envs}, got {len(first)}")
            return np.array([_seed(each) for each in first], np.uint32)
        return ((_seed(first) + np.arange(self.num_envs)) % 2**32).astype(np.uint32)

    def reset_some(self, flags: Bool[Any, " env"]) -> Float[Array, "env unit feature"]:
        """Observations, after new episodes of the flagged chains alone.

        Raises:
            InputError: never reset before, or flags that are not one boolean for each chain.
        """
        states = self.started()
        flags = np.asarray(flags)
        if flags.shape != (self.num_envs,) or flags.dtype != bool:
            raise InputError(
                f"reset flags must be {self.num_envs} booleans, got {flags.dtype} of shape"
                f" {flags.shape}"
            )
        self.states = self._programs.renew(states, flags)
        return self.states.obs

    def step(self, action: Any) -> Outcome:
        """What one control step (0.1 s) gives; the states are untouched where it is refused.

        Args:
            action: (env, unit, act), NumPy or JAX, in [-1, 1] (clipped).

        Raises:
            InputError: before the first reset; an action of a wrong shape or type, or not finite.
        """
        states = self.started()
        action = checked_actions(action, (self.num_envs, *self.action_shape))
        self.states, outcome = self._step(states, action)
        return outcome

    def started(self) -> State:
        """The states.

        Raises:
            InputError: there are none yet.
        """
        if self.states is None:
            raise InputError("the environment was never reset: call reset() before step()")
        return self.states


def task_of(settings: dict[str, Any]) -> TaskConfig:
    """The task with these settings, by the names of `TaskConfig`.

    Raises:
        InputError: an unknown setting, or one that cannot be.
    """
    for name in settings:
        one_of("setting of the task", name, [field.name for field in fields(TaskConfig)])
    return TaskConfig(**settings)


def _seed(seed: Any) -> int:
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool):
        raise InputError(f"seed must be a whole number, got {seed!r}")
    return check_seed(int(seed))


def checked_actions(action: Any, shape: tuple[int, ...]) -> Any:
    """The actions as float32, environments first.

    Raises:
        InputError: another shape, not floating point, or not finite (which environment is named).
    """
    lib = jnp if isinstance(action, jax.Array) else np  # stays on its device
    action = lib.asarray(action)
    if not jnp.issubdtype(action.dtype, jnp.floating):
        raise InputError(f"actions must be floating point numbers, got {action.dtype}")
    if action.shape != shape:
        raise InputError(f"actions must have shape {shape}, got {action.shape}")
    action = lib.asarray(action, np.float32)
    if not lib.isfinite(action).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(np.asarray(action)))[0])
        raise InputError(
            f"the action of environment {index[0]} holds {action[index]} (unit {index[1]}):"
            " actions must be finite; nothing was stepped"
        )
    return action
