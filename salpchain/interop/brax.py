"""SCLD as a Brax environment, for Brax's own trainers.

Importing this module gives JAX `device_put_replicated` where it has been removed (JAX 0.10): Brax
0.14's trainers call it.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.errors import InputError
from salpchain.given import instance, told
from salpchain.interop.checks import checked_world, task_of
from salpchain.interop.extras import need
from salpchain.tasks.registry import make_task
from salpchain.tasks.renew import renew_done
from salpchain.tasks.state import State
from salpchain.world.randomise import WorldLike

need("brax", "brax")

from brax.envs import base
from brax.envs.wrappers import training


class SalpBraxEnv(base.Env):
    """One chain: observations (unit x feature,) and actions (unit x act,) in a row.

    Time limits are Brax's: give its trainers `episode_length=env.episode_length` and
    `wrap_env_fn=salpchain.interop.brax.wrap`, so that they are truncations and every episode
    starts elsewhere.

    Raises:
        InputError: an invalid setting of the task.
    """

    def __init__(self, world: WorldLike = None, **task: Any) -> None:
        """The task by the fields of `TaskConfig`, the world as in `SCLD`, e.g. `"rough"`."""
        config = task_of(task)
        self.scld = make_task(config, checked_world(world, config.length))

    def reset(self, rng: PRNGKeyArray) -> base.State:
        """A new episode; `pipeline_state` is ours."""
        if getattr(rng, "dtype", None) == jnp.uint32 and jnp.shape(rng) == (2,):
            rng = jax.random.wrap_key_data(rng)
        return _in_brax(self.scld.reset(rng))

    def step(self, state: base.State, action: Float[Array, " act"]) -> base.State:
        """The episode one control step (0.1 s) later.

        Compiled code cannot refuse NaN: it ends that chain's episode, and the metric `invalid` is
        1.

        Raises:
            InputError: no state of Brax, or an action of another shape.
        """
        right = "a state of Brax, such as reset gives"
        before: Any = instance("state", state, base.State, right).pipeline_state
        given = getattr(action, "shape", told(action))
        if given != (self.action_size,):
            raise InputError(f"action must have shape ({self.action_size},), got {given}")
        new = _in_brax(self.scld.step(before, action.reshape(-1, self.scld.action_size)))
        metrics = {**state.metrics, **new.metrics}  # trainers add some of their own
        return replace(new, metrics=metrics, info=state.info)

    @property
    def episode_length(self) -> int:
        """Control steps until an episode is truncated."""
        return self.scld.config.step_limit

    @property
    def observation_size(self) -> int:
        """Numbers in an observation of the whole chain."""
        return self.scld.config.length * self.scld.observation_size

    @property
    def action_size(self) -> int:
        """Numbers in an action of the whole chain."""
        return self.scld.config.length * self.scld.action_size

    @property
    def backend(self) -> str:
        """The engine: ours."""
        return "salpchain"


def _in_brax(state: State) -> base.State:
    """Done is a true end alone; the time limit is left to Brax's `EpisodeWrapper`."""
    number = state.reward.dtype
    return base.State(
        pipeline_state=state,  # type: ignore[arg-type]
        obs=state.obs.reshape(-1),
        reward=state.reward,
        done=state.terminated.astype(number),
        metrics={
            "distance": state.distances.mean,
            "closed_fraction": state.closed_fraction,
            "goal": state.goal.astype(number),
            "invalid": state.invalid.astype(number),
        },
    )


class Renewing(base.Wrapper):
    """A batch in which a finished episode is followed by a new one with a start of its own.

    `info["final_obs"]` is what the last step led to, before any new episode: where an episode
    ended, its last observation (`obs` is then the first of the next); elsewhere it equals `obs`.
    """

    def reset(self, rng: Array) -> base.State:
        """New episodes, from random keys of either kind (Brax's wrappers know the old one).

        Raises:
            InputError: no keys.
        """
        if rng.shape[0] == 0:
            raise InputError("a batch has at least one chain, got no random keys")
        typed = jnp.issubdtype(rng.dtype, jax.dtypes.prng_key)
        state = self.env.reset(jax.random.key_data(rng) if typed else rng)
        state.info["final_obs"] = state.obs
        return state

    def step(self, state: base.State, action: Float[Array, "env act"]) -> base.State:
        """One control step of every chain; `done` tells whose episode ended in it."""
        steps = jnp.where(state.done, 0, state.info["steps"])
        state.info.update(steps=steps)
        state = self.env.step(replace(state, done=jnp.zeros_like(state.done)), action)
        fresh = self._renewed(state.pipeline_state, state.done > 0)
        obs = fresh.obs.reshape(fresh.obs.shape[0], -1)
        state.info.update(final_obs=state.obs)
        return replace(state, pipeline_state=fresh, obs=obs)

    def _renewed(self, states: Any, done: Array) -> State:
        env: Any = self.unwrapped
        ends = lambda states: (states.terminated, states.truncated)  # noqa: E731
        return renew_done(env.scld, eqx.tree_at(ends, states, (done, done)))


def wrap(
    env: base.Env, episode_length: int, action_repeat: int = 1, randomization_fn: Any = None
) -> base.Wrapper:
    """The batch that Brax's trainers step: episodes with a time limit, renewed as ours are.

    Raises:
        InputError: a randomisation, which Brax applies to its own systems only.
    """
    if randomization_fn is not None:
        raise InputError("randomization_fn changes a Brax system, and this environment has none")
    return Renewing(
        training.EpisodeWrapper(training.VmapWrapper(env), episode_length, action_repeat)
    )


def _put_replicated(tree: Any, devices: list[Any]) -> Any:
    """The tree with a leading axis of devices, a copy on each: what JAX's function did."""
    spread = NamedSharding(Mesh(np.array(devices), ("device",)), PartitionSpec("device"))

    def put(leaf: Any) -> Array:
        copies = jnp.broadcast_to(leaf, (len(devices), *jnp.shape(leaf)))
        return jax.device_put(copies, spread)

    return jax.tree.map(put, tree)


if not hasattr(jax, "device_put_replicated"):
    jax.device_put_replicated = _put_replicated  # type: ignore[attr-defined]
