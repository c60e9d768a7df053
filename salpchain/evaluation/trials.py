"""Trials: one episode each, from starts that are the same for every controller."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as Spec
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from salpchain.checks import check_seed
from salpchain.controllers.policy import Controller
from salpchain.devices import AXIS, largest_divisor, mesh_of
from salpchain.errors import InputError
from salpchain.evaluation import episodes
from salpchain.evaluation.difficulty import centroid, start_of
from salpchain.evaluation.episodes import Memories
from salpchain.evaluation.measures import Trial, measures
from salpchain.evaluation.progress import compiling
from salpchain.evaluation.starts import REACH, domain_for, start_keys
from salpchain.switches import own_mesh
from salpchain.tasks.config import TaskConfig, step_limit
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from salpchain.world.randomise import WorldLike

UNITS_AT_ONCE = 16384  # units that swim in one batch, which bounds memory (chosen)
FEWER = 4  # the batch shrinks by this once so few trials go on (chosen)
WORTH = 20_000_000  # steps of a unit left to compute, worth compiling a smaller batch (chosen)
REPORTS = 16  # times that progress is reported in a batch (chosen)

Progress = Callable[[float], None]  # told the share of the work that is done


def run_trials(
    controllers: Sequence[Controller],
    length: int,
    trials: int,
    time_limit: str,
    seed: int,
    progress: Progress | None = None,
    world: WorldLike = "still",
    task: TaskConfig = REACH,
) -> list[pd.DataFrame]:
    """For each controller, a row of measures for each of its trials at this length.

    A trial is one episode and is frozen at its end. Its start depends on `seed`, `length` and its
    own number only. All controllers swim side by side, in one compiled program, and must speak
    the same observation and action. The world is still, with the paper's physics, and the task the
    paper's, unless others are given; of the task's settings, length, observation, action and time
    limit do not count. Columns: policy, length, trial, seed, time_limit, what `measures` says, and
    the task's own measures.

    Raises:
        InputError: fewer than one trial, an impossible length or time limit, a length that a
            controller cannot serve, or controllers of different observations or actions.
    """
    limits = (time_limit,)
    at = run_limits(controllers, length, trials, limits, seed, progress, world, task)
    return at[time_limit]


@own_mesh
def run_limits(
    controllers: Sequence[Controller],
    length: int,
    trials: int,
    time_limits: Sequence[str],
    seed: int,
    progress: Progress | None = None,
    world: WorldLike = "still",
    task: TaskConfig = REACH,
) -> dict[str, list[pd.DataFrame]]:
    """`run_trials` under several time limits: played once, to the last, and measured at each.

    Raises:
        As `run_trials`.
    """
    if trials < 1:
        raise InputError(f"trials must be 1 or more, got {trials}")
    check_seed(seed)
    ascending = sorted(time_limits, key=lambda limit: step_limit(limit, length))
    envs = [domain_for(controllers, length, limit, world, task) for limit in ascending]
    blocks = -(-trials * len(controllers) * length // UNITS_AT_ONCE)
    size = share_evenly(-(-trials // blocks))
    ended = []
    for block in range(blocks):
        numbers = jnp.arange(block * size, (block + 1) * size)
        share = partial(_share, progress, block, blocks)
        ended.append(_play_limits(envs, controllers, length, seed, numbers, share))
    about = {"length": length, "trial": np.arange(trials), "seed": seed}
    names = [controller.card.name for controller in controllers]
    return {
        limit: _frames(names, {**about, "time_limit": limit}, measured, trials)
        for limit, measured in zip(ascending, zip(*ended, strict=True), strict=True)
    }


def _play_limits(
    envs: Sequence[Task],
    controllers: Sequence[Controller],
    length: int,
    seed: int,
    numbers: Int[Array, " trial"],
    progress: Progress,
) -> list[dict[str, np.ndarray]]:
    """The measures of the trials of these numbers under the time limit of each domain, ascending.

    Up to its own limit an episode is the same under any: it is played in the last domain alone.
    """
    begun = [_begin(env, len(controllers), length, seed, numbers) for env in envs]
    limits = [int(env.step_limit(length)) for env in envs]
    ends = play_out(envs[-1], controllers, begun[-1], limits, progress)
    return [
        measures(env, eqx.tree_at(lambda trial: trial.start, end, first.start))
        for env, first, end in zip(envs, begun, ends, strict=True)
    ]


def _frames(
    names: Sequence[str],
    about: dict[str, Any],
    ended: Sequence[dict[str, np.ndarray]],
    trials: int,
) -> list[pd.DataFrame]:
    """The measures of all blocks, (trial, controller) each, as a frame for each controller."""
    values = {name: np.concatenate([m[name] for m in ended])[:trials] for name in ended[0]}
    own = [{k: x[:, i] for k, x in values.items()} for i in range(len(names))]
    return [
        pd.DataFrame({"policy": name, **about, **mine})
        for name, mine in zip(names, own, strict=True)
    ]


def share_evenly(trials: int) -> int:
    """As many trials or a few more, so that every device gets the same number."""
    devices = min(trials, jax.local_device_count())
    return -(-trials // devices) * devices


def _share(progress: Progress | None, block: int, blocks: int, share: float) -> None:
    if progress:
        progress((block + share) / blocks)


def _begin(
    env: Task, controllers: int, length: int, seed: int, numbers: Int[Array, " trial"]
) -> Trial:
    """The trials of these numbers before their first step, shared out over the devices."""
    return shared_out(
        _begin_all(env, controllers, jnp.int32(length), start_keys(seed, length, numbers))
    )


def shared_out(trials: Trial) -> Trial:
    """The trials, shared out over the devices."""
    return jax.device_put(trials, NamedSharding(_mesh(len(trials.effort)), Spec(AXIS)))


def _mesh(trials: int) -> Mesh:
    """A mesh over the largest number of devices that divides the number of trials."""
    return mesh_of(largest_divisor(trials, jax.local_device_count()))


@eqx.filter_jit
def _begin_all(
    env: Task, controllers: int, length: Int[Array, ""], keys: Key[Array, " trial"]
) -> Trial:
    compiling()
    return for_each(controllers, jax.vmap(partial(begin_one, env, length))(keys))


def for_each(controllers: int, trials: Trial) -> Trial:
    """Trials (trial,) as (trial, controller): all controllers begin alike."""
    return jax.tree.map(
        lambda x: jnp.broadcast_to(x[:, None], (len(x), controllers, *x.shape[1:])), trials
    )


def begin_one(env: Task, length: Int[Array, ""], key: PRNGKeyArray) -> Trial:
    """A trial before its first step."""
    state = env.reset(key, length)
    zero = jnp.zeros(())
    return Trial(
        state=state,
        start=start_of(env, state),
        effort=zero,
        path=zero,
        contact_steps=jnp.int32(0),
        series=_no_series(env, state),
    )


def _no_series(env: Task, state: State) -> dict[str, Float[Array, " step"]]:
    """Room for what the task reads off each control step; NaN until then."""
    with jax.ensure_compile_time_eval():
        steps = int(env.step_limit(env.config.length))
    return {name: jnp.full(steps, jnp.nan) for name in jax.eval_shape(env.gauge, state)}


def play_out(
    env: Task,
    controllers: Sequence[Controller],
    trials: Trial,
    limits: Sequence[int],
    progress: Progress,
) -> list[Trial]:
    """All trials as they stand at each limit (control steps, ascending), ended or not.

    Those that have ended leave the batch when few go on.
    """
    swimming, places = trials, np.arange(len(trials.effort))
    memories, last, ends = episodes.remember(controllers, trials.state), limits[-1], []
    stride = -(-last // REPORTS)
    _compile(env, controllers, swimming, memories, trials)
    progress(0.0)
    for until in sorted({*range(stride, last, stride), *limits}):
        swimming, memories = play(env, controllers, swimming, memories, jnp.int32(until))
        if until in limits:
            ends += [_put(trials, swimming, places)] * list(limits).count(until)
        going = _going(swimming)
        if not going.any():
            break
        progress(until / last)
        work = (last - until) * len(places) * len(controllers) * env.config.length
        if FEWER * going.sum() <= len(places) and work >= WORTH:
            trials = _put(trials, swimming, places)
            stay = np.argsort(~going, stable=True)[: share_evenly(-(-len(places) // FEWER))]
            swimming, memories = _take((swimming, memories), stay)
            places = places[stay]
            _compile(env, controllers, swimming, memories, trials)
            progress(until / last)
    progress(1.0)
    return ends + [_put(trials, swimming, places)] * (len(limits) - len(ends))


def _compile(
    env: Task, controllers: Sequence[Controller], some: Trial, memories: Memories, trials: Trial
) -> None:
    """Compiles what plays some of the trials, if it must, by making no step with it.

    So compiling can be told apart from swimming.
    """
    after, _ = play(env, controllers, some, memories, jnp.int32(0))
    _going(after)
    jax.block_until_ready(_put(trials, after, np.arange(len(after.effort))))


def _going(trials: Trial) -> np.ndarray:
    """Which trials have a controller whose episode has not ended."""
    return np.asarray(~trials.state.done.all(axis=1))


def _put(trials: Trial, some: Trial, places: np.ndarray) -> Trial:
    """The trials with some of them in their places."""
    some = jax.device_put(some, NamedSharding(_mesh(len(trials.effort)), Spec()))
    return _replace(trials, some, jnp.asarray(places))


@jax.jit
def _replace(trials: Trial, some: Trial, places: Int[Array, " some"]) -> Trial:
    return jax.tree.map(lambda x, new: x.at[places].set(new), trials, some)


def _take(batch: Any, places: np.ndarray) -> Any:
    """Some of a batch, shared out over the devices."""
    some = jax.tree.map(lambda x: x[places], batch)
    return jax.device_put(some, NamedSharding(_mesh(len(places)), Spec(AXIS)))


@eqx.filter_jit
def play(
    env: Task,
    controllers: Sequence[Controller],
    trials: Trial,
    memories: Memories,
    until: Int[Array, ""],
) -> tuple[Trial, Memories]:
    """The trials after control step `until`, those that have ended as they ended."""
    compiling()
    weights, rest = eqx.partition(controllers, eqx.is_array)

    def mine(weights: Any, trials: Trial, memories: Memories, until: Array) -> Any:
        crew = eqx.combine(weights, rest)
        step = partial(episodes.abreast, env, crew, partial(_add_up, env))
        return episodes.play(step, trials, memories, until)

    shared = jax.shard_map(
        mine,
        mesh=_mesh(len(trials.effort)),
        in_specs=(Spec(), Spec(AXIS), Spec(AXIS), Spec()),
        out_specs=Spec(AXIS),
        check_vma=False,
    )
    return shared(weights, trials, memories, until)


def _add_up(env: Task, trial: Trial, state: State) -> Trial:
    """The trial after its step to this state."""
    moved = centroid(state.chain) - centroid(trial.state.chain)
    dt = env.physics.control_step
    return Trial(
        state=state,
        start=trial.start,
        effort=trial.effort + jnp.abs(state.thrust).sum() / state.length * dt,
        path=trial.path + jnp.linalg.norm(moved),
        contact_steps=trial.contact_steps + state.chain.touching,
        series={
            name: trial.series[name].at[state.time - 1].set(now)
            for name, now in env.gauge(state).items()
        },
    )
