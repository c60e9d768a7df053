"""Chains some of whose units push nothing: an experiment that the original study's code holds and
the paper leaves out.

A controller trained on n units is tested at n/2, n, 1.5 n and 2 n units, with 1 to n/2 of them
disabled, 25 episodes each. There, one random choice of units holds for all episodes; here, also one
of its own for each episode.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from salpchain.controllers.identity import identity
from salpchain.controllers.policy import Policy
from salpchain.errors import InputError
from salpchain.evaluation.progress import Progress, telling
from salpchain.evaluation.statistics import describe, share
from salpchain.evaluation.suite_trials import run_cells
from salpchain.evaluation.suites import Cell
from salpchain.files import StrPath, read_json, write_json, write_text
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.ranges import Range
from salpchain.report.style import STYLE, legend_below, looks, percent_axes, save
from salpchain.world.config import ThrusterConfig, WorldConfig

TRIALS = 25  # episodes of each cell in the original study
MULTIPLES = (0.5, 1.0, 1.5, 2.0)  # of the training length
MASKS = {"one": True, "each": False}  # one choice for all episodes, or one for each
TIME_LIMIT = "fixed"  # the paper's
NAME = "disabled"  # of the files


def lengths_of(policy: Policy, trained: int) -> list[int]:
    """The lengths at which a controller trained on so many units is tested, as far as it can be."""
    lengths = [round(multiple * trained) for multiple in MULTIPLES]
    return [n for n in lengths if policy.card.control.model not in SINGLE_LENGTH or n == trained]


def cells_of(trained: int, length: int) -> Iterator[Cell]:
    """0 to half of the training length disabled, but never all units; the grade is how many."""
    for dead in range(min(trained // 2, length - 1) + 1):
        part = Range(dead / length, dead / length)
        world = WorldConfig(thrusters=ThrusterConfig(dead=part))
        for mask, once in MASKS.items():
            yield Cell(NAME, str(dead), {mask: world}, once)


def play(
    policy: Policy, trained: int, trials: int, seed: int, progress: Progress | None = None
) -> pd.DataFrame:
    """A row for each trial: trained, length, disabled, mask, distance_reward (m, the sum of the
    paper's approach reward), then the measures of a trial."""
    frames, lengths = [], lengths_of(policy, trained)
    for number, length in enumerate(lengths):
        where, before = f"{length} units, trained on {trained}", number / len(lengths)
        with telling(progress, policy.card.name, where, before, 1 / len(lengths)) as tell:
            cells = list(cells_of(trained, length))
            frame = run_cells(policy, cells, length, trials, TIME_LIMIT, seed, tell)
        frame.insert(0, "trained", trained)
        frame.insert(1, "disabled", frame.pop("grade").astype(int))
        frame.insert(2, "mask", frame.pop("kind"))
        frame.insert(3, "distance_reward", frame["start_distance"] - frame["final_distance"])
        frames.append(frame.drop(columns="trouble"))
    return pd.concat(frames, ignore_index=True)


def summary(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Each cell with success (Wilson interval), closed fraction and distance reward (bootstrap)."""
    cells = []
    keys = ["policy", "trained", "length", "disabled", "mask"]
    for _, rows in frame.groupby(keys, sort=False):
        success = rows["success"].to_numpy(bool)
        names = "closed_fraction", "distance_reward"
        cells.append(
            {key: rows[key].tolist()[0] for key in keys}
            | {"trials": len(rows), "success": share(int(success.sum()), len(rows))}
            | {name: describe(rows[name].to_numpy(float)) for name in names}
        )
    return cells


def experiment(
    policies: Sequence[Policy],
    trained: Sequence[int],
    trials: int,
    seed: int,
    out: StrPath,
    progress: Progress | None = None,
) -> list[Path]:
    """Plays what is not there yet and writes `disabled.json`, `.csv`, `.png` and `.pdf` in `out`.

    Each controller is tested for those of the lengths `trained` that it was trained on. What was
    played before is kept; the same call goes on where one was stopped.

    Raises:
        InputError: a controller was trained on none of them, or `out` holds other results.
    """
    asked = {"trials": trials, "seed": seed, "time_limit": TIME_LIMIT}
    out, jobs = Path(out), jobs_of(policies, trained)
    files = [out / f"{policy.card.name}-{length}.json" for policy, length in jobs]
    abouts = [{**asked, "identity": identity(policy)} for policy, _ in jobs]
    there = list(map(_is_kept, files, abouts))
    out.mkdir(parents=True, exist_ok=True)
    for number, (policy, length) in enumerate(jobs):
        if there[number]:
            continue

        def tell(done: float, what: str, number: int = number) -> None:
            if progress:
                progress((number + done) / len(jobs), what)

        frame = play(policy, length, trials, seed, tell)
        write_text(files[number].with_suffix(".csv"), frame.to_csv(index=False))
        write_json(files[number], {**abouts[number], "cells": summary(frame)})
    cells = [cell for file in files for cell in read_json(file)["cells"]]
    about = {policy.card.name: identity(policy) for policy in policies}
    write_json(out / f"{NAME}.json", {**asked, "policies": about, "cells": cells})
    return [out / f"{NAME}.json", *draw(cells, out / f"{NAME}.png")]


def jobs_of(policies: Sequence[Policy], trained: Sequence[int]) -> list[tuple[Policy, int]]:
    """Each policy with each of these lengths that it was trained on.

    Raises:
        InputError: a policy was trained on none of them, or two have the same name.
    """
    names, jobs = [policy.card.name for policy in policies], []
    for policy in policies:
        if names.count(policy.card.name) > 1:
            raise InputError(
                f"two of the policies are named {policy.card.name}: test one after the other"
            )
        lengths = list(policy.card.lengths) or [policy.card.length]
        own = [(policy, length) for length in trained if length in lengths]
        if not own:
            told = f"{lengths[0]} to {lengths[-1]}" if len(lengths) > 1 else f"{lengths[0]}"
            raise InputError(
                f"{policy.card.name} was trained on {told} units, none of the training lengths"
                f" asked for: {', '.join(map(str, trained))}"
            )
        jobs += own
    return jobs


def _is_kept(file: Path, asked: dict[str, Any]) -> bool:
    """Whether these results are there. Raises InputError where others are."""
    if not file.exists():
        return False
    content = read_json(file)
    for name, value in asked.items():
        if not isinstance(content, dict) or content.get(name) != value:
            had = content.get(name) if isinstance(content, dict) else None
            raise InputError(
                f"{file} holds other results ({name.replace('_', ' ')} {had}, {value} asked for):"
                " choose another --out"
            )
    return True


def draw(cells: Sequence[dict[str, Any]], out: StrPath) -> list[Path]:
    """Success by the number of disabled units: a row for each training length, a column for each
    test length. Lines with intervals: a choice of units for each episode; hollow: one for all."""
    trained = sorted({cell["trained"] for cell in cells})
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.5, 3.1 * len(trained) + 0.6), layout="constrained")
        rows = figure.subplots(len(trained), len(MULTIPLES), sharey=True, squeeze=False)
        for row, length in zip(rows, trained, strict=True):
            for panel, multiple in zip(row, MULTIPLES, strict=True):
                at = round(multiple * length)
                _panel(panel, [c for c in cells if (c["trained"], c["length"]) == (length, at)])
                panel.set_title(f"trained on {length}, tested at {at}", fontsize=10)
                panel.xaxis.set_major_locator(MaxNLocator(integer=True))
            percent_axes(row, "success")
        for panel in rows[-1]:
            panel.set_xlabel("disabled units")
        legend_below(figure, rows.ravel())
        return save(figure, out)


def _panel(panel: Axes, cells: Sequence[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(cell["policy"] for cell in cells))
    for name, (colour, marker, dashes) in zip(names, looks(), strict=False):
        for mask in MASKS:
            some = [c for c in cells if (c["policy"], c["mask"]) == (name, mask)]
            at = np.array([c["disabled"] for c in some])
            mean, low, high = (
                np.array([c["success"][k] for c in some]) for k in ("mean", "low", "high")
            )
            if mask == "one":
                panel.plot(at, mean, marker, color=colour, markerfacecolor="none", markersize=4,
                           markeredgecolor=colour, zorder=1)  # fmt: skip
                continue
            panel.fill_between(at, low, high, color=colour, alpha=0.13, linewidth=0)
            panel.plot(at, mean, color=colour, marker=marker, linestyle=dashes, label=name)
