"""Evaluations: a controller beside the greedy baseline on many lengths, as files and as a table."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from rich.table import Table

from salpchain.control.greedy import Greedy
from salpchain.control.policy import Controller
from salpchain.domain.config import step_limit
from salpchain.errors import InputError
from salpchain.evaluation.statistics import Summary, summarise
from salpchain.evaluation.trials import run_trials
from salpchain.files import write_json, write_text

TRIALS_FILE = "evaluation.csv"
SUMMARY_FILE = "evaluation.json"

Progress = Callable[[float, str], None]  # told the share of all work done, and what is played


def evaluate(
    controller: Controller,
    lengths: Sequence[int],
    trials: int,
    time_limit: str,
    seed: int,
    out: Path | None = None,
    baseline: bool = True,
    progress: Progress | None = None,
) -> Summary:
    """The summary of the controller's trials, that of greedy's on the same starts as "baseline".

    The summary is that of `summarise` with the policy's "card" besides; "baseline" is None where
    none was asked for, or the controller is the baseline. With `out`, a folder that is made if it
    is missing, `evaluation.csv` gets a row for each trial of both and `evaluation.json` the
    summary; either file is whole or not there.

    Raises:
        InputError: no lengths, fewer than one trial, or an impossible length or time limit.
        OSError: the folder cannot be written.
    """
    if not lengths:
        raise InputError("lengths must name at least one length")
    controllers: list[Controller] = [controller]
    if baseline and not isinstance(controller, Greedy):
        controllers.append(Greedy())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    frames = _play(controllers, sorted(set(lengths)), trials, time_limit, seed, progress)
    summary = {**summarise(frames[0]), "card": controller.card.as_dict()}
    summary["baseline"] = summarise(frames[1]) if len(frames) > 1 else None
    if out is not None:
        write_text(out / TRIALS_FILE, pd.concat(frames).to_csv(index=False))
        write_json(out / SUMMARY_FILE, summary)
    return summary


def _play(
    controllers: Iterable[Controller],
    lengths: Sequence[int],
    trials: int,
    time_limit: str,
    seed: int,
    progress: Progress | None,
) -> list[pd.DataFrame]:
    """The trials of each controller at all lengths."""
    plan = [(c, length) for c in controllers for length in lengths]
    work = [length * step_limit(time_limit, length) for _, length in plan]
    frames: dict[int, list[pd.DataFrame]] = {}
    for place, (controller, length) in enumerate(plan):
        what = f"{controller.card.name}, {length} units"
        before, part = sum(work[:place]) / sum(work), work[place] / sum(work)
        tell = partial(_tell, progress, before, part, what)
        rows = run_trials(controller, length, trials, time_limit, seed, tell)
        frames.setdefault(id(controller), []).append(rows)
    return [pd.concat(parts, ignore_index=True) for parts in frames.values()]


def _tell(progress: Progress | None, before: float, part: float, what: str, share: float) -> None:
    if progress:
        progress(before + part * share, what)


def table(summary: Summary) -> Table:
    """The summary as a table for the terminal: a row for each length, intervals in brackets."""
    limit = "up to 512 steps" if summary["time_limit"] == "fixed" else "32 steps a unit"
    title = f"{summary['policy']}: first episodes, {limit}, seed {summary['seed']}"
    made = Table(title=title, caption="brackets: 95 % intervals", title_justify="left")
    baseline = summary.get("baseline")
    names = ["length", "trials", "success", "closed", "steps to goal"]
    names += ["greedy success", "greedy closed"] if baseline else []
    for name in [*names, "limit"]:
        made.add_column(name, justify="right")
    others = baseline["lengths"] if baseline else [None] * len(summary["lengths"])
    for own, other in zip(summary["lengths"], others, strict=True):
        made.add_row(*_cells(own, other))
    return made


def _cells(own: Summary, other: Summary | None) -> list[str]:
    steps = own["steps_to_goal"]["mean"]
    cells = [str(own["length"]), str(own["trials"])]
    cells += [_percent(own["success"]), _percent(own["closed_fraction"])]
    cells.append("-" if steps is None else f"{steps:.0f}")
    if other:
        cells += [_percent(other["success"]), _percent(other["closed_fraction"])]
    return [*cells, f"{100 * own['reachable']['mean']:.1f} %"]


def _percent(value: dict[str, Any]) -> str:
    """Mean and interval in percent."""
    if value["low"] is None:
        return f"{100 * value['mean']:.1f} %"
    low, high = 100 * value["low"], 100 * value["high"]
    return f"{100 * value['mean']:.1f} % [{low:.1f}, {high:.1f}]"
