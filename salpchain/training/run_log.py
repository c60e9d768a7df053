"""What a run writes down while it trains: rows, checkpoints, its policy, evaluations, summary.

Success in training is that of whole start cohorts (`cohorts`), of the policy as it samples. The
success of a run is that of its closing evaluation.
"""

import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import POLICY_FILE, load, save_policy
from salpchain.files import StrPath, write_json
from salpchain.training import run_folder
from salpchain.training.checkpoint import save_checkpoint
from salpchain.training.config import TrainConfig
from salpchain.training.evaluations import Evaluation, evaluate_training
from salpchain.training.learner import Learner, Metrics
from salpchain.world.presets import label

RECENT = 200  # episodes of the latest whole cohorts over which success is shown (chosen)

Row = dict[str, float]


class NotFiniteError(RuntimeError):
    """A number that is not finite turned up in training; the message says where."""


@dataclass
class Recent:
    """Success and closed fraction over the latest whole start cohorts."""

    rollouts: deque[tuple[float, float, float]] = field(default_factory=deque)

    def add(self, row: Mapping[str, float]) -> None:
        """Takes in one more rollout; forgets those that `RECENT` episodes no longer need."""
        if row["episodes"]:
            n = row["episodes"]
            self.rollouts.append((n, row["success"] * n, row["closed_fraction"] * n))
        while sum(r[0] for r in list(self.rollouts)[1:]) >= RECENT:
            self.rollouts.popleft()

    @property
    def whole(self) -> bool:
        """Whether the cohorts have `RECENT` episodes or more."""
        return sum(r[0] for r in self.rollouts) >= RECENT

    def means(self) -> tuple[float | None, float | None]:
        """Success and closed fraction, or None before any cohort is whole."""
        episodes = sum(r[0] for r in self.rollouts)
        if not episodes:
            return None, None
        return tuple(sum(r[i] for r in self.rollouts) / episodes for i in (1, 2))  # type: ignore[return-value]


class Clock:
    """Seconds spent on a run, compilation included, over all sittings; and those of iterations."""

    def __init__(self, before: float) -> None:
        """Starts from the seconds of earlier sittings."""
        self.total, self._last = before, time.monotonic()

    def start_lap(self) -> None:
        """An iteration starts now; what came before belongs to none."""
        now = time.monotonic()
        self.total, self._last = self.total + now - self._last, now

    def lap(self) -> float:
        """Seconds since the last lap, added to the total."""
        now = time.monotonic()
        lap, self._last = now - self._last, now
        self.total += lap
        return lap


class RunLog:
    """One run and its files, from the iteration on that it goes on from."""

    def __init__(self, config: TrainConfig, run: StrPath, iteration: int) -> None:
        """Keeps the rows up to this iteration, and no later ones."""
        self.config, self.run = config, Path(run)
        self.log = run_folder.MetricsLog(run, iteration)
        self.evaluations = run_folder.EvaluationLog(run, iteration)
        self.broken: NotFiniteError | None = None
        rows = self.log.rows
        self.clock = Clock(float(rows[-1]["seconds"]) if rows else 0.0)

    def add(self, iteration: int, metrics: Metrics) -> Row | None:
        """The row of one more iteration, written down; none from the first bad number on."""
        if self.broken:
            return None
        row = _row(self.config, iteration, metrics, self.clock)
        self.broken = _not_finite(iteration, metrics, self.run)
        if self.broken:
            return None
        self.log.add(row)
        return row

    def save(self, learner: Learner) -> None:
        """Checkpoint and policy, unless the run is broken: then the last good ones are kept."""
        if not self.broken:
            save_checkpoint(learner, self.run)
            save_policy(_policy(self.config, learner), self.run / POLICY_FILE)

    def evaluate(self, iteration: int, learner: Learner) -> Row | None:
        """What an evaluation of the learner's policy finds; nothing where the run is broken."""
        if self.broken:
            return None
        result = self._evaluate(iteration, _policy(self.config, learner))
        self.clock.start_lap()
        return evaluation_metrics(result)

    def finish(self) -> dict[str, Any]:
        """Evaluates the trained policy, writes the summary of the run and returns it."""
        last = self.config.iterations
        result = self._evaluate(last, load(self.run / POLICY_FILE))
        summary = _summary(self.config, self.log.rows, result)
        write_json(self.run / run_folder.SUMMARY_FILE, summary)
        return summary

    def _evaluate(self, iteration: int, policy: Policy) -> Evaluation:
        result = evaluate_training(policy, self.config.lengths, self.config.world)
        steps = iteration * self.config.ppo.batch
        self.evaluations.add([_evaluated(iteration, steps, row) for row in result["lengths"]])
        self.log.board(iteration, evaluation_metrics(result))
        return result

    def close(self) -> None:
        """Flushes the logs."""
        self.log.close()


def evaluation_metrics(result: Evaluation) -> Row:
    """An evaluation as numbers by name; success also for each of several lengths."""
    success, closed = result["success"]["mean"], result["closed_fraction"]
    found = {"evaluation_success": success, "evaluation_closed_fraction": closed}
    if len(result["lengths"]) > 1:
        for row in result["lengths"]:
            found[f"evaluation_success_{row['length']}"] = row["success"]["mean"]
    return found


def without_gaps(row: Mapping[str, float]) -> dict[str, float]:
    """The row without what it is too early to tell, which is not a number."""
    return {name: value for name, value in row.items() if value == value}


def _evaluated(iteration: int, steps: int, row: dict[str, Any]) -> Row:
    """A row of `evaluations.csv`."""
    mean, low, high = (row["success"][name] for name in ("mean", "low", "high"))
    return {
        "iteration": float(iteration),
        "steps": float(steps),
        "length": float(row["length"]),
        "trials": float(row["trials"]),
        "success": mean,
        "success_low": low,
        "success_high": high,
        "closed_fraction": row["closed_fraction"],
    }


def _row(config: TrainConfig, iteration: int, metrics: Metrics, clock: Clock) -> Row:
    lap, cohort = clock.lap(), metrics.cohort
    episodes = float(cohort.episodes.sum())

    def mean(total: Any) -> float:
        return float(total.sum()) / episodes if episodes else math.nan

    return {
        "iteration": float(iteration),
        "steps": float(iteration * config.ppo.batch),
        "seconds": clock.total,
        "steps_per_second": config.ppo.batch / lap,
        "episodes": episodes,
        "success": mean(cohort.goals),
        "closed_fraction": mean(cohort.closed),
        "episode_steps": mean(cohort.lasted),
        "episode_return": mean(cohort.returns),
        **_by_length(config, metrics),
        **{f"reward_{name}": float(value) for name, value in metrics.terms.items()},
        **{f"update_{name}": float(value) for name, value in vars(metrics.losses).items()},
    }


def _by_length(config: TrainConfig, metrics: Metrics) -> Row:
    """Success at each of several training lengths; not a number where no episode counts."""
    if len(config.lengths) == 1:
        return {}
    counts = zip(config.lengths, metrics.cohort.episodes, metrics.cohort.goals, strict=True)
    return {f"success_{n}": float(goals) / float(of) if of else math.nan for n, of, goals in counts}


def _not_finite(iteration: int, metrics: Metrics, run: Path) -> NotFiniteError | None:
    """What to say if a number is not finite: names the first, in the order in which they arise."""
    bad = [name for name, fine in vars(metrics.finite).items() if not bool(fine)]
    if not bad:
        return None
    return NotFiniteError(
        f"training stopped at iteration {iteration}: not a finite number in the"
        f" {bad[0]} (also: {', '.join(bad[1:]) or 'nothing else'}); the last good checkpoint"
        f" is kept in {run}; try a lower learning rate or another seed"
    )


def _policy(config: TrainConfig, learner: Learner) -> Policy:
    card = PolicyCard(
        name=config.policy_name,
        control=config.control,
        observation=config.task.observation,
        action=config.task.action,
        length=config.task.length,
        lengths=config.lengths,
        steps=int(learner.iteration) * config.ppo.batch,
        world=label(config.world),
    )
    return Policy(learner.policy, card)


def _summary(
    config: TrainConfig, rows: list[dict[str, str]], evaluation: Evaluation
) -> dict[str, Any]:
    recent = Recent()
    first = None
    for text in rows:
        row = {name: float(value or "nan") for name, value in text.items()}
        recent.add(row)
        success = recent.means()[0]
        if first is None and recent.whole and success is not None and success >= 0.95:
            first = {"steps": int(row["steps"]), "seconds": round(row["seconds"], 1)}
    success, closed = recent.means()
    return {
        "steps": config.total_steps,
        "seconds": round(float(rows[-1]["seconds"]), 1) if rows else None,
        "success": evaluation["success"]["mean"],
        "closed_fraction": evaluation["closed_fraction"],
        "evaluation": evaluation,
        "in_training": {"success": success, "closed_fraction": closed},
        "reached_95_percent": first,
        "seed": config.seed,
    }
