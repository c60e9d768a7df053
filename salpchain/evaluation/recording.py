"""Episodes recorded whole: the trials of an evaluation, with every body at every step."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from salpchain.checks import check_seed
from salpchain.controllers import named
from salpchain.controllers.identity import identity
from salpchain.controllers.policy import Controller, act, begin
from salpchain.evaluation.config import Lengths, as_lengths, lengths_as_text
from salpchain.evaluation.progress import Progress, compiling, telling
from salpchain.evaluation.survey import surroundings
from salpchain.evaluation.trajectory import Trajectory
from salpchain.evaluation.trials import domain_for, start_keys
from salpchain.files import StrPath
from salpchain.given import function, whole
from salpchain.physics.batching import where
from salpchain.physics.state import Bodies
from salpchain.starting import check_can_compute
from salpchain.switches import own_mesh
from salpchain.tasks.config import PLAYED_LIMIT, step_limit
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from salpchain.world.config import WorldConfig
from salpchain.world.presets import as_config, label

AT_ONCE = 64  # control steps in one compiled call, which bounds memory (chosen)


class Frame(NamedTuple):
    """What is kept of one control step."""

    units: Bodies
    links: Bodies
    thrust: Float[Array, "*chain unit"]
    reward: Float[Array, "*chain"]
    gain: Float[Array, "*chain unit"] | None  # of the thrusters, where they may be broken
    current: Any  # the arrays of the water's motion, if it moves


@own_mesh
def record(
    controller: Controller | StrPath,
    lengths: Lengths,
    time_limit: str = PLAYED_LIMIT,
    seed: int = 0,
    trial: int = 0,
    progress: Progress | None = None,
    world: WorldConfig | str = "still",
) -> list[Trajectory]:
    """The trajectory of one trial of each length, all recorded together.

    The controller may be given by its name or path, lengths as one, several or `4..16`. `progress`
    is told the share of the time limit that is played, and what is done. The starts are those of
    `run_trials`; a chaotic swim may end differently, for other batches round differently.

    Raises:
        InputError: no controller, an impossible length, seed, trial or time limit, or a length that
            the controller cannot serve.
    """
    check_can_compute()
    controller, lengths = named.controller(controller), as_lengths(lengths)
    for length in lengths:
        controller.card.check_serves(length)
    seed, trial = check_seed(seed), whole("trial", trial, least=0, most=2**31 - 1)
    water, name = as_config(world), controller.card.name
    env = domain_for([controller], max(lengths), time_limit, water)
    units = f"{lengths_as_text(lengths)} units"
    with telling(function("progress", progress), name, units) as tell:
        start = _starts(env, lengths, seed, trial)
        states, frames = _play_out(env, controller, start, tell)
    about = {"policy": name, "identity": identity(controller)}
    about |= {"seed": seed, "trial": trial, "time_limit": time_limit, "world": label(water)}
    return [_trajectory(env, about, states, frames, i, n) for i, n in enumerate(lengths)]


def _trajectory(
    env: SCLD, about: dict[str, Any], states: State, frames: Frame, index: int, length: int
) -> Trajectory:
    """One of the recorded chains."""
    steps, target = int(states.time[index]), np.asarray(states.target[index, :length])
    arrays = _fields(frames, index, length, steps)
    world = env.world_of(jax.tree.map(lambda x: x[index], states))
    gain = None if frames.gain is None else frames.gain[1 : steps + 1, index, :length]
    current = jax.tree.map(lambda x: x[: steps + 1, index], frames.current)
    points = np.concatenate([arrays["unit_position"].reshape(-1, 2), target])
    return Trajectory(
        **about,
        **arrays,
        dt=float(env.physics.control_step),
        success=bool(states.goal[index]),
        target=target,
        around=surroundings(world, points, gain, current),
    )


def _starts(env: SCLD, lengths: list[int], seed: int, trial: int) -> State:
    """The trial of each length before its first step."""
    keys = [start_keys(seed, length, jnp.array([trial])) for length in lengths]
    return _begin(env, jnp.concatenate(keys), jnp.array(lengths))


def _play_out(
    env: SCLD, controller: Controller, states: State, tell: Callable[[float], None]
) -> tuple[State, Frame]:
    """The last states, and all frames (time, chain, ...) from the start on."""
    limit = max(step_limit(env.config.time_limit, int(length)) for length in states.length)
    frames = [jax.tree.map(lambda x: np.asarray(x)[None], _frame(env, states))]
    memory = jax.vmap(lambda state: begin(controller, state))(states)
    while not bool(states.done.all()):
        states, memory, more = _play(env, controller, states, memory)
        frames.append(jax.tree.map(np.asarray, more))
        tell(min((len(frames) - 1) * AT_ONCE / limit, 1.0))
    tell(1.0)
    return states, jax.tree.map(lambda *parts: np.concatenate(parts), *frames)


@eqx.filter_jit
def _begin(env: SCLD, keys: Key[Array, " chain"], lengths: Int[Array, " chain"]) -> State:
    compiling()
    return jax.vmap(env.reset)(keys, lengths)


@eqx.filter_jit
def _play(
    env: SCLD, controller: Controller, states: State, memory: Any
) -> tuple[State, Any, Frame]:
    """Some steps on; a chain stays as it is once its episode has ended."""
    compiling()

    def advance(now: tuple[State, Any], _: None) -> tuple[tuple[State, Any], Frame]:
        states, memory = now
        action, memory = jax.vmap(lambda state, own: act(controller, state, own))(states, memory)
        states = where(states.done, states, jax.vmap(env.step)(states, action))
        return (states, memory), _frame(env, states)

    (states, memory), frames = jax.lax.scan(advance, (states, memory), None, length=AT_ONCE)
    return states, memory, frames


def _frame(env: SCLD, states: State) -> Frame:
    chain = states.chain
    gain = None if env.world.thrusters is None else jax.vmap(partial(_gain, env))(states)
    return Frame(chain.units, chain.links, states.thrust, states.reward, gain, states.world.current)


def _gain(env: SCLD, state: State) -> Float[Array, " unit"]:
    """The gain of each thruster in the last control step."""
    thrusters, like = env.world_of(state).thrusters, state.thrust
    return jnp.ones_like(like) if thrusters is None else thrusters.working(state.time - 1, like)


def _fields(frames: Frame, chain: int, length: int, steps: int) -> dict[str, Any]:
    """The arrays of one trajectory."""

    def bodies(name: str, kept: Bodies, count: int) -> dict[str, Any]:
        return {
            f"{name}_{part}": np.asarray(getattr(kept, part))[: steps + 1, chain, :count]
            for part in ("position", "angle", "velocity", "angular_velocity")
        }

    return {
        "length": length,
        **bodies("unit", frames.units, length),
        **bodies("link", frames.links, length - 1),
        "thrust": np.asarray(frames.thrust)[1 : steps + 1, chain, :length],
        "reward": np.asarray(frames.reward)[1 : steps + 1, chain],
    }
