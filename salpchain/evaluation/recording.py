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
from salpchain.controllers.policy import Controller, begin
from salpchain.dynamics.robot import mounts_of
from salpchain.evaluation import episodes
from salpchain.evaluation.config import Lengths, as_lengths, lengths_as_text
from salpchain.evaluation.progress import Progress, compiling, telling
from salpchain.evaluation.starts import domain_for, start_keys
from salpchain.evaluation.survey import surroundings
from salpchain.evaluation.trajectory import Trajectory
from salpchain.files import StrPath
from salpchain.given import function, whole
from salpchain.physics.state import Bodies
from salpchain.starting import check_can_compute
from salpchain.switches import own_mesh
from salpchain.tasks.config import PLAYED_LIMIT, TaskConfig, step_limit
from salpchain.tasks.registry import as_config as task_config
from salpchain.tasks.registry import label as task_label
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
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
    target: Float[Array, "*chain unit 2"] | None  # m, if it moves


class Recorded(eqx.Module):
    """An episode with its latest steps: frame i is that of step i + 1, and AT_ONCE further on."""

    state: State
    frames: Frame  # (AT_ONCE, ...)


@own_mesh
def record(
    controller: Controller | StrPath,
    lengths: Lengths,
    time_limit: str = PLAYED_LIMIT,
    seed: int = 0,
    trial: int = 0,
    progress: Progress | None = None,
    world: WorldConfig | str = "still",
    task: "str | type[Task] | TaskConfig | None" = None,
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
    kind = controller.card.trained_for if task is None else task_config(task)
    for length in lengths:
        kind.check_possible(length)
    env = domain_for([controller], max(lengths), time_limit, water, kind)
    units = f"{lengths_as_text(lengths)} units"
    with telling(function("progress", progress), name, units) as tell:
        begun = _starts(env, lengths, seed, trial)
        states, frames = _play_out(env, controller, begun, tell)
    about = {"policy": name, "identity": identity(controller)}
    about |= {"seed": seed, "trial": trial, "time_limit": time_limit}
    about |= {"world": label(water), "task": task_label(kind)}
    return [_trajectory(env, about, states, frames, i, n) for i, n in enumerate(lengths)]


def _trajectory(
    env: Task, about: dict[str, Any], states: State, frames: Frame, index: int, length: int
) -> Trajectory:
    """One of the recorded chains."""
    steps, target = int(states.time[index]), np.asarray(states.target[index, :length])
    arrays = _fields(frames, index, length, steps)
    world = env.world_of(jax.tree.map(lambda x: x[index], states))
    gain = None if frames.gain is None else frames.gain[index, 1 : steps + 1, :length]
    current = jax.tree.map(lambda x: x[index, : steps + 1], frames.current)
    if frames.target is not None:
        target = np.asarray(frames.target[index, : steps + 1, :length])
    points = np.concatenate([arrays["unit_position"].reshape(-1, 2), target.reshape(-1, 2)])
    return Trajectory(
        **about,
        **arrays,
        dt=float(env.physics.control_step),
        success=bool(states.goal[index]),
        target=target,
        unit_length=float(world.dynamics.unit_length),
        unit_width=float(world.dynamics.unit_width),
        link_length=float(world.dynamics.link_length),
        mounts=mounts_of(world.dynamics, length),
        around=surroundings(world, points, gain, current),
    )


def _starts(env: Task, lengths: list[int], seed: int, trial: int) -> Recorded:
    """The trial of each length before its first step."""
    keys = [start_keys(seed, length, jnp.array([trial])) for length in lengths]
    return _begin(env, jnp.concatenate(keys), jnp.array(lengths))


def _play_out(
    env: Task, controller: Controller, swims: Recorded, tell: Callable[[float], None]
) -> tuple[State, Frame]:
    """The last states, and all frames (chain, time, ...) from the start on."""
    limit = max(step_limit(env.config.time_limit, int(n)) for n in swims.state.length)
    frames = [jax.tree.map(lambda x: np.asarray(x)[:, :1], swims.frames)]
    memory, played = jax.vmap(lambda state: begin(controller, state))(swims.state), 0
    while not bool(swims.state.done.all()):
        played += AT_ONCE
        swims, memory = _play(env, controller, swims, memory, jnp.int32(played))
        frames.append(jax.tree.map(np.asarray, swims.frames))
        tell(min(played / limit, 1.0))
    tell(1.0)
    whole = jax.tree.map(lambda *parts: np.concatenate(parts, axis=1), *frames)
    return swims.state, whole


@eqx.filter_jit
def _begin(env: Task, keys: Key[Array, " chain"], lengths: Int[Array, " chain"]) -> Recorded:
    """The chains before their first step; all frames are the start."""
    compiling()
    states = jax.vmap(env.reset)(keys, lengths)
    first = jax.vmap(partial(_frame, env))(states)
    frames = jax.tree.map(lambda x: jnp.repeat(x[:, None], AT_ONCE, axis=1), first)
    return Recorded(states, frames)


@eqx.filter_jit
def _play(
    env: Task, controller: Controller, swims: Recorded, memory: Any, until: Int[Array, ""]
) -> tuple[Recorded, Any]:
    """The swims after control step `until`; a chain stays as it is once its episode has ended."""
    compiling()
    step = partial(episodes.alone, env, controller, partial(_keep, env))
    return episodes.play(step, swims, memory, until)


def _keep(env: Task, swim: Recorded, state: State) -> Recorded:
    place = (state.time - 1) % AT_ONCE
    kept = jax.tree.map(lambda x, new: x.at[place].set(new), swim.frames, _frame(env, state))
    return Recorded(state, kept)


def _frame(env: Task, state: State) -> Frame:
    chain = state.chain
    gain = None if env.world.thrusters is None else _gain(env, state)
    moved = chain.units, chain.links, state.thrust, state.reward, gain, state.world.current
    return Frame(*moved, None if env.target_stands else state.target)


def _gain(env: Task, state: State) -> Float[Array, " unit"]:
    """The gain of each thruster in the last control step."""
    thrusters, like = env.world_of(state).thrusters, state.thrust
    return jnp.ones_like(like) if thrusters is None else thrusters.working(state.time - 1, like)


def _fields(frames: Frame, chain: int, length: int, steps: int) -> dict[str, Any]:
    """The arrays of one trajectory."""

    def bodies(name: str, kept: Bodies, count: int) -> dict[str, Any]:
        return {
            f"{name}_{part}": np.asarray(getattr(kept, part))[chain, : steps + 1, :count]
            for part in ("position", "angle", "velocity", "angular_velocity")
        }

    return {
        "length": length,
        **bodies("unit", frames.units, length),
        **bodies("link", frames.links, length - 1),
        "thrust": np.asarray(frames.thrust)[chain, 1 : steps + 1, :length],
        "reward": np.asarray(frames.reward)[chain, 1 : steps + 1],
    }
