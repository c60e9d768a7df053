"""A controller judged by a suite: every cell with its intervals, and the files of it."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from salpchain.checks import check_seed, one_of
from salpchain.controllers import named
from salpchain.controllers.identity import identity
from salpchain.controllers.policy import Controller
from salpchain.errors import InputError
from salpchain.evaluation.config import Lengths, as_lengths
from salpchain.evaluation.progress import Progress, telling
from salpchain.evaluation.statistics import INTERVALS, Summary, describe, interval_of_mean, share
from salpchain.evaluation.suite_trials import run_cells
from salpchain.evaluation.suites import STILL, Suite, suite
from salpchain.files import StrPath, make_writable, read_json, write_json, write_text, writing
from salpchain.given import flag, function, path, whole
from salpchain.starting import check_can_compute
from salpchain.tasks.config import PLAYED_LIMIT, TIME_LIMITS, step_limit

CELLS_FILE = "suite.json"
TRIALS_FILE = "suite.csv"
STAY_WITHIN = 0.05  # m, of its target (mean over units): so far a chain may be swept off
MEASURES = ("closed_fraction", "steps_to_goal", "time_ratio")


def run_suite(
    controller: Controller | StrPath,
    name: str = "sea",
    lengths: Lengths | None = None,
    trials: int | None = None,
    time_limit: str = PLAYED_LIMIT,
    seed: int = 0,
    out: StrPath | None = None,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> Summary:
    """What the controller does in every cell of a suite.

    Lengths and trials are the suite's own unless given. `policy`, its `identity`, `suite`,
    `version`, `seed`, `time_limit`, and `cells`, each with `trouble`, `grade`, `length`, `trials`,
    what `_cell` says. With `out`, `suite.json` and, a row for each trial, `suite.csv` are written
    there. One trouble at a time, in grades, and all together: Dulac-Arnold et al. 2020.

    Raises:
        InputError: no controller, no such suite, a length that it cannot serve, fewer than one
            trial; `out` holds results of another controller or other trials, and not `overwrite`.
        OSError: the folder cannot be written.
    """
    check_can_compute()
    flag("overwrite", overwrite)
    function("progress", progress)
    tested, meant = named.controller(controller), suite(name)
    asked = _asked(tested, meant, lengths, trials, time_limit, seed)
    if out is None:
        return _summary(asked, _play(tested, meant, asked, progress))
    folder = path("out", out)
    if not overwrite:
        _check_kept(folder, asked)
    make_writable(folder)
    with writing(folder / CELLS_FILE):
        frame = _play(tested, meant, asked, progress)
        summary = _summary(asked, frame)
        write_text(folder / TRIALS_FILE, frame.to_csv(index=False))
        write_json(folder / CELLS_FILE, summary)
    return summary


def _asked(
    controller: Controller,
    meant: Suite,
    lengths: Lengths | None,
    trials: int | None,
    limit: str,
    seed: int,
) -> dict[str, Any]:
    """Whose results they are to be, and of which trials.

    Raises:
        InputError: they cannot be, or the controller cannot play them.
    """
    one_of("time limit", limit, TIME_LIMITS)
    units = sorted(set(as_lengths(meant.lengths if lengths is None else lengths)))
    for length in units:
        controller.card.check_serves(length)
    return {
        "policy": controller.card.name,
        "identity": identity(controller),
        "suite": meant.name,
        "version": meant.version,
        "lengths": units,
        "trials": meant.trials if trials is None else whole("trials", trials, least=1),
        "time_limit": limit,
        "seed": check_seed(seed),
    }


def _check_kept(folder: Path, asked: dict[str, Any]) -> None:
    """Raise InputError if the folder holds a suite of another controller or of other trials."""
    file = folder / CELLS_FILE
    if not file.exists():
        return
    ways = {
        "python": ": choose another folder, or give overwrite=True",
        "shell": ": choose another folder, or add --overwrite",
    }
    try:
        kept = read_json(file)
    except InputError as error:
        raise InputError(str(error), **ways) from None
    if not isinstance(kept, dict) or "cells" not in kept:
        raise InputError(f"{file} is no result of a suite", **ways)
    for setting, value in asked.items():
        if kept.get(setting) != value:
            raise InputError(
                f"{folder} holds other results: {setting.replace('_', ' ')} {kept.get(setting)}"
                f" there, {value} asked for",
                **ways,
            )


def _play(
    controller: Controller, meant: Suite, asked: dict[str, Any], progress: Progress | None
) -> pd.DataFrame:
    """The trials of all cells at all lengths."""
    limit, units = asked["time_limit"], asked["lengths"]
    work = np.cumsum([0.0, *(n * step_limit(limit, n) for n in units)]) / sum(
        n * step_limit(limit, n) for n in units
    )
    frames = []
    for length, before, after in zip(units, work, work[1:], strict=False):
        where = f"suite {meant.name}, {length} units"
        with telling(progress, controller.card.name, where, before, after - before) as tell:
            cells = list(meant.cells(length))
            frames.append(
                run_cells(controller, cells, length, asked["trials"], limit, asked["seed"], tell)
            )
    return pd.concat(frames, ignore_index=True)


def _summary(asked: dict[str, Any], frame: pd.DataFrame) -> Summary:
    about = {**asked, "intervals": {**INTERVALS, "loss": "percentile bootstrap of paired trials"}}
    cells = []
    for _, rows in frame.groupby(["length", "trouble", "grade"], sort=False):
        which = {name: rows[name].tolist()[0] for name in ("trouble", "grade", "length")}
        calm = (frame["length"] == which["length"]) & (frame["trouble"] == STILL)
        cells.append({**which, **_cell(rows, frame.loc[calm, "success"].to_numpy(bool))})
    return {**about, "cells": cells}


def _cell(rows: pd.DataFrame, still: np.ndarray) -> Summary:
    """`success` (mean, low, high), `possible` (share of the trials that physics allows at all), the
    measures `closed_fraction`, `steps_to_goal` and `time_ratio`, `loss` (success in still water
    from the same starts minus success, with its paired interval), `stayed` (of the trials that
    reached the target, those that stay near it for 10 s; None where none did), and `kinds`, the
    success in each world of the cell where there are several."""
    success, kind = rows["success"].to_numpy(bool), rows["kind"].to_numpy(str)
    kinds = {name: _share(success[kind == name]) for name in dict.fromkeys(kind.tolist())}
    lost = still.astype(float) - success
    low, high = interval_of_mean(lost)
    stayed = rows["farthest_after"].to_numpy(float)[success] <= STAY_WITHIN
    return {
        "trials": len(rows),
        "success": _share(success),
        "possible": float(rows["possible"].to_numpy(float).mean()),
        **{name: describe(rows[name].to_numpy(float)) for name in MEASURES},
        "stayed": _share(stayed) if len(stayed) else None,
        "loss": {"mean": float(lost.mean()), "low": _number(low), "high": _number(high)},
        **({"kinds": kinds} if len(kinds) > 1 else {}),
    }


def _share(successes: np.ndarray) -> dict[str, float]:
    return share(int(successes.sum()), len(successes))


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value
