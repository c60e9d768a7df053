"""Progress on the terminal: a live line there, a plain line now and then elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from salpchain.cli.streams import notices
from salpchain.evaluation.progress import COMPILING
from salpchain.experiments.sweep import Overall

PLAIN_EVERY = 15.0  # s between lines where there is no terminal (chosen)
PLAIN_MOVED = 2.0  # s between them where much was done meanwhile (chosen)
MOVED = 0.1  # share of the work that is much (chosen)


@contextmanager
def share_display(what: str, programs: int = 0) -> Iterator[Callable[[float, str], None]]:
    """A watcher that is told the share of all work done, and what is being done.

    `programs`: how many must be compiled, if known; the time left is also that of those to come.
    """
    console = notices()
    if not console.is_terminal:
        yield _plain_share(console, what, programs)
        return
    columns = (BarColumn(bar_width=24), TaskProgressColumn(), TextColumn("{task.fields[now]}"))
    pace = Pace(programs)
    with Progress(*columns, TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
                  console=console) as bar:  # fmt: skip
        task = bar.add_task(what, total=1.0, now="", left="")

        def watch(share: float, now: str) -> None:
            left = pace.left(share, now)
            said = "" if left is None else f"{_duration(left)} left"
            bar.update(task, completed=share, now=f"{what} {now}", left=said)

        yield watch


class Pace:
    """The time left, by the time in which the same thing was done.

    What comes between two different things is compilation. Of programs that are still to be
    compiled, each is expected to take as long as those so far did on average.
    """

    def __init__(self, programs: int = 0) -> None:
        """Nothing is done yet; `programs` must be compiled in all, as far as known."""
        self._last = 0.0, 0.0, ""
        self._seconds, self._done = 0.0, 0.0
        self._compiling, self._compiled, self._programs = 0.0, 0, programs

    def left(self, share: float, now: str) -> float | None:
        """Seconds until all is done, now that this share is; None before that can be told."""
        at, (before, had, what) = time.monotonic(), self._last
        self._last = at, share, now
        if COMPILING in what:
            self._compiling += at - before
            self._compiled += COMPILING not in now
        elif now == what:
            self._seconds += at - before
            self._done += share - had
        if not self._done > 0:
            return None
        missing = max(0, self._programs - self._compiled) if self._compiled else 0
        each = self._compiling / max(1, self._compiled)
        return (1 - share) * self._seconds / self._done + missing * each


def _plain_share(console: Console, what: str, programs: int) -> Callable[[float, str], None]:
    last, said, told = "", -PLAIN_EVERY, 0.0
    pace = Pace(programs)

    def watch(share: float, now: str) -> None:
        nonlocal last, said, told
        seconds, here = pace.left(share, now), time.monotonic()
        wait = PLAIN_MOVED if share - told >= MOVED else PLAIN_EVERY
        if now == last and here - said < wait and share < 1:
            return
        last, said, told = now, here, share
        left = f", {_duration(seconds)} left" if seconds is not None else ""
        console.print(
            f"{what} {now}  ({100 * share:.0f} % done{left})", highlight=False, soft_wrap=True
        )

    return watch


@contextmanager
def sweep_display() -> Iterator[Callable[[Overall], None]]:
    """A watcher of a whole study: share of the work, jobs done, time left."""
    console = notices()
    if not console.is_terminal:
        yield _plain_sweep(console)
        return
    columns = (BarColumn(bar_width=24), TaskProgressColumn(), TextColumn("{task.fields[now]}"))
    with Progress(*columns, TimeElapsedColumn(), console=console) as bar:
        task = bar.add_task("", total=1.0, now="")
        yield lambda now: bar.update(task, completed=now.share, now=_sweep_line(now))


def _plain_sweep(console: Console) -> Callable[[Overall], None]:
    last, done = -PLAIN_EVERY, -1

    def watch(now: Overall) -> None:
        nonlocal last, done
        if now.done == done and time.monotonic() - last < PLAIN_EVERY:
            return
        last, done = time.monotonic(), now.done
        console.print(
            f"{100 * now.share:.1f} %  {_sweep_line(now)}", highlight=False, soft_wrap=True
        )

    return watch


def _sweep_line(now: Overall) -> str:
    bad = f"  {len(now.failures)} failed" if now.failures else ""
    left = f"{_duration(now.seconds_left)} left"
    return f"{now.done} of {now.jobs} jobs{bad}  {left}  {', '.join(now.running)}"


def _duration(seconds: float) -> str:
    minutes = int(seconds // 60)
    return (
        f"{minutes // 60} h {minutes % 60:02d} min"
        if minutes >= 60
        else f"{minutes} min {int(seconds) % 60:02d} s"
    )
