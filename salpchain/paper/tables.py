"""A study's results as tables: what its figures and its report are made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from salpchain.evaluation.statistics import paper_normalised

HELD = 0.9  # of the distance closed: the paper's threshold
LEAST = 0.01  # mean closed fraction under which it is taken for nothing (chosen)


@dataclass(frozen=True)
class Entry:
    """One run of a study with its tests."""

    model: str
    graph: str  # "" where the model has none
    length: int  # units in training
    seed: int
    log: pd.DataFrame  # metrics.csv
    tests: dict[str, dict[str, Any]]  # evaluation.json by time limit
    settled: int = 0  # chain-steps after which every chain's first episode has ended

    @property
    def name(self) -> str:
        """The name of the controller: model and graph."""
        return f"{self.model} {self.graph}".strip()


def episode_return(log: Any) -> pd.Series:
    """Mean return by the paper's reward of the episodes that count in each row of a log.

    1 for the goal, and the distance closed (m). NaN where no episode counts. Logs from before
    salpchain counted by start cohorts have no such column; there the distance is the closed
    fraction times what a whole one is worth over the run.
    """
    ended = log["episodes"] > 0
    if "episode_return" in log:
        return log["episode_return"].where(ended)
    batch = log["steps"].diff().fillna(log["steps"].iloc[0])
    metres = float((log["reward_approach"] * batch).sum())
    closed = float((log["closed_fraction"] * log["episodes"])[ended].sum())
    whole = metres / closed if closed > LEAST * log["episodes"].sum() else 0.0
    return (log["success"] + whole * log["closed_fraction"]).where(ended)


def zero_shot_table(entries: Sequence[Entry], time_limit: str) -> pd.DataFrame:
    """A row for each run and test length: name, length, seed, at, success, closed, distance, ..."""
    rows = []
    for entry in entries:
        tests = entry.tests.get(time_limit)
        if tests is None:
            continue
        distance = np.array([x["final_distance"]["mean"] for x in tests["lengths"]])
        normal = paper_normalised(distance) if len(distance) > 1 else [float("nan")]
        for own, share in zip(tests["lengths"], normal, strict=True):
            rows.append(
                {
                    "controller": entry.name,
                    "model": entry.model,
                    "graph": entry.graph,
                    "length": entry.length,
                    "seed": entry.seed,
                    "at": own["length"],
                    "trials": own["trials"],
                    **_interval("success", own),
                    **_interval("closed_fraction", own),
                    "final_distance": own["final_distance"]["mean"],
                    "paper_normalised": share,
                    "reachable": own["reachable"]["mean"],
                    "start_distance": own["start_distance"]["mean"],
                }
            )
    return pd.DataFrame(rows)


def _interval(measure: str, own: dict[str, Any]) -> dict[str, float | None]:
    """Mean and 95 % interval over the trials of one length."""
    value = own[measure]
    return {
        measure: value["mean"],
        f"{measure}_low": value.get("low"),
        f"{measure}_high": value.get("high"),
    }


def reach_of(table: Any, measure: str, trained_on: int) -> tuple[int, int] | None:
    """The shortest and longest of the lengths around the training length that a controller serves.

    Served are those at which its mean over seeds is 90 % or more; all tested between the two are.
    None where the length next to that of training is not.
    """
    mean = table.groupby("at")[measure].mean().sort_index()
    own = int(np.abs(mean.index - trained_on).argmin())
    below = np.flatnonzero(~(mean.to_numpy() >= HELD))
    if own in below:
        return None
    first = max(below[below < own], default=-1) + 1
    last = min(below[below > own], default=len(mean)) - 1
    return int(mean.index[first]), int(mean.index[last])


def breakpoint_of(table: Any, measure: str) -> int | None:
    """The largest length up to which a controller's mean over seeds never falls below 90 %.

    None where already the shortest is below.
    """
    mean = table.groupby("at")[measure].mean().sort_index()
    below = mean.index[mean.to_numpy() < HELD]
    held = mean.index[mean.index < (below[0] if len(below) else np.inf)]
    return int(held[-1]) if len(held) else None
