"""The process of `jobs`: trains or goes on training, then tests.

python -m salpchain.paper.job FOLDER NUMBER[,NUMBER...] [DEVICES]

NUMBER counts the grid's jobs; the one past them is the baseline's tests. Several jobs are seeds of
one configuration, which train side by side. Whatever is whole already is left as it is.
"""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from salpchain.controllers.greedy import Greedy
from salpchain.controllers.policy import Controller
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.evaluate import evaluate_limits
from salpchain.files import StrPath
from salpchain.paper.grid import TEST_SEED, Grid, Job, read_grid
from salpchain.paper.results import baseline_untested, is_trained, run_of, untested
from salpchain.training.metrics import NotFiniteError
from salpchain.training.trainer import train_together

PATIENCE = 300.0  # s for a process whose parent died to save and let go of its run (chosen)

Lengths = tuple[int, ...]


def do_jobs(folder: StrPath, grid: Grid, jobs: Sequence[Job], devices: int | None = None) -> None:
    """Everything of some jobs, which differ in their seeds alone, that is not done yet.

    Raises:
        InputError: a damaged file.
        NotFiniteError: a training blew up; the other jobs are whole.
        KeyboardInterrupt: asked to stop; the trainings are saved.
    """
    use_devices(devices)
    broken = None
    fresh = [job for job in jobs if not is_trained(folder, job)]
    if fresh:
        runs, stop = [run_of(folder, job) for job in fresh], _stop_with_parent()
        try:
            train_together(
                [x.config for x in fresh], runs, on_iteration=stop, devices=devices,
                patience=PATIENCE,
            )  # fmt: skip
        except NotFiniteError as error:
            broken = error
    for job in (job for job in jobs if is_trained(folder, job)):
        run, limits = run_of(folder, job), untested(folder, job)
        if limits:
            _test(load(run), job.tests[limits[0]], limits, grid, run)
    if broken:
        raise broken


def do_baseline(folder: StrPath, grid: Grid, devices: int | None = None) -> None:
    """The greedy controller's tests that are not done yet."""
    use_devices(devices)
    limits = baseline_untested(folder, grid)
    if limits:
        _test(Greedy(), grid.tests, limits, grid, Path(folder) / "greedy")


def _test(
    controller: Controller, lengths: Lengths, limits: Sequence[str], grid: Grid, place: Path
) -> None:
    evaluate_limits(
        controller, lengths, grid.trials, limits, TEST_SEED, place,
        progress=_stop_with_parent(),
    )  # fmt: skip


def _stop_with_parent() -> Callable[..., None]:
    """A watcher that interrupts this process once the one that started it has died."""
    parent = os.getppid()

    def watch(*_: object) -> None:
        if os.getppid() != parent:
            raise KeyboardInterrupt

    return watch


def main() -> None:
    """Does the jobs that the command line names.

    An interrupt stops it also where the study runs in the background, whose processes ignore it.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder, numbers = Path(sys.argv[1]), [int(word) for word in sys.argv[2].split(",")]
    devices = int(sys.argv[3]) if len(sys.argv) > 3 else None
    grid = read_grid(folder)
    jobs = grid.jobs()
    try:
        if numbers == [len(jobs)]:
            do_baseline(folder, grid, devices)
        else:
            do_jobs(folder, grid, [jobs[number] for number in numbers], devices)
    except KeyboardInterrupt:
        sys.exit(130)
    except (InputError, NotFiniteError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
