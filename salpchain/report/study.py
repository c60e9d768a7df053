"""A study's results as tables: what its figures and its report are made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from salpchain.evaluation.statistics import paper_normalised

HELD = 0.9  # of the distance closed: the paper's threshold


@dataclass(frozen=True)
class Entry:
    """One run of a study with its tests."""

    model: str
    graph: str  # "" where the model has none
    length: int  # units in training
    seed: int
    log: pd.DataFrame  # metrics.csv
    tests: dict[str, dict[str, Any]]  # evaluation.json by time limit

    @property
    def name(self) -> str:
        """Of the controller: model and graph."""
        return f"{self.model} {self.graph}".strip()


def episode_return(log: Any) -> pd.Series:
    """Mean return of an episode in each rollout, by the paper's reward: distance closed, and goal.

    NaN for a rollout in which no episode ended.
    """
    batch = log["steps"].diff().fillna(log["steps"].iloc[0])
    total = (log["reward_approach"] + log["reward_goal"]) * batch
    return total / log["episodes"].where(log["episodes"] > 0)


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
                    "success": own["success"]["mean"],
                    "closed_fraction": own["closed_fraction"]["mean"],
                    "final_distance": own["final_distance"]["mean"],
                    "paper_normalised": share,
                }
            )
    return pd.DataFrame(rows)


def breakpoint_of(table: Any, measure: str) -> int | None:
    """The largest length up to which a controller's mean over seeds never falls below 90 %.

    None where already the shortest is below.
    """
    mean = table.groupby("at")[measure].mean().sort_index()
    below = mean.index[mean.to_numpy() < HELD]
    held = mean.index[mean.index < (below[0] if len(below) else np.inf)]
    return int(held[-1]) if len(held) else None
