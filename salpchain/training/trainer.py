"""Training runs: start, watch, stop, resume. The work of one iteration is in `learner`."""

import math
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jax

from salpchain.control.policy import Policy, PolicyCard
from salpchain.control.storage import POLICY_FILE, save_policy
from salpchain.domain.scld import SCLD
from salpchain.files import alone, write_json
from salpchain.training import run_folder
from salpchain.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint
from salpchain.training.config import TrainConfig
from salpchain.training.devices import device_name, mesh_of, share, use_devices
from salpchain.training.learner import (
    Learner,
    Metrics,
    compile_iterate,
    new_learner,
    place,
)

SAVE_EVERY = 20.0  # s between checkpoints (chosen)
RECENT = 200  # finished episodes over which success is shown while training (chosen)

Row = dict[str, int | float]


class NotFiniteError(RuntimeError):
    """A number that is not finite turned up in training; the message says where."""


@dataclass(frozen=True)
class Progress:
    """What a watcher of a run is told: once before compilation, then after each iteration."""

    steps: int
    total: int
    compiling: bool = False
    steps_per_second: float = 0.0
    success: float | None = None  # share of recent episodes, None before any has ended
    closed_fraction: float | None = None
    seconds_left: float = 0.0


Watch = Callable[[Progress], None]


@dataclass
class Recent:
    """Success and closed fraction over the latest finished episodes."""

    rollouts: deque[tuple[float, float, float]] = field(default_factory=deque)

    def add(self, row: Row) -> None:
        """Takes in one more rollout; forgets those that `RECENT` episodes no longer need."""
        if row["episodes"]:
            n = row["episodes"]
            self.rollouts.append((n, row["success"] * n, row["closed_fraction"] * n))
        while sum(r[0] for r in list(self.rollouts)[1:]) >= RECENT:
            self.rollouts.popleft()

    @property
    def whole(self) -> bool:
        """Whether there have been `RECENT` episodes; the first ones to end are the short ones."""
        return sum(r[0] for r in self.rollouts) >= RECENT

    def means(self) -> tuple[float | None, float | None]:
        """Success and closed fraction, or None before any episode has ended."""
        episodes = sum(r[0] for r in self.rollouts)
        if not episodes:
            return None, None
        return tuple(sum(r[i] for r in self.rollouts) / episodes for i in (1, 2))  # type: ignore[return-value]


def train(
    config: TrainConfig,
    run: Path,
    watch: Watch | None = None,
    save_every: float = SAVE_EVERY,
    devices: int | None = None,
) -> dict[str, Any]:
    """A new run in a new folder; returns its summary.

    Its chains are shared out over as many devices as given, or as there are.

    Raises:
        InputError: the folder is already used, or there are fewer devices than given.
        NotFiniteError: a loss or weight is no longer a number; the last good checkpoint is kept.
        KeyboardInterrupt: asked to stop; everything is saved.
    """
    devices = share(config.ppo.envs, use_devices(devices))
    run_folder.create(run, config, devices, device_name())
    sitting = Sitting(config, run, SCLD(config.task), devices, watch, save_every)
    with alone(run):
        sitting.tell(Progress(0, config.total_steps, compiling=True))
        learner = place(new_learner(config, sitting.env), mesh_of(devices))
        save_checkpoint(learner, run)
        return _continue(sitting, learner)


def resume(run: Path, watch: Watch | None = None, save_every: float = SAVE_EVERY) -> dict[str, Any]:
    """Goes on from the last whole checkpoint of a run, as if it had never stopped.

    A run that was killed before its first checkpoint starts again.

    Raises:
        InputError: no run folder, a damaged checkpoint, or another process is at it.
    """
    config, devices = run_folder.read_config(run)
    use_devices(devices)
    sitting = Sitting(config, run, SCLD(config.task), devices, watch, save_every)
    new = partial(new_learner, config, sitting.env)
    with alone(run):
        there = (run / CHECKPOINT_FILE).exists()
        saved = load_checkpoint(run, jax.eval_shape(new)) if there else None
        done = int(saved.iteration) * config.ppo.batch if saved else 0
        sitting.tell(Progress(done, config.total_steps, compiling=True))
        return _continue(sitting, place(saved or new(), mesh_of(devices)))


@dataclass(frozen=True)
class Sitting:
    """What stays the same from the start or resumption of a run until it stops."""

    config: TrainConfig
    run: Path
    env: SCLD
    devices: int
    watch: Watch | None
    save_every: float  # s

    def tell(self, progress: Progress) -> None:
        """Tells the watcher, if there is one."""
        if self.watch:
            self.watch(progress)


def _continue(sitting: Sitting, learner: Learner) -> dict[str, Any]:
    config, run = sitting.config, sitting.run
    log = run_folder.MetricsLog(run, int(learner.iteration))
    try:
        with _stop_on_signal() as stopped:
            learner = _iterate(sitting, learner, log, stopped)
        _save(config, run, learner)
        if int(learner.iteration) < config.iterations:
            raise KeyboardInterrupt
        summary = _summary(config, log.rows)
        write_json(run / run_folder.SUMMARY_FILE, summary)
        return summary
    finally:
        log.close()


def _iterate(
    sitting: Sitting, learner: Learner, log: run_folder.MetricsLog, stopped: Callable[[], bool]
) -> Learner:
    """Iterations up to the last one, or until stopped; saves now and then."""
    config = sitting.config
    if int(learner.iteration) >= config.iterations:
        return learner
    clock = Clock(float(log.rows[-1]["seconds"]) if log.rows else 0.0)
    step = compile_iterate(config, sitting.env, mesh_of(sitting.devices), learner)
    clock.start_laps()
    recent = Recent()
    saved = time.monotonic()
    for iteration in range(int(learner.iteration) + 1, config.iterations + 1):
        learner, metrics = step(learner)
        row = _row(config, iteration, jax.device_get(metrics), clock)
        _check_finite(row, metrics, sitting.run)
        log.add(row)
        recent.add(row)
        sitting.tell(_progress(config, row, recent, clock.pace))
        if stopped():
            break
        if time.monotonic() - saved > sitting.save_every:
            _save(config, sitting.run, learner)
            saved = time.monotonic()
    return learner


class Clock:
    """Seconds spent on a run, compilation included, over all sittings; and those of iterations."""

    def __init__(self, before: float) -> None:
        """Starts from the seconds of earlier sittings."""
        self.total, self._last = before, time.monotonic()
        self._laps, self._in_laps = 0, 0.0

    def start_laps(self) -> None:
        """The first iteration starts now."""
        now = time.monotonic()
        self.total, self._last = self.total + now - self._last, now

    def lap(self) -> float:
        """Seconds since the last lap, added to the total."""
        now = time.monotonic()
        lap, self._last = now - self._last, now
        self.total, self._in_laps, self._laps = (
            self.total + lap,
            self._in_laps + lap,
            self._laps + 1,
        )
        return lap

    @property
    def pace(self) -> float:
        """Mean seconds of an iteration in this sitting."""
        return self._in_laps / self._laps


def _row(config: TrainConfig, iteration: int, metrics: Metrics, clock: Clock) -> Row:
    lap = clock.lap()
    episodes = float(metrics.episodes)

    def mean(total: Any) -> float:
        return float(total) / episodes if episodes else math.nan

    return {
        "iteration": iteration,
        "steps": iteration * config.ppo.batch,
        "seconds": clock.total,
        "steps_per_second": config.ppo.batch / lap,
        "episodes": episodes,
        "success": mean(metrics.goals),
        "closed_fraction": mean(metrics.closed),
        "episode_steps": mean(metrics.lasted),
        **{f"reward_{name}": float(value) for name, value in metrics.terms.items()},
        **{f"update_{name}": float(value) for name, value in vars(metrics.losses).items()},
    }


def _progress(config: TrainConfig, row: Row, recent: Recent, pace: float) -> Progress:
    success, closed = recent.means()
    left = (config.iterations - row["iteration"]) * pace
    return Progress(
        steps=int(row["steps"]),
        total=config.total_steps,
        steps_per_second=row["steps_per_second"],
        success=success,
        closed_fraction=closed,
        seconds_left=left,
    )


def _check_finite(row: Row, metrics: Metrics, run: Path) -> None:
    """Stops at the first number that is not finite, in the order in which they arise."""
    bad = [name for name, fine in vars(metrics.finite).items() if not bool(fine)]
    if bad:
        raise NotFiniteError(
            f"training stopped at iteration {int(row['iteration'])}: not a finite number in the"
            f" {bad[0]} (also: {', '.join(bad[1:]) or 'nothing else'}); the last good checkpoint"
            f" is kept in {run}; try a lower learning rate or another seed"
        )


def _save(config: TrainConfig, run: Path, learner: Learner) -> None:
    save_checkpoint(learner, run)
    save_policy(_policy(config, learner), run / POLICY_FILE)


def _policy(config: TrainConfig, learner: Learner) -> Policy:
    card = PolicyCard(
        name=config.name,
        control=config.control,
        observation=config.task.observation,
        action=config.task.action,
        length=config.task.length,
        steps=int(learner.iteration) * config.ppo.batch,
    )
    return Policy(learner.policy, card)


def _summary(config: TrainConfig, rows: list[dict[str, str]]) -> dict[str, Any]:
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
        "success": success,
        "closed_fraction": closed,
        "reached_95_percent": first,
        "seed": config.seed,
    }


@contextmanager
def _stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM ask for a stop after the present iteration; a second Ctrl-C stops now."""
    asked = False

    def ask(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    try:
        old = {s: signal.signal(s, ask) for s in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: leave signals to whoever has them
        old = {}
    try:
        yield lambda: asked
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
