"""What trials say about a controller: averages for each length, with intervals."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import scipy
from jaxtyping import Float

LEVEL = 0.95  # of every interval
RESAMPLES = 9999  # of the bootstrap (SciPy's default)
MEASURES = (
    "closed_fraction",
    "final_distance",
    "start_distance",
    "steps_to_goal",
    "steps",
    "thrust_effort",
    "path_efficiency",
    "contact_time",
    "reachable",
    "regret",
    "time_ratio",
    "turn_steps",
)
DIFFICULTY = ("far", "turn", "bend")  # what makes a start hard
THIRDS = ("low", "middle", "high")
ABOUT = ("policy", "length", "trial", "seed", "time_limit", "success", "fewest_steps", "possible")
INTERVALS = {
    "level": LEVEL,
    "success": "Wilson interval of the share of trials that reached the goal",
    "measures": "percentile bootstrap interval of the mean over trials",
}

Summary = dict[str, Any]
Values = Float[np.ndarray, " trial"]


def summarise(frame: pd.DataFrame) -> Summary:
    """A policy's trials (rows of `run_trials`) as plain JSON values, None where there is no value.

    For each length `trials`, `success` (mean, low, high) and for each of `MEASURES` mean, median,
    iqm, low and high; low and high bound the 95 % interval that `intervals` names. The task's own
    measures, whose names are in `measures`, likewise. Measures that
    a trial lacks, like steps to a goal never reached, are left out of their averages.
    `paper_normalised` has one value for each entry of `lengths`. `by_difficulty` has for each of
    `DIFFICULTY` the easy, middle and hard third of every length's trials, all lengths together but
    those whose trials it does not part in thirds, like the bend at 2 units.

    Raises:
        ValueError: no trials, or trials of several policies, seeds or time limits.
    """
    lengths: list[int] = sorted(frame["length"].unique().tolist())
    groups = [frame.loc[frame["length"] == length] for length in lengths]
    distances = np.array([rows["final_distance"].mean() for rows in groups])
    return {
        **{name: _the_one(frame, name) for name in ("policy", "time_limit", "seed")},
        "intervals": INTERVALS,
        "lengths": [_summarise_length(*x) for x in zip(lengths, groups, strict=True)],
        "paper_normalised": [_number(x) for x in paper_normalised(distances)],
        "by_difficulty": {name: _thirds(groups, name) for name in DIFFICULTY},
        **({"measures": own} if (own := own_measures(frame)) else {}),
    }


def own_measures(frame: pd.DataFrame) -> list[str]:
    """The measures that are of the task alone."""
    return [name for name in frame.columns if name not in (*ABOUT, *MEASURES, *DIFFICULTY)]


def _thirds(groups: Sequence[pd.DataFrame], name: str) -> list[Summary]:
    """The trials of all lengths by the third of their own length's trials that they belong to."""
    parted = [thirds for rows in groups if (thirds := _parted(rows, name))]
    together = [pd.concat(third) for third in zip(*parted, strict=True)]
    return [
        _of_third(label, rows, name)
        for label, rows in zip(THIRDS, together, strict=False)
        if len(rows)
    ]


def _parted(rows: pd.DataFrame, name: str) -> list[pd.DataFrame]:
    """The thirds of a length's trials, low to high; none if equal values would lie in two."""
    rows = rows.sort_values(name, kind="stable")
    third = 3 * np.arange(len(rows)) // len(rows)
    edges = np.flatnonzero(np.diff(third))
    values = rows[name].to_numpy()
    if not len(edges) or (values[edges] == values[edges + 1]).any():
        return []
    return [rows.loc[third == k] for k in range(3)]


def _of_third(third: str, rows: pd.DataFrame, name: str) -> Summary:
    return {
        "third": third,
        "trials": len(rows),
        "mean": _number(rows[name].mean()),
        "success": share(int(np.count_nonzero(rows["success"])), len(rows)),
        "closed_fraction": _number(rows["closed_fraction"].mean()),
        "time_ratio": _number(rows["time_ratio"].median()),
    }


def _the_one(frame: pd.DataFrame, name: str) -> Any:
    """The value that all rows share."""
    values = frame[name].unique().tolist()
    if len(values) != 1:
        raise ValueError(f"a summary is of one {name.replace('_', ' ')}, got {values}")
    return values[0]


def _summarise_length(length: int, rows: pd.DataFrame) -> Summary:
    names = (*MEASURES, *own_measures(rows))
    measures = {name: describe(rows[name].to_numpy(float)) for name in names}
    success = share(int(np.count_nonzero(rows["success"])), len(rows))
    return {"length": length, "trials": len(rows), "success": success, **measures}


def describe(values: Values) -> dict[str, float | None]:
    """Mean, median, interquartile mean, and the interval of the mean; NaN left out."""
    values = values[~np.isnan(values)]
    if not len(values):
        return dict.fromkeys(("mean", "median", "iqm", "low", "high"))
    low, high = interval_of_mean(values)
    numbers = {
        "mean": values.mean(),
        "median": np.median(values),
        "iqm": interquartile_mean(values),
        "low": low,
        "high": high,
    }
    return {name: _number(x) for name, x in numbers.items()}


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def interquartile_mean(values: Values) -> float:
    """Mean of the values without the lowest and the highest quarter (both rounded down).

    Source: Agarwal et al. 2021, "Deep RL at the edge of the statistical precipice"; as there,
    `scipy.stats.trim_mean` with a quarter cut at either end.
    """
    return float(scipy.stats.trim_mean(values, 0.25))


def interval_of_mean(values: Values) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of the mean; the same each time it is asked for.

    Equal values have that value as their interval. A single value has none: NaN.
    """
    if len(values) < 2:
        return math.nan, math.nan
    if np.ptp(values) == 0:
        return float(values[0]), float(values[0])
    result = scipy.stats.bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        batch=max(1, 2**21 // len(values)),
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def share(successes: int, trials: int) -> dict[str, float]:
    """The share of successes with its 95 % Wilson interval."""
    interval = scipy.stats.binomtest(successes, trials).proportion_ci(LEVEL, method="wilson")
    return {
        "mean": successes / trials,
        "low": float(interval.low),
        "high": float(interval.high),
    }


def paper_normalised(distances: Float[np.ndarray, " length"]) -> Float[np.ndarray, " length"]:
    """The curve of the paper's Figure 4: 1 at a policy's own best length, 0 at its own worst.

    R_dist, minus the final mean distance (m), is averaged for each length and rescaled by the
    policy's own extremes. Two such curves share no scale: never compare policies by them. NaN
    where all lengths are alike.
    """
    reward = -distances
    spread = np.ptp(reward)
    if spread == 0:
        return np.full_like(reward, np.nan)
    return (reward - reward.min()) / spread
