"""The paper's own recipe, run to its end: preset `paper`, one run after another.

python -m studies.recipe.run OUT [WORKERS]

A queue for the background: start it with `nice -n 19`, stop it at any time, and the same command
goes on. (Linux shares cores by session first, whatever the niceness within it: a queue in a session
of its own needs `echo 19 > /proc/PID/autogroup` too.) Each worker takes one core and the next run
that is not done: first the runs that the paper's claims need most. What lies in OUT is a study as
`salpchain reproduce` makes it, which draws its report at any time:
`salpchain reproduce --preset paper --seeds 1 --out OUT`.

`unfinished.tar.xz` holds the runs so far, those that are not done with their checkpoints, so that
another machine goes on: `tar xJf studies/recipe/unfinished.tar.xz -C OUT` unpacks it first.
They were made at commit 08902b8; go on with that one, for what is computed must not change.
"""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from salpchain.archive import restore
from salpchain.errors import InputError
from salpchain.paper.grid import Grid, Job, claim
from salpchain.paper.results import is_done
from studies import program

FIRST = ("gcn-mixed-8", "mlp-8", "gt-mixed-8", "gatv2-mixed-8", "gcn-full-8", "gcn-mixed-16")


def order(grid: Grid) -> list[int]:
    """The numbers of the grid's jobs, seed by seed, `FIRST` first; the baseline's tests last."""
    jobs = grid.jobs()

    def place(number: int) -> tuple[int, int]:
        name = jobs[number].config.policy_name
        return jobs[number].config.seed, FIRST.index(name) if name in FIRST else len(FIRST)

    return [*sorted(range(len(jobs)), key=place), len(jobs)]


def work(folder: Path, jobs: list[Job], number: int) -> None:
    """Does one job on one core, or says why not."""
    if number < len(jobs) and is_done(folder, jobs[number]):
        return
    name = jobs[number].name if number < len(jobs) else "baseline"
    print(f"{name}: begins", flush=True)
    command = [sys.executable, "-m", "salpchain.paper.job", str(folder), str(number), "1"]
    status = subprocess.run(command).returncode
    print(f"{name}: {'done' if status == 0 else f'stopped with status {status}'}", flush=True)


def main() -> None:
    """Works through the queue; SIGTERM and Ctrl-C stop it, and every run saves."""
    out, *number = sys.argv[1:] or [""]
    if not out or len(number) > 1 or not all(word in map(str, range(1, 1000)) for word in number):
        raise InputError("give a folder, and how many workers: python -m studies.recipe.run OUT 2")
    folder, workers = Path(out), int(number[0]) if number else 2
    grid = Grid(preset="paper", seeds=1)
    claim(folder, grid)
    restore(folder)
    signal.signal(signal.SIGTERM, lambda *_: os._exit(143))  # jobs stop when their parent is gone
    with ThreadPoolExecutor(workers) as pool:
        jobs = grid.jobs()
        list(pool.map(lambda number: work(folder, jobs, number), order(grid)))


if __name__ == "__main__":
    program("recipe", main, __doc__)
