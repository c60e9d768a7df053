"""What a study of the paper has no room for: python -m studies.bars.run STUDY OUT

Plays the graph models on `mixed` of a study that `salpchain reproduce` made (with their weights)
in 200 fresh episodes at their training length, and those trained on the longest at 96 and 128
units. Writes OUT/results/bars.csv, a row for each run and test, and OUT/report.md, means over
seeds. What is there is kept: stopped, it goes on.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from salpchain.archive import restore
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.experiments.results import REPORT_FILE, RESULTS, add_part, claim, results_of
from salpchain.files import read_json, write_text
from salpchain.paper.grid import GRID_FILE, Job, read_grid
from salpchain.paper.results import is_trained, run_of
from studies import program

SEED = 2002  # of the starts that judge (chosen)
LONGER = (96, 128)  # units


@dataclass(frozen=True)
class Test:
    """What a run is put to."""

    length: int
    trials: int
    time_limit: str


def tests_of(job: Job, longest: int) -> Iterator[Test]:
    """200 episodes of the paper's task; and far longer chains for those trained on the longest."""
    yield Test(job.config.task.length, 200, "fixed")
    if job.config.task.length == longest:
        yield from (Test(n, 50, "scaled") for n in LONGER)


def study(folder: Path, out: Path) -> None:
    """All tests that are missing, of all runs that are whole."""
    grid, results = read_grid(folder), results_of(out)
    same = read_json(folder / GRID_FILE)["grid"]
    del same["seeds"]  # a study may be given more
    claim(results, "bars", seed=SEED, grid=same)
    restore(folder)
    jobs = [job for job in grid.jobs() if job.config.control.graph == "mixed"]
    for job in jobs:
        if job.config.control.model == "mlp" or not is_trained(folder, job):
            continue
        for test in tests_of(job, max(grid.lengths)):
            part = {"run": job.name, **vars(test)}
            add_part(results / "bars.csv", part, lambda j=job, t=test: play(run_of(folder, j), t))
            write_text(out / REPORT_FILE, report(out))


def play(run: Path, test: Test) -> pd.DataFrame:
    """One row: the share of episodes that reached the goal, and of the distance that was closed."""
    use_devices()
    (trials,) = run_trials([load(run)], test.length, test.trials, test.time_limit, SEED)
    name = f"{run.parent.name}/{run.name}"
    means = {key: [trials[key].mean()] for key in ("success", "closed_fraction")}
    return pd.DataFrame({"run": name, **vars(test), **means})


def report(out: Path) -> str:
    """Means over seeds, in brackets the lowest and the highest."""
    rows = pd.read_csv(out / RESULTS / "bars.csv")
    rows["controller"] = rows.run.str.split("/").str[0]
    lines = [
        f"Deterministic policies, fresh starts (seed {SEED}), mean over seeds (lowest to highest).",
        "",
        "| controller | units | time limit | seeds x episodes | success, % | distance closed, % |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for key, frame in rows.groupby(["controller", "length", "time_limit", "trials"], sort=False):
        name, length, limit, trials = key
        shown = (_spread(frame[column]) for column in ("success", "closed_fraction"))
        cells = [name, length, limit, f"{len(frame)} x {trials}", *shown]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


def _spread(values: pd.Series) -> str:
    return f"{100 * values.mean():.1f} ({100 * values.min():.1f} to {100 * values.max():.1f})"


def main() -> None:
    """Tests the runs of the study that the command line names."""
    if len(sys.argv) != 3:
        raise InputError("give a study and a folder: python -m studies.bars.run STUDY OUT")
    study(Path(sys.argv[1]), Path(sys.argv[2]))


if __name__ == "__main__":
    program("bars", main, __doc__)
