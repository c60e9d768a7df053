"""Jobs started, watched, tried again and gone on with, on this machine or elsewhere."""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from salpchain.experiments.job import Job
from salpchain.machine import cores

LOOK_EVERY = 1.0  # s between two looks at the jobs (chosen)
RETRIES = 2  # of a job whose process died without a word (chosen)
GUESSED = 300.0  # s of work at the plan's pace that the pace seen so far is averaged with (chosen)


@runtime_checkable
class Executor(Protocol):
    """Where jobs run."""

    @property
    def room(self) -> int:
        """How many more jobs may start now."""
        ...

    def start(self, job: Job) -> None:
        """Starts a job."""
        ...

    def ended(self) -> dict[str, "End"]:
        """The jobs that have ended since the last call, by their labels."""
        ...

    def stop(self) -> None:
        """Asks all to save and stop, and waits until they have."""
        ...


@dataclass(frozen=True)
class End:
    """How a job ended."""

    good: bool
    retry: bool = False  # its process or machine died: worth another try
    message: str = ""


@dataclass(frozen=True)
class Overall:
    """What a watcher of a sweep is told."""

    share: float  # of all work
    seconds_left: float
    done: int  # parts of jobs, such as runs
    jobs: int  # all of these
    running: tuple[str, ...]
    failures: tuple[str, ...]


Watch = Callable[[Overall], None]


def sweep(jobs: Sequence[Job], executor: Executor, watch: Watch) -> list[str]:
    """Does all that is not done yet; returns a line for each job that failed for good.

    Raises:
        KeyboardInterrupt: asked to stop; jobs have saved and stopped.
    """
    state = _State(jobs, min(executor.room, cores()))
    try:
        while state.waiting or state.running:
            while state.waiting and executor.room > 0:
                state.begin(executor)
            for label, end in executor.ended().items():
                state.finish(label, end)
            watch(state.overall())
            time.sleep(LOOK_EVERY)
    finally:
        executor.stop()
    watch(state.overall())
    return list(state.failures)


class _State:
    """Which jobs wait, run, have failed; and how much of the work is done."""

    def __init__(self, jobs: Sequence[Job], at_once: int) -> None:
        self.jobs = jobs
        self.waiting = deque(job for job in jobs if job.left())
        self.running: dict[str, Job] = {}
        self.failures: list[str] = []
        self.tries: Counter[str] = Counter()
        self.cost = sum(job.cost for job in jobs)
        self.begun, self.done_before = time.monotonic(), self._work_done()
        self.at_once = min(at_once, len(self.waiting))

    def begin(self, executor: Executor) -> None:
        job = self.waiting.popleft()
        self.running[job.label] = job
        self.tries[job.label] += 1
        executor.start(job)

    def finish(self, label: str, end: End) -> None:
        job = self.running.pop(label)
        left = job.left()
        if not left:
            return
        if end.retry and self.tries[label] <= RETRIES:
            self.waiting.appendleft(job)
        else:
            why = end.message or "exited before it had finished"
            self.failures.append(f"{', '.join(left)}: {why}")

    def overall(self) -> Overall:
        done = self._work_done()
        spent, fresh = time.monotonic() - self.begun, done - self.done_before
        pace = (fresh + GUESSED * max(1, self.at_once)) / (spent + GUESSED)
        parts = sum(len(job.parts) for job in self.jobs)
        running = [job for job in self.jobs if job.label in self.running]
        return Overall(
            share=done / self.cost,
            seconds_left=(self.cost - done) / pace,
            done=parts - sum(len(job.left()) for job in self.jobs),
            jobs=parts,
            running=tuple(part for job in running for part in job.parts),
            failures=tuple(self.failures),
        )

    def _work_done(self) -> float:
        return sum(job.done() for job in self.jobs)
