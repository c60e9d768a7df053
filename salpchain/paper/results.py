"""What of a study is done: read from its files alone, so that it can be killed at any time.

FOLDER/grid.json                             the grid
FOLDER/runs/gcn-mixed-8/seed-0/              a run folder, as `salpchain train` makes it
FOLDER/runs/gcn-mixed-8/seed-0/fixed/        its tests, as `salpchain evaluate` makes them
FOLDER/greedy/fixed/                         the same of the baseline
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from salpchain.controllers.storage import POLICY_FILE
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE as TESTS_FILE
from salpchain.files import StrPath, read_arrays, read_json
from salpchain.paper.grid import Grid, Job
from salpchain.training.checkpoint import CHECKPOINT_FILE
from salpchain.training.run_folder import METRICS_FILE, SUMMARY_FILE, is_free, read_config, read_log

READ_OF_TESTS = ("success", "closed_fraction", "final_distance", "reachable", "start_distance")
SET_ASIDE = ".damaged"
ANY_VERSION = 10**6
TAIL = 4096  # bytes from the end of a log in which its last row is looked for (chosen)


def run_of(folder: StrPath, job: Job) -> Path:
    """The run folder of a job."""
    return Path(folder) / "runs" / job.name


def is_trained(folder: StrPath, job: Job) -> bool:
    """Whether the run is whole."""
    return (run_of(folder, job) / SUMMARY_FILE).exists()


def untested(folder: StrPath, job: Job) -> list[str]:
    """The time limits with which the run is still to be tested."""
    run = run_of(folder, job)
    return [limit for limit in job.tests if not (run / limit / TESTS_FILE).exists()]


def is_done(folder: StrPath, job: Job) -> bool:
    """Whether the run is whole, and tested with every time limit."""
    return is_trained(folder, job) and not untested(folder, job)


def baseline_untested(folder: StrPath, grid: Grid) -> list[str]:
    """The time limits with which the baseline is still to be tested."""
    place = Path(folder) / "greedy"
    return [t for t in grid.time_limits if not (place / t / TESTS_FILE).exists()]


def trained_share(folder: StrPath, job: Job) -> float:
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


def set_damaged_aside(folder: StrPath, grid: Grid) -> list[str]:
    """Renames results that cannot be what they should be; says of each what was wrong with it.

    What is renamed counts as not done. What has not begun is no damage.
    """
    found = []
    for job in grid.jobs():
        run = run_of(folder, job)
        found += _tests_aside(run, job.tests, grid.trials)
        tested = not untested(folder, job)
        wrong = _wrong(partial(_check_run, run, job, tested))
        found += [_set_aside(run, wrong)] if wrong else []
    baseline = dict.fromkeys(grid.time_limits, grid.tests)
    return found + _tests_aside(Path(folder) / "greedy", baseline, grid.trials)


def _tests_aside(place: Path, tests: dict[str, tuple[int, ...]], trials: int) -> list[str]:
    found = []
    for limit, lengths in tests.items():
        path = place / limit / TESTS_FILE
        wrong = _wrong(partial(_check_tests, path, lengths, trials, limit))
        found += [_set_aside(path.parent, wrong)] if wrong else []
    return found


def _wrong(check: Callable[[], None]) -> str:
    """What a check finds wrong; nothing if it passes."""
    try:
        check()
    except (InputError, OSError) as error:
        return str(error)
    return ""


def _set_aside(path: Path, wrong: str) -> str:
    names = (path.with_name(f"{path.name}{SET_ASIDE}{n or ''}") for n in range(10**6))
    free = next(name for name in names if not name.exists())
    path.rename(free)
    return f"{wrong}; set aside: {free}"


def _check_run(run: Path, job: Job, tested: bool) -> None:
    """Check every file that a started run still needs.

    Its checkpoint while it trains, its policy until it is tested: a study can be kept, and gone on
    with elsewhere, without the weights of what is done, and nothing is done again for their sake.
    """
    if is_free(run):
        return
    if read_config(run)[0] != job.config:
        raise InputError(f"{run} was trained with other settings than those of the study")
    whole, checkpoint = (run / SUMMARY_FILE).exists(), run / CHECKPOINT_FILE
    come = job.config.iterations if whole else 0
    if whole:
        _check_summary(run / SUMMARY_FILE)
    done = whole and tested
    if not done and (whole or (run / POLICY_FILE).exists()):
        _check_arrays(run / POLICY_FILE, "policy")
    if not done and checkpoint.exists():
        come = max(come, _check_arrays(checkpoint, "checkpoint").get("iteration", 0))
    if come:
        rows = [int(row["iteration"]) for row in read_log(run, remedy="")]
        if rows[:come] != list(range(1, come + 1)):
            raise InputError(f"{run / METRICS_FILE} is cut short: it should have {come} rows")


def _check_arrays(path: Path, kind: str) -> dict[str, Any]:
    header, arrays = read_arrays(path, kind, ANY_VERSION)
    if not arrays:
        raise InputError(f"{path} is not what it should be: it holds no arrays")
    return header


def _check_summary(path: Path) -> None:
    content = read_json(path)
    content = content if isinstance(content, dict) else {}
    for name in ("steps", "seconds"):
        if not _is_number(content.get(name)):
            raise _odd(path, f"it has no number {name!r}")
    success = content.get("success", path)
    if success is not None and not _is_number(success):  # no episode may have ended
        raise _odd(path, "it has no number 'success'")


def _check_tests(path: Path, lengths: Sequence[int], trials: int, limit: str) -> None:
    """Check that existing test results match the grid and are complete."""
    if not path.exists():
        return
    content = read_json(path)
    rows = content.get("lengths") if isinstance(content, dict) else None
    if not (isinstance(rows, list) and all(isinstance(row, dict) for row in rows)):
        raise _odd(path, "it has no list 'lengths'")
    found = [row.get("length") for row in rows]
    if found != sorted(lengths):
        raise _odd(path, f"it tests lengths {found}, the study {sorted(lengths)}")
    if content.get("time_limit") != limit:
        raise _odd(path, f"its time limit is {content.get('time_limit')!r}, not {limit!r}")
    for row in rows:
        if row.get("trials") != trials:
            raise _odd(path, f"it has {row.get('trials')} trials, the study {trials}")
        for name in READ_OF_TESTS:
            value = row.get(name)
            if not (isinstance(value, dict) and _is_number(value.get("mean"))):
                raise _odd(path, f"its length {row['length']} has no mean {name!r}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _odd(path: Path, why: str) -> InputError:
    return InputError(f"{path} is not what it should be: {why}")
