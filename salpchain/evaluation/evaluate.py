"""Evaluations: a controller beside the greedy baseline on many lengths, and the files of it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from salpchain.checks import check_seed, one_of
from salpchain.controllers import named
from salpchain.controllers.greedy import Greedy
from salpchain.controllers.identity import identity
from salpchain.controllers.policy import Controller, Planner
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE, TRIALS_FILE, Lengths, as_lengths
from salpchain.evaluation.kept import check_kept, settings
from salpchain.evaluation.progress import Progress, telling
from salpchain.evaluation.starts import REACH, domain_for
from salpchain.evaluation.statistics import Summary, summarise
from salpchain.evaluation.trials import run_limits
from salpchain.files import StrPath, make_writable, write_json, write_text, writing
from salpchain.given import flag, function, path, whole
from salpchain.starting import check_can_compute
from salpchain.tasks.config import PLAYED_LIMIT, TIME_LIMITS, TaskConfig, step_limit
from salpchain.tasks.registry import as_config as task_config
from salpchain.tasks.registry import label as task_label
from salpchain.tasks.task import Task
from salpchain.world.config import WorldConfig
from salpchain.world.presets import as_config, label

STILL = WorldConfig()
# Control steps of all units, from which on controllers swim one after the other: side by side, one
# program less is compiled, but a controller is asked until the last of them has ended (chosen).
WORTH_APART = 50_000_000


def evaluate(
    controller: Controller | StrPath,
    lengths: Lengths,
    trials: int = 50,
    time_limit: str = PLAYED_LIMIT,
    seed: int = 0,
    out: StrPath | None = None,
    baseline: bool = True,
    progress: Progress | None = None,
    overwrite: bool = False,
    world: WorldConfig | str = "still",
    task: "str | type[Task] | TaskConfig | None" = None,
) -> Summary:
    """The summary of the controller's trials, that of greedy's on the same starts as "baseline".

    The controller may be given by its name or path, lengths as one, several or `4..16`. The summary
    is that of `summarise` with the policy's "identity" and "card"; "baseline" is None where none
    was asked for, or the controller is it. With `out`, a folder that is made if it
    is missing, `evaluation.csv` gets a row for each trial of both and `evaluation.json` the
    summary; either file is whole or not there. `world` is one or its name; `task` one, its name or
    its settings: without, what the policy was trained for.

    Raises:
        InputError: no controller, no lengths, fewer than one trial, or an impossible length or time
            limit; `out` holds results of another controller, under another name, or with other
            settings, and not `overwrite`.
        OSError: the folder cannot be written.
    """
    check_can_compute()
    flag("overwrite", overwrite)
    function("progress", progress)
    tested = named.controller(controller)
    asked = _checked(tested, lengths, trials, time_limit, seed, world, task)
    compared = flag("baseline", baseline) and not isinstance(tested, Greedy)
    if out is None:
        return _summary(tested, _beside_baseline(tested, compared, asked, progress), None, asked)
    with _one_at(path("out", out)) as folder:
        _claim(folder, tested, settings(*asked, compared), overwrite)
        played = _beside_baseline(tested, compared, asked, progress)
        return _summary(tested, played, folder, asked)


class _Asked(NamedTuple):
    """Which trials are played."""

    lengths: list[int]
    trials: int
    time_limit: str
    seed: int
    world: WorldConfig
    task: TaskConfig


def _checked(
    controller: Controller,
    lengths: Lengths,
    trials: int,
    time_limit: str,
    seed: int,
    world: WorldConfig | str,
    task: "str | type[Task] | TaskConfig | None",
) -> _Asked:
    """The trials that are asked for.

    Raises:
        InputError: they cannot be, or the controller cannot play them.
    """
    units = as_lengths(lengths)
    for length in units:
        controller.card.check_serves(length)
    one_of("time limit", time_limit, TIME_LIMITS)
    trials = whole("trials", trials, least=1)
    kind = controller.card.trained_for if task is None else task_config(task)
    for length in units:
        kind.check_possible(length)
    domain_for([controller], max(units), time_limit, world, kind)  # refused before all else
    return _Asked(units, trials, time_limit, check_seed(seed), as_config(world), kind)


@contextmanager
def _one_at(folder: Path) -> Iterator[Path]:
    """The folder, made if it is missing, where no other process evaluates meanwhile."""
    make_writable(folder)
    with writing(folder / SUMMARY_FILE):
        yield folder


def _beside_baseline(
    controller: Controller, compared: bool, asked: _Asked, progress: Progress | None
) -> list[pd.DataFrame]:
    """The trials of the controller, and those of the baseline on the same starts, if compared."""
    lengths, trials, time_limit, seed, world, task = asked

    def play(some: list[Controller], progress: Progress | None) -> list[pd.DataFrame]:
        return _play(some, lengths, trials, (time_limit,), seed, progress, world, task)[time_limit]

    spoken = controller.card.observation, controller.card.action
    others: list[Controller] = [Greedy(*spoken)] if compared else []
    if not isinstance(controller, Planner):
        return play([controller, *others], progress)
    # A planner would plan on for nothing while the baseline swims.
    apart = [play([other], partial(_at, progress, 0.0))[0] for other in others]
    return play([controller], progress) + apart


def evaluate_limits(
    controller: Controller,
    lengths: Sequence[int],
    trials: int,
    time_limits: Sequence[str],
    seed: int,
    out: StrPath,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> None:
    """`evaluate` without baseline under several time limits, each into its folder of `out`.

    The trials are played once, to the last limit.

    Raises:
        As `evaluate`.
    """
    out = Path(out)
    for limit in time_limits:
        asked = settings(lengths, trials, limit, seed, STILL, REACH, baseline=False)
        _claim(out / limit, controller, asked, overwrite)
    played = _play([controller], lengths, trials, time_limits, seed, progress)
    for limit in time_limits:
        asked = _Asked(list(lengths), trials, limit, seed, STILL, REACH)
        _summary(controller, played[limit], out / limit, asked)


def _claim(out: Path, controller: Controller, asked: dict[str, Any], overwrite: bool) -> None:
    """Raise unless these results may be written to the folder, which is made if it is missing."""
    if not overwrite:
        check_kept(out, controller.card.name, identity(controller), asked)
    make_writable(out)


def _summary(
    controller: Controller,
    frames: Sequence[pd.DataFrame],
    out: StrPath | None,
    asked: _Asked,
) -> Summary:
    """What the trials of the controller and of its baseline, if there is one, say; as files too."""
    told = summarise(frames[0])
    whose = {"policy": told["policy"], "identity": identity(controller)}
    summary = whose | told | {"card": controller.card.as_dict()}
    summary |= {"task": task_label(asked.task), "world": label(asked.world)}
    summary["baseline"] = summarise(frames[1]) if len(frames) > 1 else None
    if out is not None:
        write_text(Path(out) / TRIALS_FILE, pd.concat(frames).to_csv(index=False))
        write_json(Path(out) / SUMMARY_FILE, summary)
    return summary


def _play(
    controllers: Sequence[Controller],
    lengths: Sequence[int],
    trials: int,
    time_limits: Sequence[str],
    seed: int,
    progress: Progress | None,
    world: WorldConfig = STILL,
    task: TaskConfig = REACH,
) -> dict[str, list[pd.DataFrame]]:
    """Under each time limit, the trials of each controller at all lengths."""
    if not lengths:
        raise InputError("lengths must name at least one length")
    lengths = sorted(set(lengths))
    names = " and ".join(controller.card.name for controller in controllers)
    work = [n * max(step_limit(limit, n) for limit in time_limits) for n in lengths]
    played = []
    for place, length in enumerate(lengths):
        before, part = sum(work[:place]) / sum(work), work[place] / sum(work)
        with telling(progress, names, f"{length} units", before, part) as tell:
            steps = max(step_limit(limit, length) for limit in time_limits)
            apart = trials * length * steps >= WORTH_APART
            crews = [[one] for one in controllers] if apart else [controllers]
            ran = [
                run_limits(crew, length, trials, time_limits, seed, told, world, task)
                for crew, told in zip(crews, _parts(tell, len(crews)), strict=True)
            ]
            played.append({limit: [x for one in ran for x in one[limit]] for limit in time_limits})
    return {
        limit: [
            pd.concat(parts, ignore_index=True)
            for parts in zip(*(at[limit] for at in played), strict=True)
        ]
        for limit in time_limits
    }


def _parts(tell: Callable[[float], None], count: int) -> list[Callable[[float], None]]:
    """What is told the share of each of several parts of a work."""
    return [lambda share, part=part: tell((part + share) / count) for part in range(count)]


def _at(progress: Progress | None, share: float, _: float, what: str) -> None:
    """Tells what is played, at a share of the work that stays."""
    if progress:
        progress(share, what)
