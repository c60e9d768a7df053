"""A batch of chains stepped by one compiled program: what the bridges to Python tools drive."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.interop.checks import (
    checked_actions,
    checked_envs,
    checked_seed,
    checked_world,
    limit_of,
)
from salpchain.starting import check_can_compute
from salpchain.tasks.config import ACTION_SIZES, TaskConfig
from salpchain.tasks.features import observation_size
from salpchain.tasks.registry import make_task
from salpchain.tasks.renew import renew_done
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from salpchain.world.randomise import WorldLike

Seeds = int | Sequence[int | None] | np.ndarray | None


class Outcome(eqx.Module):
    """What a step gave each chain; `obs` is of the new episode where one was begun.

    Observations are float32, whatever JAX's precision.
    """

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
    """Compiled once for each task, world and number of chains; batch first."""

    reset: Callable[[Array], State]  # of (env,) keys
    step: Callable[[State, Any], tuple[State, Outcome]]  # finished episodes renewed
    advance: Callable[[State, Any], tuple[State, Outcome]]  # the same, none renewed
    renew: Callable[[State, Any], State]  # new episodes where (env,) flags say so
    step_or_renew: Callable[[State, Any, Any], tuple[State, Outcome]]  # renew where flags say so


_made: dict[Any, Programs] = {}  # by task, world and time limit


def programs(env: Task, limit: int) -> Programs:
    """The compiled programs of this task with this time limit; the same ones for equal ones."""
    leaves, tree = jax.tree.flatten(env)
    numbers = [np.asarray(leaf) for leaf in leaves]
    key = tree, limit, tuple((x.shape, x.dtype, x.tobytes()) for x in numbers)
    if key not in _made:
        _made[key] = _made_for(env, limit)
    return _made[key]


def _made_for(env: Task, limit: int) -> Programs:
    def stepped(states: State, action: Array) -> State:
        after = jax.vmap(env.step)(states, action)
        return eqx.tree_at(lambda s: s.truncated, after, after.time >= limit)

    def advance(states: State, action: Array) -> tuple[State, Outcome]:
        after = stepped(states, action)
        return after, _outcome(after, after)

    def step(states: State, action: Array) -> tuple[State, Outcome]:
        after = stepped(states, action)
        renewed = renew_done(env, after)
        return renewed, _outcome(after, renewed)

    def renew(states: State, flags: Array) -> State:
        asked = _with_ends(states, flags, jnp.zeros_like(flags))
        fresh = renew_done(env, asked)
        return _with_ends(fresh, states.terminated & ~flags, states.truncated & ~flags)

    def step_or_renew(states: State, action: Array, flags: Array) -> tuple[State, Outcome]:
        after = stepped(states, action)
        renewed = renew(after, flags)
        return renewed, _outcome(after, renewed)

    reset = jax.vmap(lambda key: env.reset(key))
    return Programs(*map(jax.jit, (reset, step, advance, renew, step_or_renew)))


def _with_ends(states: State, terminated: Array, truncated: Array) -> State:
    where = lambda s: (s.terminated, s.truncated)  # noqa: E731
    return eqx.tree_at(where, states, (terminated, truncated))


def _outcome(after: State, renewed: State) -> Outcome:
    return Outcome(
        obs=renewed.obs.astype(jnp.float32),
        reward=after.reward,
        terminated=after.terminated,
        truncated=after.truncated & ~after.terminated,
        final_obs=after.obs.astype(jnp.float32),
        distance=after.distances.mean,
        closed_fraction=after.closed_fraction,
        goal=after.goal,
        time=after.time,
    )


class Batch:
    """`num_envs` chains that are reset and stepped together.

    It can be copied and pickled, episodes and all.

    Raises:
        InputError: an invalid number of chains or time limit.
    """

    def __init__(
        self,
        config: TaskConfig,
        num_envs: int = 1,
        renew: bool = True,
        max_steps: int | None = None,
        world: WorldLike = None,
    ) -> None:
        """With `renew`, a finished episode is followed by a new one in the same step.

        Episodes are truncated after `max_steps`, or earlier where the task's own limit is shorter.
        The world is as in `SCLD`.
        """
        self.config, self.num_envs, self.renew = config, checked_envs(num_envs), renew
        self.limit = min(limit_of(config, max_steps), config.step_limit)
        self.env = make_task(config, checked_world(world, config.length))
        self.states: State | None = None

    @cached_property
    def _programs(self) -> Programs:
        return programs(self.env, self.limit)

    def __getstate__(self) -> dict[str, Any]:
        """Everything as plain values: random keys as their numbers."""
        plain = {name: value for name, value in vars(self).items() if name != "_programs"}
        if self.states is not None:
            states = eqx.tree_at(lambda s: s.key, self.states, jr.key_data(self.states.key))
            plain["states"] = jax.tree.map(np.asarray, states)
        return plain

    def __setstate__(self, plain: dict[str, Any]) -> None:
        """The batch that `__getstate__` told of."""
        vars(self).update(plain)
        if self.states is not None:
            states = jax.tree.map(jnp.asarray, self.states)
            self.states = eqx.tree_at(lambda s: s.key, states, jr.wrap_key_data(states.key))

    @property
    def observation_shape(self) -> tuple[int, int]:
        """(unit, feature), of one chain."""
        return self.config.length, observation_size(self.config.observation)

    @property
    def action_shape(self) -> tuple[int, int]:
        """(unit, act), of one chain."""
        return self.config.length, ACTION_SIZES[self.config.action]

    def reset(self, seed: Seeds = None) -> Float[Array, "env unit feature"]:
        """Observations of new episodes of all chains; the same seed gives the same episodes.

        With one seed, chain i starts from seed + i; without any, from where its episodes have
        led, or by chance if it had none. Of a list of seeds, one that is None is drawn by chance.

        Raises:
            InputError: an invalid seed, or not one for each chain.
        """
        check_can_compute()
        if seed is None and self.states is not None:
            keys = self.states.key
        else:
            keys = jax.vmap(jr.key)(self._seeds(seed))
        self.states = self._programs.reset(keys)
        return self.states.obs.astype(jnp.float32)

    def check_seeds(self, seed: Seeds) -> None:
        """Raise InputError for seeds that `reset` would not take."""
        self._seeds(seed)

    def _seeds(self, seed: Seeds) -> np.ndarray:
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
            if getattr(seed, "ndim", 1) != 1 or len(seed) != self.num_envs:
                raise InputError(f"seeds must be {self.num_envs}, one for each, got {told(seed)}")
            return np.array([checked_seed(each) for each in seed], np.uint32)
        return ((checked_seed(seed) + np.arange(self.num_envs)) % 2**32).astype(np.uint32)

    def reset_some(self, flags: Any, seed: Seeds = None) -> Float[Array, "env unit feature"]:
        """Observations, after new episodes of the flagged chains alone; seeds as in `reset`.

        Args:
            flags: (env,) of bool.
            seed: for every chain, flagged or not.

        Raises:
            InputError: never reset before, flags that are not one boolean for each chain, or a seed
                that cannot be.
        """
        states = self.started()
        flags = np.asarray(flags)
        if flags.shape != (self.num_envs,) or flags.dtype != bool:
            raise InputError(
                f"reset flags must be {self.num_envs} booleans, got {flags.dtype} of shape"
                f" {flags.shape}"
            )
        if seed is not None:
            keys = jax.vmap(jr.key)(self._seeds(seed))
            states = eqx.tree_at(lambda s: s.key, states, jnp.where(flags, keys, states.key))
        self.states = self._programs.renew(states, flags)
        return self.states.obs.astype(jnp.float32)

    def step(self, action: Any) -> Outcome:
        """What one control step (0.1 s) gives; the states are untouched where it is refused.

        Args:
            action: (env, unit, act), NumPy or JAX, in [-1, 1] (clipped).

        Raises:
            InputError: before the first reset; an action of a wrong shape or type, or not finite.
        """
        states = self.started()
        action = checked_actions(action, (self.num_envs, *self.action_shape))
        return self._stepped(states, action)

    def step_or_renew(self, action: Any, flags: np.ndarray) -> Outcome:
        """`step` without renewal, but a new episode for the flagged chains instead of a step.

        Raises:
            As `step`.
        """
        states = self.started()
        action = checked_actions(action, (self.num_envs, *self.action_shape))
        self.states, outcome = self._programs.step_or_renew(states, action, flags)
        return outcome

    def step_one(self, action: Any) -> Outcome:
        """The same for a batch of one, whose action has no axis of environments: (unit, act)."""
        states = self.started()
        return self._stepped(states, checked_actions(action, self.action_shape)[None])

    def _stepped(self, states: State, action: Any) -> Outcome:
        step = self._programs.step if self.renew else self._programs.advance
        self.states, outcome = step(states, action)
        return outcome

    def one(self, index: int) -> State:
        """The state of one chain, in which its world is whole: for pictures.

        Raises:
            InputError: there is none yet.
        """
        state = jax.tree.map(lambda leaf: leaf[index], self.started())
        return eqx.tree_at(lambda s: s.world, state, self.env.world_of(state))

    def started(self) -> State:
        """The states.

        Raises:
            InputError: there are none yet.
        """
        check_can_compute()
        if self.states is None:
            raise InputError("the environment was never reset: call reset() first")
        return self.states
