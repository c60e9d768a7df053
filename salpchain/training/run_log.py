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

from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import POLICY_FILE, load, save_policy
from salpchain.files import StrPath, write_json
from salpchain.training import run_folder
from salpchain.training.checkpoint import save_checkpoint
from salpchain.training.config import TrainConfig
from salpchain.training.evaluations import Evaluation, evaluate_training
from salpchain.training.learner import Metrics, TrainState, policy_of
from salpchain.training.metrics import NotFiniteError, Row, evaluated, measured, not_finite

RECENT = 200  # episodes of the latest whole cohorts over which success is shown (chosen)


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
        self.broken = not_finite(
            iteration, metrics, f"the last good checkpoint is kept in {self.run}"
        )
        if self.broken:
            return None
        self.log.add(row)
        return row

    def save(self, learner: TrainState) -> None:
        """Checkpoint and policy, unless the run is broken: then the last good ones are kept."""
        if not self.broken:
            save_checkpoint(learner, self.run)
            save_policy(_policy(self.config, learner), self.run / POLICY_FILE)

    def evaluate(self, iteration: int, learner: TrainState) -> Row | None:
        """What an evaluation of the learner's policy finds; nothing where the run is broken."""
        if self.broken:
            return None
        result = self._evaluate(iteration, _policy(self.config, learner))
        self.clock.start_lap()
        return evaluated(result)

    def finish(self) -> dict[str, Any]:
        """Evaluates the trained policy, writes the summary of the run and returns it."""
        last = self.config.iterations
        result = self._evaluate(last, load(self.run / POLICY_FILE))
        summary = _summary(self.config, self.log.rows, result)
        write_json(self.run / run_folder.SUMMARY_FILE, summary)
        return summary

    def _evaluate(self, iteration: int, policy: Policy) -> Evaluation:
        result = evaluate_training(policy, self.config.lengths, self.config.world, self.config.task)
        steps = iteration * self.config.ppo.batch
        self.evaluations.add([_evaluated(iteration, steps, row) for row in result["lengths"]])
        self.log.board(iteration, evaluated(result))
        return result

    def close(self) -> None:
        """Flushes the logs."""
        self.log.close()


def _evaluated(iteration: int, steps: int, row: dict[str, Any]) -> Row:
    """A row of `evaluations.csv`."""
    mean, low, high = (row["success"][name] for name in ("mean", "low", "high"))
    measured = {name: row[name] for name in row if name not in ("length", "trials", "success")}
    return {
        "iteration": float(iteration),
        "steps": float(steps),
        "length": float(row["length"]),
        "trials": float(row["trials"]),
        "success": mean,
        "success_low": low,
        "success_high": high,
        **{name: math.nan if value is None else value for name, value in measured.items()},
    }


def _row(config: TrainConfig, iteration: int, metrics: Metrics, clock: Clock) -> Row:
    lap = clock.lap()
    return {
        "iteration": float(iteration),
        "steps": float(iteration * config.ppo.batch),
        "seconds": clock.total,
        "steps_per_second": config.ppo.batch / lap,
        **measured(config, metrics),
    }


def _policy(config: TrainConfig, learner: TrainState) -> Policy:
    return policy_of(config, learner.policy, int(learner.iteration) * config.ppo.batch)


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
