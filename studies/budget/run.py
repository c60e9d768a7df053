"""What do luck, more compute or a larger model buy? python -m studies.budget.run OUT [NAME ...]

Trains the recipe of `any-length` with other seeds, with ten times the chain-steps and with the
graph transformer; tests each, unchanged, at the lengths that releases are tested at, and writes
OUT/report.md and in OUT/results/ the runs (NAME/seed-S/: settings, log, evaluation) and budget.csv.
The seeds of a name train side by side in one program, on an accelerator in little more time than
one. What is there is kept: stopped, it goes on.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from salpchain.archive import restore
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE
from salpchain.evaluation.evaluate import evaluate
from salpchain.experiments.results import REPORT_FILE, RESULTS, claim, results_of
from salpchain.files import read_json, write_text
from salpchain.training import run_folder
from salpchain.training.config import TrainConfig
from salpchain.training.trainer import train_together
from studies import check_same, program, run_of
from studies.release.run import LENGTHS, any_length

TRIALS = 200
SEED = 5000  # of the starts that judge (chosen)
LIMIT = "scaled"
MEASURES = {  # of each run and length: which statistic of which measure
    "success": "mean",
    "closed_fraction": "mean",
    "steps_to_goal": "median",
}


@dataclass(frozen=True)
class Way:
    """One way to spend a budget, with the seeds that are tried."""

    config: TrainConfig
    seeds: tuple[int, ...] = (0,)


def wider(config: TrainConfig, times: int) -> TrainConfig:
    """As many updates, each from so many times as many chains."""
    ppo = config.ppo
    more = replace(ppo, envs=times * ppo.envs, minibatch=times * ppo.minibatch)
    return replace(config, ppo=more, steps=times * config.steps)


def transformer(config: TrainConfig) -> TrainConfig:
    """The same with the graph transformer."""
    return replace(config, control=replace(config.control, model="gt", improved=False))


WAYS = {
    "any-length": Way(any_length(), (0, 1, 2)),
    "ten times the steps": Way(wider(any_length(), 10)),
    "gt": Way(transformer(any_length())),
}


def train_all(out: Path, name: str) -> None:
    """Trains all seeds of one way that are not tested yet, or goes on training them."""
    runs = {seed: run_of(out / RESULTS, name, seed) for seed in WAYS[name].seeds}
    runs = {seed: run for seed, run in runs.items() if not (run / SUMMARY_FILE).exists()}
    if not runs:
        return
    configs = [replace(WAYS[name].config, seed=seed) for seed in runs]
    for config, run in zip(configs, runs.values(), strict=True):
        check_same(config, run)
    train_together(configs, list(runs.values()), devices=1)


def test_all(out: Path, name: str) -> None:
    """Tests all seeds of one way that are not tested, and reports."""
    for seed in WAYS[name].seeds:
        run = run_of(out / RESULTS, name, seed)
        if not (run / SUMMARY_FILE).exists():
            evaluate(load(run), LENGTHS, TRIALS, LIMIT, SEED, run, baseline=False)
        write_report(out)


def write_report(out: Path) -> None:
    """One row for each way, seed and length; and a table of each measure."""
    rows = []
    for name, way in WAYS.items():
        for seed in way.seeds:
            run = run_of(out / RESULTS, name, seed)
            if not (run / SUMMARY_FILE).exists():
                continue
            trained = read_json(run / run_folder.SUMMARY_FILE)
            about = {"way": name, "seed": seed, "steps": trained["steps"]}
            for row in read_json(run / SUMMARY_FILE)["lengths"]:
                seen = {key: row[key][statistic] for key, statistic in MEASURES.items()}
                rows.append({**about, "length": row["length"], **seen})
    table = pd.DataFrame(rows)
    write_text(out / RESULTS / "budget.csv", table.to_csv(index=False))
    write_text(out / REPORT_FILE, as_markdown(table))


def as_markdown(table: pd.DataFrame) -> str:
    """Success, closed fraction and steps to the goal of each run, by length."""
    lines = [
        "# What luck, more compute or a larger model buy",
        "",
        f"Trained on 2 to 16 units; {TRIALS} episodes of each length, time limit `{LIMIT}`.",
    ]
    titles = ("Success, percent", "Closed, percent", "Steps to the goal, median")
    for measure, title, factor, form in zip(
        MEASURES, titles, (100, 100, 1), (".1f", ".1f", ".0f"), strict=True
    ):
        lines += [
            "",
            f"## {title}",
            "",
            "| trained | steps | " + " | ".join(f"{n} units" for n in LENGTHS) + " |",
            "| --- | --- |" + " --- |" * len(LENGTHS),
        ]
        for (way, seed, steps), frame in table.groupby(["way", "seed", "steps"], sort=False):
            by_length = factor * frame.set_index("length")[measure]
            cells = " | ".join(f"{by_length[n]:{form}}" for n in LENGTHS)
            lines.append(f"| {way}, seed {seed} | {steps:,} | {cells} |")
    return "\n".join([*lines, ""])


def main() -> None:
    """Trains and tests the ways that the command line names, or all."""
    folder, *names = sys.argv[1:] or [""]
    if not folder or not set(names) <= set(WAYS):
        raise InputError(f"give a folder, and ways if not all: {', '.join(WAYS)}")
    use_devices()
    out = Path(folder)
    judge = {"lengths": LENGTHS, "trials": TRIALS, "seed": SEED, "time_limit": LIMIT}
    claim(results_of(out), "budget", **judge)
    restore(out / RESULTS)
    for name in names or WAYS:
        train_all(out, name)
        test_all(out, name)


if __name__ == "__main__":
    program("budget", main, __doc__)
