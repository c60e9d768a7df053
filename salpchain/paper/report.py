"""What came out of a study: its figures, tables and report, in FOLDER/report/.

Made anew from the results whenever a study ends; of an unfinished one, from its whole runs.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE as TESTS_FILE
from salpchain.files import StrPath, read_json, write_json, write_text
from salpchain.paper.claims import ABOUT_CLAIMS, Claim, facts, judge
from salpchain.paper.comparison import beside_figure_3, beside_figure_4
from salpchain.paper.figures import figure_3, figure_4
from salpchain.paper.grid import Grid, Job
from salpchain.paper.results import is_trained, run_of, untested
from salpchain.paper.tables import Entry, breakpoint_of, reach_of, zero_shot_table
from salpchain.report.pages import Report, Table, write_report
from salpchain.training.run_folder import CONFIG_FILE, METRICS_FILE, SUMMARY_FILE

REPORT = "report"
VERDICTS = {True: "held", False: "did not hold", None: "cannot tell"}
BARS = (
    "Mean over seeds; bars: in the top row the standard deviation over seeds, below 95 % intervals"
    " over seeds (Student's, so they may pass 100 %; of one seed, over its trials). Dotted: the"
    " paper's 90 %. Dashed: the training length. Grey: a controller that does nothing, the share"
    " that physics allows, and hand-written greedy."
)
NOISE = (
    " Where all close nearly all of the distance, paper-normalised, which spreads each curve from 0"
    " to 1, shows little but chance."
)
CURVES = (
    "Figure 3: learning curves, normalised in each panel, mean over seeds ± standard error. An"
    " episode counts when it has ended; chains that run to the time limit end together, hence the"
    " steps."
)
PAPER_LIMIT = "fixed"  # the paper's time limit, by which its claims are judged


def write_outcome(folder: StrPath, grid: Grid) -> Path:
    """Figures, tables and report of all runs that are whole; returns the report's page.

    Raises:
        InputError: no run is whole, or a result cannot be read.
    """
    folder = Path(folder)
    entries = [_entry(folder, job) for job in grid.jobs() if is_trained(folder, job)]
    if not entries:
        raise InputError(f"{folder} has no whole run yet")
    paper_limit = PAPER_LIMIT if PAPER_LIMIT in grid.time_limits else grid.time_limits[0]
    claims = judge(facts(entries, paper_limit))
    place = folder / REPORT
    place.mkdir(exist_ok=True)
    training = _training(folder, grid)
    write_text(place / "training.csv", training.to_csv(index=False))
    for limit in grid.time_limits:
        table = zero_shot_table(entries, limit)
        write_text(place / f"zero-shot-{limit}.csv", table.to_csv(index=False))
    write_json(place / "study.json", _record(grid, training, claims))
    tested = any(_has_tests(entries, limit) for limit in grid.time_limits)
    tables = [
        _training_page(training),
        *(_reach_page(entries, t) for t in grid.time_limits),
        beside_figure_3(entries),
        *([beside_figure_4(entries, paper_limit)] if _has_tests(entries, paper_limit) else []),
    ]
    tables = [table for table in tables if table.rows]
    report = Report(
        title="The paper, repeated",
        verdict=_verdict(claims, len(entries), len(grid.jobs())),
        about=_about(grid, training, tested),
        tables=[claims_table(claims), *tables],
        figures=_draw(folder, entries, grid, place),
    )
    return write_report(report, place)[1]


def claims_table(claims: Sequence[Claim]) -> Table:
    """Each claim with its verdict and its evidence."""
    rows = [[c.text, VERDICTS[c.held], c.evidence, c.where] for c in claims]
    columns = ["claim", "here", "evidence", "in the paper"]
    return Table("The paper's claims", columns, rows, ABOUT_CLAIMS, words=True)


def _entry(folder: Path, job: Job) -> Entry:
    run, control, task = run_of(folder, job), job.config.control, job.config.task
    missing = untested(folder, job)
    return Entry(
        model=control.model,
        graph="" if job.config.policy_name.startswith("mlp") else control.graph,
        length=task.length,
        seed=job.config.seed,
        log=_log(run / METRICS_FILE),
        settled=job.config.ppo.envs * task.step_limit,
        tests={
            limit: read_json(run / limit / TESTS_FILE)
            for limit in job.tests
            if limit not in missing
        },
    )


def _log(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a log of a run ({error})") from None


def _training(folder: Path, grid: Grid) -> Any:
    """A row for each whole run: what it is, what it took, how well it does at its own length."""
    rows = []
    for job in grid.jobs():
        if not is_trained(folder, job):
            continue
        run = run_of(folder, job)
        summary, device = read_json(run / SUMMARY_FILE), read_json(run / CONFIG_FILE)["device"]
        first = summary.get("reached_95_percent") or {}
        rows.append(
            {
                "controller": job.config.policy_name,
                "length": job.config.task.length,
                "seed": job.config.seed,
                "steps": summary["steps"],
                "seconds": summary["seconds"],
                "steps_to_95_percent": first.get("steps"),
                "success_in_training": summary.get("in_training", summary)["success"],
                **_own_tests(run, job),
                "device": device,
            }
        )
    return pd.DataFrame(rows)


def _own_tests(run: Path, job: Job) -> dict[str, float | None]:
    """Tests at the training length with the paper's time limit."""
    path = run / PAPER_LIMIT / TESTS_FILE
    own = job.config.task.length
    tests = read_json(path)["lengths"] if path.exists() else []
    row = next((x for x in tests if x["length"] == own), None)
    return {
        "success": row["success"]["mean"] if row else None,
        "closed_fraction": row["closed_fraction"]["mean"] if row else None,
    }


def _record(grid: Grid, training: Any, claims: Sequence[Claim]) -> dict[str, Any]:
    return {
        "grid": dataclasses.asdict(grid),
        "runs": len(training),
        "of": len(grid.jobs()),
        "machine_hours": round(float(training["seconds"].sum()) / 3600, 2),
        "claims": [dataclasses.asdict(claim) for claim in claims],
    }


def _draw(folder: Path, entries: Sequence[Entry], grid: Grid, place: Path) -> dict[str, Path]:
    """The figures, by what is written below them."""
    drawn = {CURVES: figure_3(entries, place / "figure-3.png")[0]}
    for limit in grid.time_limits:
        if _has_tests(entries, limit):
            tests = folder / "greedy" / limit / TESTS_FILE
            baseline = read_json(tests) if tests.exists() else None
            caption = f"Figure 4: zero-shot tests, {limit} time limit. {BARS}"
            caption += "" if limit == PAPER_LIMIT else NOISE
            path = place / f"figure-4-{limit}.png"
            drawn[caption] = figure_4(entries, limit, path, baseline)[0]
    return drawn


def _has_tests(entries: Sequence[Entry], limit: str) -> bool:
    """Whether some graph controller was tested with this time limit."""
    return any(entry.model != "mlp" and limit in entry.tests for entry in entries)


def _verdict(claims: Sequence[Claim], done: int, jobs: int) -> str:
    """One line: how the paper's claims fared, and whether that is the last word."""
    held, fallen, open_ = (sum(claim.held is x for claim in claims) for x in (True, False, None))
    whole = (
        f"all {jobs} runs are whole" if done == jobs else f"so far {done} of {jobs} runs are whole"
    )
    return (
        f"{held} of the paper's {len(claims)} claims held here, {fallen} did not and {open_}"
        f" cannot be told; {whole}."
    )


def _about(grid: Grid, training: Any, tested: bool) -> list[str]:
    """What was run, and how to read what follows."""
    devices = _and(sorted(set(training["device"])))
    models = f"{_count(len(grid.models), 'model')} ({', '.join(grid.models)})"
    paragraphs = [
        f"Preset {grid.changed_preset}, {models},"
        f" trained on {_and(grid.lengths)} units with {_count(grid.seeds, 'seed')} each, and"
        f" {_count(grid.trials, 'trial')} for each test length. The trainings took"
        f" {_duration(float(training['seconds'].sum()))} in all, on {devices}.",
    ]
    if tested:
        paragraphs += [
            "The claims are judged by the paper's time limit, under which long chains cannot reach"
            " all targets even at top speed: Figure 4 shows what physics allows.",
            "`paper-normalised` rescales each controller by its own best and worst length, as the"
            " paper does: it shows where a controller breaks down, and compares none with another."
            " One that does nothing at all falls along the grey line.",
        ]
    return paragraphs


def _and(values: Sequence[Any]) -> str:
    """The values in words."""
    *more, last = map(str, values)
    return f"{', '.join(more)} and {last}" if more else last


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def _duration(seconds: float) -> str:
    """Hours, or minutes where they are few."""
    if seconds < 3600:
        return _count(max(1, round(seconds / 60)), "minute")
    return f"{seconds / 3600:.1f} hours"


def _training_page(training: Any) -> Table:
    rows = []
    for (name, length), some in training.groupby(["controller", "length"], sort=False):
        rows.append(
            [
                str(name),
                str(length),
                str(len(some)),
                _spread(100 * some["success_in_training"], 1, " %"),
                _spread(100 * some["success"].astype(float), 1, " %"),
                _spread(some["seconds"] / 60, 1, " min"),
            ]
        )
    columns = ["controller", "units", "seeds", "success in training", "success in tests", "time"]
    note = (
        "Median over seeds, in brackets the lowest and the highest. In training: the sampled"
        " policy, over the latest 200 episodes or more. In tests: the deterministic policy, with"
        " the paper's time limit."
    )
    return Table("At the training length", columns, rows, note)


def _spread(values: Any, digits: int, unit: str) -> str:
    """Median (lowest to highest)."""
    values = values.dropna()
    if values.empty:
        return "-"
    low, mid, high = (f"{x:.{digits}f}" for x in (values.min(), values.median(), values.max()))
    return f"{mid}{unit}" if len(values) == 1 else f"{mid}{unit} ({low} to {high})"


def _reach_page(entries: Sequence[Entry], limit: str) -> Table:
    """Which lengths each controller serves; with the paper's limit also its own measure."""
    table: Any = zero_shot_table([e for e in entries if e.model != "mlp"], limit)
    papers = limit == PAPER_LIMIT
    rows = []
    groups = table.groupby(["controller", "length"], sort=False) if len(table) else ()
    for (name, length), some in groups:
        reach = (reach_of(some, m, int(length)) for m in ("closed_fraction", "success"))
        end = breakpoint_of(some, "paper_normalised") or "none"
        shown = ["none" if r is None else f"{r[0]} to {r[1]}" for r in reach]
        rows.append([str(name), str(length), *shown, *([f"up to {end}"] if papers else [])])
    measures = ["90 % closed", "90 % success", *(["90 % paper-normalised"] if papers else [])]
    note = "Units, around the training length, at which the mean over seeds is 90 % or more."
    if rows:
        note += f" The tests span {table['at'].min()} to {table['at'].max()} units."
    columns = ["controller", "trained on", *measures]
    return Table(f"How far it transfers, {limit} time limit", columns, rows, note)
