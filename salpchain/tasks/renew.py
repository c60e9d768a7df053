"""New episodes in the place of finished ones, in a batch."""

from collections.abc import Callable
from functools import partial

import jax
import jax.random as jr
from jaxtyping import Array, Int, PRNGKeyArray

from salpchain.errors import InputError
from salpchain.given import function, instance
from salpchain.physics.batching import redo
from salpchain.switches import automatic, standard_promotion
from salpchain.tasks.state import State
from salpchain.tasks.task import Task

RENEWED_AT_ONCE = 32  # a chunk of finished episodes is at most this part of the batch (chosen)


LENGTH_STREAM = 1  # makes the random length independent of the random start

DrawLength = Callable[[PRNGKeyArray], Int[Array, ""]]


@standard_promotion
def renew_done(env: Task, states: State, draw_length: DrawLength | None = None) -> State:
    """A batch of states (batch first) with every finished episode replaced by a new one.

    The others stay bit-identical. Only as many resets are computed as there are finished
    episodes, in small chunks; each has its own key, so no start comes twice. `draw_length` gives
    the number of units of a new episode; without it a chain keeps its length.

    Raises:
        InputError: no environment, or no batch of its states.
    """
    instance("env", env, Task, "a task, such as salpchain.SCLD()")
    instance("states", states, State, "a batch of states, such as jax.vmap(env.reset)(keys)")
    function("draw_length", draw_length)
    if states.obs.ndim != 3 or states.obs.shape[1] != env.config.length:
        raise InputError(
            f"renew_done takes a batch of states of {env.config.length} slots, batch first, such as"
            f" jax.vmap(env.reset)(keys), got observations of shape {states.obs.shape}"
        )
    return automatic(partial(_renewed, env, draw_length), (states,))


def _renewed(env: Task, draw_length: DrawLength | None, states: State) -> State:
    batch = states.time.shape[0]

    def renew(chosen: Int[Array, " some"]) -> State:
        keys = states.key[chosen]
        if draw_length is None:
            return jax.vmap(env.reset)(keys, states.length[chosen])
        apart = jax.vmap(lambda key: jr.fold_in(key, LENGTH_STREAM))(keys)
        return jax.vmap(env.reset)(keys, jax.vmap(draw_length)(apart))

    return redo(states.done, states, renew, min(batch, max(4, batch // RENEWED_AT_ONCE)))
