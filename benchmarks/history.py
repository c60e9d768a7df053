"""A table of speeds by commit, so that a slower one is seen.

python -m benchmarks.history [--against COMMIT] [--rounds N]

Measures the commit that is checked out and another one (default: the one before it) in turn, N
times each, every time in a process of its own, and appends a row for both to results/history.csv.
It prints the ratio of each figure and ends with status 1 if one got slower by more than `SLOWER`
and by more than the rounds differ: a machine that others share has slow spells.
"""

import argparse
import csv
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from statistics import median

from salpchain.errors import InputError
from salpchain.files import write_text
from salpchain.machine import processor

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).parent / "results" / "history.csv"
PROBE = Path(__file__).parent / "probe.py"
SLOWER = 0.1  # share by which a figure must have got worse to be told (chosen)
ROUNDS = 3
JAX_SETTINGS = ("JAX_COMPILATION_CACHE_DIR", "XLA_FLAGS")  # of the caller, left out
Figures = dict[str, list[float]]  # of each figure, a number for each round


def commit_of(name: str) -> str:
    """The abbreviated hash of a commit.

    Raises:
        InputError: there is none of this name.
    """
    asked = ["git", "rev-parse", "--short=9", "--verify", "--quiet", f"{name}^{{commit}}"]
    found = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True)
    if found.returncode:
        raise InputError(f"--against must be a commit of this repository, got {name}")
    return found.stdout.strip()


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """A folder with the files of a commit, as long as it is needed."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / commit
        tree = ["git", "worktree"]
        subprocess.run([*tree, "add", "--quiet", "--detach", place, commit], cwd=ROOT, check=True)
        try:
            yield place
        finally:
            subprocess.run([*tree, "remove", "--force", place], cwd=ROOT, check=True)


def probed(place: Path) -> dict[str, float]:
    """The figures of the package in this folder, from a process of its own.

    Raises:
        InputError: it cannot be measured; the message has the last line of its error.
    """
    command = [sys.executable, str(PROBE)]
    there = {name: value for name, value in os.environ.items() if name not in JAX_SETTINGS}
    there |= {"PYTHONPATH": str(place), "SALPCHAIN_CACHE": "off"}
    done = subprocess.run(command, cwd=place, env=there, capture_output=True, text=True)
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"{place.name} cannot be measured: {why}")
    return json.loads(done.stdout.splitlines()[-1])


def in_turn(places: Sequence[Path], rounds: int) -> list[Figures]:
    """The figures of the packages in these folders, `rounds` times each, in turn."""
    seen: list[Figures] = [{} for _ in places]
    for number in range(rounds):
        for figures, place in zip(seen, places, strict=True):
            for name, value in probed(place).items():
                figures.setdefault(name, []).append(value)
            print(f"round {number + 1} of {rounds}: {place.name}", flush=True)
    return seen


def slower(before: Sequence[float], after: Sequence[float]) -> bool:
    """Whether seconds grew by more than `SLOWER`, and the rounds of both do not overlap."""
    return median(after) > (1 + SLOWER) * median(before) and min(after) > max(before)


def append(rows: Sequence[dict[str, object]], path: Path = TABLE) -> None:
    """Adds rows to the table; a figure that older rows lack is empty there."""
    kept: list[dict[str, object]] = []
    if path.exists():
        with path.open(newline="") as file:
            kept = list(csv.DictReader(file))
    every = [*kept, *rows]
    names = list(dict.fromkeys(name for row in every for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(every)
    write_text(path, text.getvalue())


def main() -> int:
    """Measures two commits, tells how they differ, and appends both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", default="HEAD~1", help="a commit (default: the one before)")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"default: {ROUNDS}")
    options = parser.parse_args()
    if options.rounds < 1:
        raise InputError(f"--rounds must be 1 or more, got {options.rounds}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # folders are taken away all the same
    commits = [commit_of(options.against), commit_of("HEAD")]
    with checked_out(commits[0]) as old, checked_out(commits[1]) as new:
        before, after = in_turn([old, new], options.rounds)
    worse = 0
    for name in after:
        if name not in before:
            continue
        worse += slower(before[name], after[name])
        mark = "  SLOWER" if slower(before[name], after[name]) else ""
        was, now = median(before[name]), median(after[name])
        print(f"{name:36} {was:9.3g} s -> {now:9.3g} s  {was / now:6.2f} times as fast{mark}")
    about = {"date": date.today().isoformat(), "processor": processor(), "cores": os.cpu_count()}
    append(
        [
            {"commit": commit, **about, **{name: f"{median(x):.4g}" for name, x in seen.items()}}
            for commit, seen in zip(commits, (before, after), strict=True)
        ]
    )
    return 1 if worse else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        print(f"benchmarks.history: error: {error}", file=sys.stderr)
        sys.exit(2)
