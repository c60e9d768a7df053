"""What an iteration or an evaluation saw, as numbers by the names that files and callbacks have."""

import math
from collections.abc import Mapping
from typing import Any

from salpchain.training.config import TrainConfig
from salpchain.training.learner import Metrics

Row = dict[str, float]


class NotFiniteError(RuntimeError):
    """A number that is not finite turned up in training; the message says where."""


def measured(config: TrainConfig, metrics: Metrics) -> Row:
    """The columns of `metrics.csv` but for counts and times; not a number where none is known."""
    cohort = metrics.cohort
    episodes = float(cohort.episodes.sum())

    def mean(total: Any) -> float:
        return float(total.sum()) / episodes if episodes else math.nan

    return {
        "episodes": episodes,
        "success": mean(cohort.goals),
        "closed_fraction": mean(cohort.closed),
        "episode_steps": mean(cohort.lasted),
        "episode_return": mean(cohort.returns),
        **_by_length(config, metrics),
        **({} if metrics.ease is None else {"ease": float(metrics.ease)}),
        **{f"reward_{name}": float(value) for name, value in metrics.terms.items()},
        **{f"update_{name}": float(value) for name, value in vars(metrics.losses).items()},
    }


def _by_length(config: TrainConfig, metrics: Metrics) -> Row:
    """Success at each of several training lengths; not a number where no episode counts."""
    if len(config.lengths) == 1:
        return {}
    counts = zip(config.lengths, metrics.cohort.episodes, metrics.cohort.goals, strict=True)
    return {f"success_{n}": float(goals) / float(of) if of else math.nan for n, of, goals in counts}


def evaluated(result: Mapping[str, Any]) -> Row:
    """An evaluation of a training, with the task's own measures; success also for each length."""
    names = [name for name, value in result.items() if isinstance(value, float)]
    found = {"evaluation_success": result["success"]["mean"]}
    found |= {f"evaluation_{name}": result[name] for name in names}
    if len(result["lengths"]) > 1:
        for row in result["lengths"]:
            found[f"evaluation_success_{row['length']}"] = row["success"]["mean"]
    return found


def without_gaps(row: Mapping[str, float]) -> Row:
    """The row without what it is too early to tell, which is not a number."""
    return {name: value for name, value in row.items() if value == value}


def not_finite(iteration: int, metrics: Metrics, kept: str) -> NotFiniteError | None:
    """What to say if a number is not finite, and what is kept.

    Names the first, in the order in which they arise.
    """
    bad = [name for name, fine in vars(metrics.finite).items() if not bool(fine)]
    if not bad:
        return None
    return NotFiniteError(
        f"training stopped at iteration {iteration}: not a finite number in the"
        f" {bad[0]} (also: {', '.join(bad[1:]) or 'nothing else'}); {kept}; try a lower learning"
        " rate or another seed"
    )
