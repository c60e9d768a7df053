"""The one loop that plays episodes: controllers act, the task steps, what has ended stays."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from salpchain.controllers.policy import Controller, act, begin
from salpchain.physics.batching import where
from salpchain.tasks.state import State
from salpchain.tasks.task import Task

Memories = tuple[Any, ...]  # what each controller remembers


@runtime_checkable
class Episode(Protocol):
    """A pytree of what is known of an episode so far: its state and what is kept of the way."""

    @property
    def state(self) -> State:
        """As it is now."""
        ...


Kind = TypeVar("Kind", bound=Episode)


@eqx.filter_jit
def remember(controllers: Sequence[Controller], states: State) -> Memories:
    """What each controller remembers before its first step, for states (start, controller)."""
    own = [_own(states, i, axis=1) for i in range(len(controllers))]
    return tuple(
        jax.vmap(partial(begin, one))(states) for one, states in zip(controllers, own, strict=True)
    )


def play(
    step: Callable[[Kind, Any], tuple[Kind, Any]],
    episodes: Kind,
    memories: Any,
    until: Int[Array, ""],
) -> tuple[Kind, Any]:
    """The episodes, start first, after control step `until`, or as they ended.

    `step` makes one control step from one start: `alone` or `abreast`.
    """

    def going(now: tuple[Kind, Any]) -> Bool[Array, ""]:
        return (~now[0].state.done & (now[0].state.time < until)).any()

    def advance(now: tuple[Kind, Any]) -> tuple[Kind, Any]:
        after, memories = jax.vmap(step)(*now)
        return where(now[0].state.done, now[0], after), memories

    return jax.lax.while_loop(going, advance, (episodes, memories))


def alone(
    env: Task,
    controller: Controller,
    follow: Callable[[Kind, State], Kind],
    episode: Kind,
    own: Any,
) -> tuple[Kind, Any]:
    """One control step of an episode of one controller, and what it remembers then.

    `follow` gives the episode after its step to a state.
    """
    action, own = act(controller, episode.state, own)
    return follow(episode, env.step(episode.state, action)), own


def abreast(
    env: Task,
    controllers: Sequence[Controller],
    follow: Callable[[Kind, State], Kind],
    episodes: Kind,
    memories: Memories,
) -> tuple[Kind, Memories]:
    """`alone` for several controllers, each in an episode of its own (first axis)."""
    own = [_own(episodes.state, i) for i in range(len(controllers))]
    acted = [act(*each) for each in zip(controllers, own, memories, strict=True)]
    states = jax.vmap(env.step)(episodes.state, jnp.stack([action for action, _ in acted]))
    return jax.vmap(follow)(episodes, states), tuple(memory for _, memory in acted)


def _own(states: State, controller: int, axis: int = 0) -> State:
    """The states of one controller."""
    return jax.tree.map(lambda x: x[(slice(None),) * axis + (controller,)], states)
