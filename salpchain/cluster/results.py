"""What of a study is done: read from its files alone, so that it can be killed at any time.

FOLDER/grid.json                             the grid
FOLDER/runs/gcn-mixed-8/seed-0/              a run folder, as `salpchain train` makes it
FOLDER/runs/gcn-mixed-8/seed-0/fixed/        its tests, as `salpchain evaluate` makes them
FOLDER/greedy/fixed/                         the same of the baseline
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from salpchain.cluster.grid import Grid, Job
from salpchain.control.storage import POLICY_FILE
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE as TESTS_FILE
from salpchain.files import read_arrays, read_json
from salpchain.training.checkpoint import CHECKPOINT_FILE
from salpchain.training.run_folder import METRICS_FILE, SUMMARY_FILE

SET_ASIDE = ".damaged"
ANY_VERSION = 10**6
TAIL = 4096  # bytes from the end of a log in which its last row is looked for (chosen)


def run_of(folder: Path, job: Job) -> Path:
    """The run folder of a job."""
    return folder / "runs" / job.name


def is_trained(folder: Path, job: Job) -> bool:
    """Whether the run is whole."""
    return (run_of(folder, job) / SUMMARY_FILE).exists()


def untested(folder: Path, job: Job) -> list[str]:
    """The time limits with which the run is still to be tested."""
    run = run_of(folder, job)
    return [limit for limit in job.tests if not (run / limit / TESTS_FILE).exists()]


def baseline_untested(folder: Path, grid: Grid) -> list[str]:
    """The time limits with which the baseline is still to be tested."""
    return [t for t in grid.time_limits if not (folder / "greedy" / t / TESTS_FILE).exists()]


def trained_share(folder: Path, job: Job) -> float:
    """How much of a training is done, from the last row of its log."""
    if is_trained(folder, job):
        return 1.0
    path = run_of(folder, job) / METRICS_FILE
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - TAIL))
            rows = file.read().decode(errors="replace").split("\n")
        iteration = float(rows[-2].split(",")[0])
    except (OSError, ValueError, IndexError):
        return 0.0
    return min(iteration / job.config.iterations, 1.0)


def set_damaged_aside(folder: Path, grid: Grid) -> list[str]:
    """Renames results that cannot be read; says of each what was wrong with it.

    What is renamed counts as not done. Files that are missing are no damage.
    """
    found = []
    for job in grid.jobs():
        run = run_of(folder, job)
        wrong = _wrong(run / SUMMARY_FILE, _is_summary) or _wrong(run / POLICY_FILE, _is_policy)
        wrong = wrong or _wrong(run / CHECKPOINT_FILE, _is_checkpoint)
        found += [_set_aside(run, wrong)] if wrong else []
        found += _tests_aside(run, tuple(job.tests))
    return found + _tests_aside(folder / "greedy", grid.time_limits)


def _tests_aside(place: Path, time_limits: Sequence[str]) -> list[str]:
    wrong = {limit: _wrong(place / limit / TESTS_FILE, _is_tests) for limit in time_limits}
    return [_set_aside(place / limit, text) for limit, text in wrong.items() if text]


def _wrong(path: Path, is_good: Callable[[Path], bool]) -> str:
    """What is wrong with a file; nothing if it is good or missing."""
    try:
        good = not path.exists() or is_good(path)
    except InputError as error:
        return str(error)
    return "" if good else f"{path} is not what it should be"


def _set_aside(path: Path, wrong: str) -> str:
    names = (path.with_name(f"{path.name}{SET_ASIDE}{n or ''}") for n in range(10**6))
    free = next(name for name in names if not name.exists())
    path.rename(free)
    return f"{wrong}; set aside: {free}"


def _is_summary(path: Path) -> bool:
    content = read_json(path)
    return isinstance(content, dict) and {"steps", "seconds", "success"} <= content.keys()


def _is_policy(path: Path) -> bool:
    return bool(read_arrays(path, "policy", ANY_VERSION)[1])


def _is_checkpoint(path: Path) -> bool:
    return bool(read_arrays(path, "checkpoint", ANY_VERSION)[1])


def _is_tests(path: Path) -> bool:
    content = read_json(path)
    if not (isinstance(content, dict) and isinstance(content.get("lengths"), list)):
        return False
    needed = {"length", "success", "closed_fraction", "final_distance"}
    return all(isinstance(e, dict) and needed <= e.keys() for e in content["lengths"])
