"""The trials of a suite: one program plays all worlds that have as many slots and substeps.

A cell's trial of some number starts where every cell's does, and its world is the one that the
same episode has in `run_trials` with that world.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float, Int, Key

from salpchain.controllers.policy import Controller, act, begin
from salpchain.evaluation.measures import Trial, measures
from salpchain.evaluation.progress import compiling
from salpchain.evaluation.starts import REACH, domain_for, start_keys
from salpchain.evaluation.suites import Cell
from salpchain.evaluation.trials import (
    UNITS_AT_ONCE,
    Progress,
    begin_one,
    for_each,
    play_out,
    share_evenly,
    shared_out,
)
from salpchain.switches import own_mesh
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from salpchain.world.among import chosen
from salpchain.world.config import WorldConfig
from salpchain.world.world import World

STAY_STEPS = 100  # control steps, 10 s, for which a chain is watched after it arrived
WORLD_KEYS = 0  # any key: only the parts of a world that it draws are looked at


class Played(NamedTuple):
    """Which trials are played together: all in worlds of one program."""

    worlds: tuple[WorldConfig, ...]
    which: Int[np.ndarray, " trial"]  # of the worlds
    number: Int[np.ndarray, " trial"]  # of the trial in its cell
    drawn: Int[np.ndarray, " trial"]  # of the trial in whose world it swims
    row: Int[np.ndarray, " trial"]  # of the frame


@own_mesh
def run_cells(
    controller: Controller,
    cells: Sequence[Cell],
    length: int,
    trials: int,
    time_limit: str,
    seed: int,
    progress: Progress | None = None,
    task: TaskConfig = REACH,
) -> pd.DataFrame:
    """A row of measures for each trial of each cell: trouble, grade and kind, then as `run_trials`.

    Trial i swims in world i modulo the number of the cell's worlds, whose name is the kind.
    `farthest_after`: how far (m, mean over units) a chain that had reached its target came off it
    within `STAY_STEPS`; NaN of others.

    Raises:
        InputError: a length or a time limit that cannot be, or that the controller cannot serve.
    """
    env = domain_for([controller], length, time_limit, "still", task)
    blocks = [block for group in _programs(cells, trials) for block in _blocks(group, length)]
    costs = [len(block.row) * block.worlds[0].dynamics.substeps for block in blocks]
    work = np.cumsum([0.0, *costs])
    measured, count = dict[str, np.ndarray](), len(cells) * trials
    for block, before, after in zip(blocks, work, work[1:], strict=False):
        tell = partial(_tell, progress, before / work[-1], after / work[-1])
        for name, values in _play(env, controller, block, length, seed, tell).items():
            measured.setdefault(name, np.zeros(count, values.dtype))[block.row] = values
    names = [list(cell.worlds) for cell in cells]
    about = {
        "trouble": np.repeat([cell.trouble for cell in cells], trials),
        "grade": np.repeat([cell.grade for cell in cells], trials),
        "kind": [own[number % len(own)] for own in names for number in range(trials)],
        "policy": controller.card.name,
        "length": length,
        "trial": np.tile(np.arange(trials), len(cells)),
        "seed": seed,
        "time_limit": time_limit,
    }
    return pd.DataFrame({**about, **measured})


def _programs(cells: Sequence[Cell], trials: int) -> Iterator[Played]:
    """The trials of all cells, those of one program together."""
    numbers = np.arange(trials)
    for cell in cells:
        if len({world.dynamics.substeps for world in cell.worlds.values()}) > 1:
            raise ValueError(f"the worlds of {cell.trouble} must have the same substeps")
    for substeps in sorted({w.dynamics.substeps for cell in cells for w in cell.worlds.values()}):
        worlds: list[WorldConfig] = []
        parts: list[tuple[Any, Any, Any, Any]] = []
        for place, cell in enumerate(cells):
            own = list(cell.worlds.values())
            if own[0].dynamics.substeps == substeps:
                which = len(worlds) + numbers % len(own)
                drawn = 0 * numbers if cell.once else numbers
                parts.append((which, numbers, drawn, place * trials + numbers))
                worlds += own
        yield Played(tuple(worlds), *map(np.concatenate, zip(*parts, strict=True)))


def _blocks(played: Played, length: int) -> Iterator[Played]:
    """The trials in batches of equal size; the last is filled with some that come again."""
    count = len(played.row)
    batches = -(-count * length // UNITS_AT_ONCE)
    size = share_evenly(-(-count // batches))
    order = np.resize(np.arange(count), batches * size)
    order = order.reshape(size, batches).T  # each batch has trials of every cell
    whole = Played(played.worlds, *(x[order] for x in played[1:]))
    for batch in range(batches):
        yield Played(whole.worlds, *(x[batch] for x in whole[1:]))


def _tell(progress: Progress | None, before: float, after: float, share: float) -> None:
    if progress:
        progress(before + share * (after - before))


def _play(
    env: Task, controller: Controller, played: Played, length: int, seed: int, progress: Progress
) -> dict[str, np.ndarray]:
    """The measures of these trials, (trial,) each."""
    domain = replace(env, world=_what_all_have(env, played.worlds))
    start, drawn = (
        start_keys(seed, length, jnp.asarray(some)) for some in (played.number, played.drawn)
    )
    which = jnp.asarray(played.which)
    begun = shared_out(_begin(domain, played.worlds, jnp.int32(length), which, start, drawn))
    (end,) = play_out(domain, [controller], begun, [int(env.step_limit(length))], progress)
    found = {name: values[:, 0] for name, values in measures(domain, end).items()}
    after = np.asarray(_farthest_after(domain, controller, end), np.float64)
    return {**found, "farthest_after": np.where(found["success"], after, np.nan)}


@eqx.filter_jit
def _farthest_after(env: Task, controller: Controller, trials: Trial) -> Float[Array, " trial"]:
    """The largest distance (m, mean over units) to the target in the steps after the trials."""

    def alone(state: State) -> Float[Array, ""]:
        def advance(_: Array, now: Any) -> Any:
            state, memory, most = now
            action, memory = act(controller, state, memory)
            state = env.step(state, action)
            return state, memory, jnp.maximum(most, state.distances.mean)

        now = state, begin(controller, state), state.distances.mean
        return jax.lax.fori_loop(0, STAY_STEPS, advance, now)[2]

    return jax.vmap(alone)(jax.tree.map(lambda x: x[:, 0], trials.state))


def _what_all_have(env: Task, worlds: tuple[WorldConfig, ...]) -> World:
    """What is the same in every world that is drawn: the parts there are, and what is fixed."""
    draw = partial(env.drawn_from, key=jax.random.key(WORLD_KEYS), length=env.config.length)
    made = eqx.filter_eval_shape(lambda which: draw(chosen(worlds, which)), jnp.int32(0))
    made = eqx.filter(made, lambda leaf: isinstance(leaf, jax.ShapeDtypeStruct), inverse=True)
    return replace(made, drawn_from=None)


@eqx.filter_jit
def _begin(
    env: Task,
    worlds: tuple[WorldConfig, ...],
    length: Int[Array, ""],
    which: Int[Array, " trial"],
    start: Key[Array, " trial"],
    drawn: Key[Array, " trial"],
) -> Trial:
    """Trials before their first step, each in the world of its number, from its key."""
    compiling()

    def one(which: Array, start: Array, drawn: Array) -> Trial:
        world = env.drawn_from(chosen(worlds, which), drawn, length)
        return begin_one(replace(env, world=replace(world, drawn_from=None)), length, start)

    return for_each(1, jax.vmap(one)(which, start, drawn))
