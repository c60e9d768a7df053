"""Points of a learning figure: what the deterministic evaluations of trainings said."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes

from salpchain.evaluation.statistics import share
from salpchain.files import StrPath
from salpchain.report.style import GREY, looks
from salpchain.training.run_folder import read_evaluations

MEASURES = ("success", "closed_fraction")
OF_ONE = "95 % interval of success"
OF_SEEDS = "of seeds mean ± standard error"
DIAMOND: dict[str, Any] = {
    "marker": "D",
    "markersize": 6,
    "markerfacecolor": "white",
    "markeredgewidth": 1.5,
    "linestyle": "",
    "zorder": 4,
}


class Points(NamedTuple):
    """Evaluations on the way and the closing one: a mean and its interval at each."""

    steps: Float[np.ndarray, " point"]
    mean: Float[np.ndarray, " point"]
    low: Float[np.ndarray, " point"]
    high: Float[np.ndarray, " point"]


def judged(runs: Sequence[StrPath], measure: str) -> Points:
    """The evaluations of runs that differ in their seed alone, at the steps that all have.

    Of one run the trials of all its lengths together, with the 95 % Wilson interval of success; of
    several the mean over them with its standard error.
    """
    if len(runs) == 1:
        rows = _of_run(runs[0])
        sides = ("low", "high") if measure == "success" else (measure, measure)
        return Points(*(_numbers(rows[name]) for name in ("steps", measure, *sides)))
    means = [_of_run(run).set_index("steps")[measure] for run in runs]
    together = pd.concat(means, axis=1, join="inner").sort_index()
    values = together.to_numpy(float)
    mean, error = values.mean(axis=1), values.std(axis=1, ddof=1) / np.sqrt(len(runs))
    return Points(_numbers(together.index), mean, mean - error, mean + error)


def _numbers(column: Any) -> Float[np.ndarray, " point"]:
    return np.asarray(column, float)


def _of_run(run: StrPath) -> pd.DataFrame:
    """A row for each evaluation of a run: steps, means over its trials, interval of success."""
    names = ["steps", *MEASURES, "low", "high"]
    rows = pd.DataFrame(read_evaluations(run)).astype(float)
    if rows.empty:
        return pd.DataFrame(columns=names, dtype=float)
    told = []
    for steps, own in rows.groupby("steps"):
        weights = _numbers(own["trials"])
        trials = float(weights.sum())
        success, closed = (float(weights @ _numbers(own[name])) for name in MEASURES)
        interval = share(round(success), round(trials))
        told.append([steps, success / trials, closed / trials, interval["low"], interval["high"]])
    return pd.DataFrame(told, columns=names)


def draw_evaluations(panel: Axes, groups: Sequence[Sequence[StrPath]], measure: str) -> None:
    """The evaluations of each group of runs over its curve, and one word of them in the legend."""
    drawn = []
    for (colour, *_), runs in zip(looks(), groups, strict=False):
        points = judged(runs, measure)
        if len(points.steps):
            _draw_points(panel, colour, points)
            drawn.append(OF_ONE if len(runs) == 1 else OF_SEEDS)
    if drawn:
        label = f"deterministic evaluation ({', '.join(sorted(set(drawn)))})"
        panel.plot([], [], markeredgecolor=GREY, label=label, **DIAMOND)


def _draw_points(panel: Axes, colour: Any, points: Points) -> None:
    """Hollow diamonds with their intervals."""
    panel.errorbar(
        points.steps / 1e6, points.mean, (points.mean - points.low, points.high - points.mean),
        color=colour, markeredgecolor=colour, elinewidth=1.2, clip_on=False, **DIAMOND,
    )  # fmt: skip
