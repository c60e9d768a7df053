"""The study as jobs of a sweep: its runs with their tests, and the tests of the baseline."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from salpchain.experiments.job import Job as SweepJob
from salpchain.files import StrPath
from salpchain.paper.cost import baseline_cost, test_cost, train_cost
from salpchain.paper.grid import Grid, Job
from salpchain.paper.results import baseline_untested, is_done, trained_share, untested

PROGRAM = "salpchain.paper.job"
BASELINE = "greedy"


def jobs_of(folder: StrPath, grid: Grid, together: bool = False) -> list[SweepJob]:
    """What is started at a time: each run, or all seeds of a configuration; and the baseline.

    `together`: the seeds of a configuration are one job, and train side by side.
    """
    folder, numbers = Path(folder).resolve(), range(len(grid.jobs()))
    apart = len(grid.configurations()) if together else len(numbers)
    runs = [Runs(folder, grid, tuple(numbers[first::apart])) for first in range(apart)]
    return [*runs, Baseline(folder, grid)]


@dataclass(frozen=True)
class Runs:
    """Runs of the grid, by their numbers in it, that train side by side and are tested."""

    folder: Path
    grid: Grid
    numbers: tuple[int, ...]

    @property
    def label(self) -> str:
        """The numbers."""
        return ",".join(map(str, self.numbers))

    @property
    def parts(self) -> list[str]:
        """The names of the runs."""
        return [job.name for job in self._jobs]

    @property
    def cost(self) -> float:
        """Seconds of one core for trainings and tests."""
        return sum(train_cost(job) + test_cost(self.grid, job) for job in self._jobs)

    def left(self) -> list[str]:
        """The runs that are not trained or not tested."""
        return [job.name for job in self._jobs if not is_done(self.folder, job)]

    def done(self) -> float:
        """Seconds of the cost that are done."""
        return sum(self._done(job) for job in self._jobs)

    def command(self, devices: int | None) -> list[str]:
        """The process of `salpchain.paper.job`."""
        return _command(self.folder, self.label, devices)

    @cached_property
    def _jobs(self) -> Sequence[Job]:
        jobs = self.grid.jobs()
        return [jobs[number] for number in self.numbers]

    def _done(self, job: Job) -> float:
        tested = 0.0 if untested(self.folder, job) else test_cost(self.grid, job)
        return train_cost(job) * trained_share(self.folder, job) + tested


@dataclass(frozen=True)
class Baseline:
    """The tests of the baseline."""

    folder: Path
    grid: Grid

    @property
    def label(self) -> str:
        """The number past those of the runs."""
        return str(len(self.grid.jobs()))

    @property
    def parts(self) -> list[str]:
        """The baseline's name."""
        return [BASELINE]

    @property
    def cost(self) -> float:
        """Seconds of one core for its tests."""
        return baseline_cost(self.grid)

    def left(self) -> list[str]:
        """Its name, unless it is tested with every time limit."""
        return [BASELINE] if baseline_untested(self.folder, self.grid) else []

    def done(self) -> float:
        """All of the cost or nothing."""
        return 0.0 if self.left() else self.cost

    def command(self, devices: int | None) -> list[str]:
        """The process of `salpchain.paper.job`."""
        return _command(self.folder, self.label, devices)


def _command(folder: Path, label: str, devices: int | None) -> list[str]:
    words = ["-m", PROGRAM, str(folder), label]
    return words if devices is None else [*words, str(devices)]
