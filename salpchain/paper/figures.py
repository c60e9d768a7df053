"""The paper's Figures 3 and 4, redrawn from a study, with our statistics beside them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from salpchain.errors import InputError
from salpchain.evaluation.statistics import paper_normalised
from salpchain.files import StrPath
from salpchain.paper.tables import HELD, Entry, episode_return, zero_shot_table
from salpchain.report.style import GREY, LOOKS, STYLE, legend_below, save

WINDOW = 200  # data points of the paper's moving average
# Each controller has the same colour, marker and dashes in every figure.
ORDER = ("gcn mixed", "gcn full", "gatv2 mixed", "gatv2 full", "gt mixed", "gt full", "mlp")
LOOK: dict[str, Any] = dict(zip(ORDER, LOOKS, strict=True))


def figure_3(entries: Sequence[Entry], out: StrPath) -> list[Path]:
    """Learning curves, a panel for each training length: normalised return, mean ± standard error.

    As in the paper: a moving average over 200 data points (over as many rollouts as there are, if
    fewer), scaled in each panel so that the lowest point of all curves is 0 and the highest 1.

    Raises:
        InputError: no runs.
    """
    if not entries:
        raise InputError("a study without runs has no learning curves")
    lengths = sorted({entry.length for entry in entries})
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.6 * len(lengths), 3.9), layout="constrained")
        panels = figure.subplots(1, len(lengths), sharey=True, squeeze=False)[0]
        for panel, length in zip(panels, lengths, strict=True):
            _learning_panel(panel, [e for e in entries if e.length == length])
            panel.set_title(f"{length} units")
            panel.set_xlabel("million chain-steps")
        panels[0].set_ylabel("normalised return")
        legend_below(figure, panels)
        return save(figure, out)


def normalised_curves(entries: Sequence[Entry]) -> dict[str, pd.DataFrame]:
    """Of each controller, in its figure's order, the smoothed returns with a column for each seed.

    Scaled so that the lowest point of all is 0 and the highest 1. Those without episodes are left
    out.
    """
    curves = {name: _smooth(some) for name, some in _by_name(entries).items()}
    curves = {name: frame for name, frame in curves.items() if len(frame)}
    if not curves:
        return {}
    values = np.concatenate([frame.to_numpy().ravel() for frame in curves.values()])
    low, high = values.min(), values.max()
    return {name: (frame - low) / max(high - low, 1e-9) for name, frame in curves.items()}


def _learning_panel(panel: Axes, entries: Sequence[Entry]) -> None:
    curves = normalised_curves(entries)
    if not curves:
        panel.text(
            0.5, 0.5, "no episode has ended yet", color=GREY, ha="center", transform=panel.transAxes
        )
        return
    for name, seeds in curves.items():
        steps, mean = seeds.index.to_numpy(float) / 1e6, seeds.mean(axis=1)
        error = seeds.std(axis=1, ddof=1).fillna(0.0) / np.sqrt(seeds.shape[1])
        colour, marker, dashes = LOOK[name]
        panel.fill_between(steps, mean - error, mean + error, color=colour, alpha=0.2, linewidth=0)
        panel.plot(
            steps, mean, color=colour, marker=marker, linestyle=dashes,
            markevery=max(1, len(steps) // 8), label=_label(name, seeds.shape[1]),
        )  # fmt: skip
    panel.set_xlim(left=0)
    panel.grid(axis="y", color="#dddddd", linewidth=0.6)


def _smooth(entries: Sequence[Entry]) -> pd.DataFrame:
    """A column for each seed: its moving average, at the steps that all seeds have come to.

    Each episode counts once. The curve begins when all chains have ended their first: until then
    those that ended are the quick ones.
    """
    columns = []
    for entry in entries:
        window = max(1, min(WINDOW, len(entry.log) // 5))
        log: Any = entry.log.set_index("steps", drop=False)
        total = (episode_return(log) * log["episodes"]).fillna(0.0)
        total, ended = (x.rolling(window, min_periods=1).sum() for x in (total, log["episodes"]))
        mean = total / ended.where(ended > 0)
        columns.append(mean[mean.index >= entry.settled])
    return pd.concat(columns, axis=1).dropna()


def figure_4(
    entries: Sequence[Entry], time_limit: str, out: StrPath, baseline: dict[str, Any] | None = None
) -> list[Path]:
    """Zero-shot curves, a column for each training length.

    Above the paper's: `paper-normalised` mean distance, the mean over seeds and their standard
    deviation. It rescales each controller by itself and compares none with another. Below, what
    may be compared: closed fraction and success, with 95 % intervals over seeds (of one seed, over
    its trials). Grey: the same of a controller that does nothing, what physics allows, and the
    hand-written `baseline`, where its tests (evaluation.json) are given.

    Raises:
        InputError: no tests with this time limit.
    """
    table = zero_shot_table([e for e in entries if e.model != "mlp"], time_limit)
    if table.empty:
        raise InputError(f"the study has no tests with the time limit {time_limit}")
    lengths = sorted(table["length"].unique())
    rows = (
        ("paper_normalised", "paper-normalised distance"),
        ("closed_fraction", "closed fraction"),
        ("success", "success"),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.6 * len(lengths), 9.0), layout="constrained")
        grid = figure.subplots(len(rows), len(lengths), sharex=True, sharey="row", squeeze=False)
        for panels, (measure, title) in zip(grid, rows, strict=True):
            for panel, length in zip(panels, lengths, strict=True):
                _zero_shot_panel(panel, table[table["length"] == length], measure)
                _baseline(panel, baseline, measure)
                _threshold(panel, int(length))
            panels[0].set_ylabel(title)
        for panel, length in zip(grid[0], lengths, strict=True):
            panel.set_title(f"trained on {length} units, {time_limit} time limit")
        for panel in grid[-1]:
            panel.set_xlabel("length (units)")
            panel.xaxis.set_major_locator(MaxNLocator(9, integer=True, steps=[1, 2, 4, 8, 10]))
        legend_below(figure, grid.ravel())
        return save(figure, out)


def _zero_shot_panel(panel: Axes, table: Any, measure: str) -> None:
    for name in (n for n in ORDER if n in set(table["controller"])):
        some = table[table["controller"] == name]
        mean = some.groupby("at")[measure].mean()
        colour, marker, dashes = LOOK[name]
        panel.errorbar(
            mean.index, mean, _error(some, measure), color=colour, marker=marker, linestyle=dashes,
            elinewidth=0.8, label=_label(name, some["seed"].nunique()),
        )  # fmt: skip
    _bounds(panel, table, measure)
    panel.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    panel.set_ylim(-0.04, 1.06)
    panel.grid(axis="y", color="#dddddd", linewidth=0.6)


def _error(table: Any, measure: str) -> np.ndarray:
    """What the bars of a controller reach down and up, (2, length)."""
    own = table.pivot(index="at", columns="seed", values=measure)
    deviation = own.std(axis=1, ddof=1).fillna(0.0).to_numpy()
    if measure == "paper_normalised":
        return np.stack([deviation, deviation])
    if own.shape[1] == 1:
        row = table.sort_values("at")
        ends = row[measure] - row[f"{measure}_low"], row[f"{measure}_high"] - row[measure]
        return np.stack([end.fillna(0.0).clip(lower=0.0).to_numpy() for end in ends])
    half = interval_half(deviation, own.shape[1])
    return np.stack([half, half])


def _baseline(panel: Axes, tests: dict[str, Any] | None, measure: str) -> None:
    if tests and measure in ("closed_fraction", "success"):
        at = [row["length"] for row in tests["lengths"]]
        mean = [row[measure]["mean"] for row in tests["lengths"]]
        panel.plot(at, mean, label="greedy", color=GREY, linestyle=(0, (6, 2, 1, 2)), zorder=1)


def _bounds(panel: Axes, table: Any, measure: str) -> None:
    """What doing nothing gives, by the paper's measure; what physics allows, by ours."""
    known = table.groupby("at")[["start_distance", "reachable"]].mean()
    if measure == "paper_normalised" and len(known) > 1:
        idle = paper_normalised(known["start_distance"].to_numpy())
        panel.plot(known.index, idle, label="does nothing", color=GREY, linestyle="-", zorder=1)
    if measure == "closed_fraction":
        limit = known["reachable"]
        panel.plot(
            limit.index, limit, label="what physics allows", color=GREY, linestyle=(0, (3, 1)),
            zorder=1,
        )  # fmt: skip


def interval_half(deviation: np.ndarray, seeds: int) -> np.ndarray:
    """Half the width of the 95 % interval of a mean over seeds (Student's t); 0 for one seed."""
    from scipy import stats

    if seeds < 2:
        return np.zeros_like(deviation)
    return stats.t.ppf(0.975, seeds - 1) * deviation / np.sqrt(seeds)


def _threshold(panel: Axes, length: int) -> None:
    panel.axhline(HELD, color=GREY, linewidth=0.8, linestyle=(0, (1, 2)))
    panel.axvline(length, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)


def _by_name(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    groups: dict[str, list[Entry]] = {}
    for name in ORDER:
        some = [entry for entry in entries if entry.name == name]
        groups.update({name: some} if some else {})
    return groups


def _label(name: str, seeds: int) -> str:
    return f"{name} ({seeds} seeds)" if seeds > 1 else name
