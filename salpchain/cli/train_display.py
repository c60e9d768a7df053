"""Progress of a training on the terminal: a live line there, a plain line now and then elsewhere.

It needs all of training, for which other commands would have to wait at their start.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from salpchain.cli.display import PLAIN_EVERY
from salpchain.cli.streams import notices
from salpchain.training.config import TrainConfig
from salpchain.training.run_log import Recent
from salpchain.training.settings import changed
from salpchain.training.trainer import COMPILING, OnIteration, OnStage


@contextmanager
def training_display(config: TrainConfig) -> Iterator[tuple[OnIteration, OnStage]]:
    """Shows steps, steps/s, success, closed fraction and time left: what a training tells to."""
    console = notices()
    bar = _bar(console)
    task = bar.add_task("", total=config.total_steps, speed="", score="")
    shown, plain = Training(config), _plain(console, config)

    def iteration(metrics: Mapping[str, float], step: int) -> None:
        if not shown.add(metrics):
            return
        if not console.is_terminal:
            plain(shown, step)
            return
        if not bar.live.is_started:
            bar.reset(task, completed=step)
            bar.start()
        bar.update(task, completed=step, speed=shown.speed, score=shown.score)

    def stage(text: str) -> None:
        console.print(_about(config) * (text == COMPILING) + text, highlight=False)

    try:
        yield iteration, stage
    finally:
        if bar.live.is_started:
            bar.stop()


def _about(config: TrainConfig) -> str:
    other = len(changed(config))
    but = f" but for {other} setting{'s' * (other > 1)}" if other else ""
    return f"training {config.policy_name}, preset {config.preset}{but}, seed {config.seed}: "


class Training:
    """What is shown of a training: its speed, its success, the time left."""

    def __init__(self, config: TrainConfig) -> None:
        """Nothing is done yet."""
        self._batch, self._total = config.ppo.batch, config.total_steps
        self._recent, self._seconds, self._steps = Recent(), 0.0, 0
        self.speed = ""

    def add(self, metrics: Mapping[str, float]) -> bool:
        """Takes in the metrics of an iteration; returns whether they are of one."""
        if "steps_per_second" not in metrics:
            return False
        self._recent.add(metrics)
        self._seconds += self._batch / metrics["steps_per_second"]
        self._steps += self._batch
        self.speed = f"{metrics['steps_per_second']:,.0f} steps/s"
        return True

    @property
    def score(self) -> str:
        """Success and closed fraction of the latest whole cohorts."""
        success, closed = self._recent.means()
        if success is None or closed is None:
            return "success: too early to tell"
        return f"success {100 * success:.0f} %  closed {100 * closed:.0f} %"

    def left(self, step: int) -> float:
        """Seconds from this step to the end, at the mean speed so far."""
        return (self._total - step) * self._seconds / self._steps


def _bar(console: Console) -> Progress:
    return Progress(
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("steps  {task.fields[speed]}  {task.fields[score]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        refresh_per_second=4,
    )


def _plain(console: Console, config: TrainConfig) -> Callable[[Training, int], None]:
    last = -PLAIN_EVERY

    def show(now: Training, step: int) -> None:
        nonlocal last
        if time.monotonic() - last < PLAIN_EVERY and step < config.total_steps:
            return
        last = time.monotonic()
        line = f"{step:>9,} / {config.total_steps:,} steps  {now.speed}  {now.score}"
        console.print(f"{line}  {now.left(step):.0f} s left", highlight=False, soft_wrap=True)

    return show
