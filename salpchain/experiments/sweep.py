"""A whole grid of runs: started, watched, retried and resumed, on this machine or elsewhere."""

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from salpchain.files import StrPath
from salpchain.machine import cores
from salpchain.paper.cost import baseline_cost, test_cost, train_cost
from salpchain.paper.grid import Grid, Job
from salpchain.paper.results import baseline_untested, is_done, trained_share, untested

LOOK_EVERY = 1.0  # s between two looks at the jobs (chosen)
RETRIES = 2  # of a job whose process died without a word (chosen)
GUESSED = 300.0  # s of work at the plan's pace that the pace seen so far is averaged with (chosen)

Task = tuple[int, ...]  # numbers of jobs in the grid that one process does


@runtime_checkable
class Executor(Protocol):
    """Where tasks run."""

    @property
    def room(self) -> int:
        """How many more tasks may start now."""
        ...

    def start(self, task: Task) -> None:
        """Starts a task."""
        ...

    def ended(self) -> dict[Task, "End"]:
        """The tasks that have ended since the last call."""
        ...

    def stop(self) -> None:
        """Asks all to save and stop, and waits until they have."""
        ...


@dataclass(frozen=True)
class End:
    """How a task ended."""

    good: bool
    retry: bool = False  # its process or machine died: worth another try
    message: str = ""


@dataclass(frozen=True)
class Overall:
    """What a watcher of a sweep is told."""

    share: float  # of all work
    seconds_left: float
    done: int
    jobs: int
    running: tuple[str, ...]
    failures: tuple[str, ...]


Watch = Callable[[Overall], None]


def sweep(
    folder: StrPath, grid: Grid, executor: Executor, watch: Watch, together: bool = False
) -> list[str]:
    """Does all that is not done yet; returns a line for each task that failed for good.

    `together`: the seeds of a configuration are one task, and train side by side.

    Raises:
        KeyboardInterrupt: asked to stop; jobs have saved and stopped.
    """
    state = _State(folder, grid, together, min(executor.room, cores()))
    try:
        while state.waiting or state.running:
            while state.waiting and executor.room > 0:
                state.begin(executor)
            for task, end in executor.ended().items():
                state.finish(task, end)
            watch(state.overall())
            time.sleep(LOOK_EVERY)
    finally:
        executor.stop()
    watch(state.overall())
    return list(state.failures)


class _State:
    """Which jobs wait, run, have failed; and how much of the work is done."""

    def __init__(self, folder: StrPath, grid: Grid, together: bool, at_once: int) -> None:
        self.folder, self.grid, self.jobs = Path(folder), grid, grid.jobs()
        self.names = [*(job.name for job in self.jobs), "greedy"]
        tasks = [*_tasks(grid, together), (len(self.jobs),)]
        self.waiting = deque(task for task in tasks if not all(map(self._is_done, task)))
        self.running: set[Task] = set()
        self.failures: list[str] = []
        self.tries: Counter[Task] = Counter()
        self.costs = [*(_cost(grid, job) for job in self.jobs), baseline_cost(grid)]
        self.begun, self.done_before = time.monotonic(), self._work_done()
        self.at_once = min(at_once, len(self.waiting))

    def begin(self, executor: Executor) -> None:
        task = self.waiting.popleft()
        self.running.add(task)
        self.tries[task] += 1
        executor.start(task)

    def finish(self, task: Task, end: End) -> None:
        self.running.discard(task)
        left = [number for number in task if not self._is_done(number)]
        if not left:
            return
        if end.retry and self.tries[task] <= RETRIES:
            self.waiting.appendleft(task)
        else:
            names = ", ".join(self.names[number] for number in left)
            self.failures.append(f"{names}: {end.message or 'exited before it had finished'}")

    def overall(self) -> Overall:
        total, done = sum(self.costs), self._work_done()
        spent, fresh = time.monotonic() - self.begun, done - self.done_before
        pace = (fresh + GUESSED * max(1, self.at_once)) / (spent + GUESSED)
        return Overall(
            share=done / total,
            seconds_left=(total - done) / pace,
            done=sum(self._is_done(n) for n in range(len(self.names))),
            jobs=len(self.names),
            running=tuple(self.names[n] for task in sorted(self.running) for n in task),
            failures=tuple(self.failures),
        )

    def _is_done(self, number: int) -> bool:
        if number == len(self.jobs):
            return not baseline_untested(self.folder, self.grid)
        return is_done(self.folder, self.jobs[number])

    def _work_done(self) -> float:
        done = sum(_done(self.folder, self.grid, job) for job in self.jobs)
        return done + (0.0 if baseline_untested(self.folder, self.grid) else self.costs[-1])


def _tasks(grid: Grid, together: bool) -> list[Task]:
    """What is started at a time: each job, or all seeds of a configuration."""
    numbers = range(len(grid.jobs()))
    apart = len(grid.configurations()) if together else len(numbers)
    return [tuple(numbers[first::apart]) for first in range(apart)]


def _cost(grid: Grid, job: Job) -> float:
    return train_cost(job) + test_cost(grid, job)


def _done(folder: Path, grid: Grid, job: Job) -> float:
    tested = 0.0 if untested(folder, job) else test_cost(grid, job)
    return train_cost(job) * trained_share(folder, job) + tested
