"""What makes a controller general? One factor at a time: python -m studies.factors.run OUT [SEEDS]

Trains each variant with each seed (default 3) for the same number of steps, tests it unchanged at
lengths from 2 to 64, and writes OUT/report.md and in OUT/results/ the runs (VARIANT/seed-S/:
settings, log, evaluation), factors.csv and factors.png. One run on each core at a time. What is
there is kept: stopped, it goes on. Weights are not needed afterwards.
"""

import io
import os
import sys
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import false_discovery_control, ttest_ind

from salpchain.archive import restore
from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE
from salpchain.evaluation.evaluate import evaluate
from salpchain.experiments.results import REPORT_FILE, RESULTS, claim, results_of
from salpchain.files import make_writable, read_json, write_bytes, write_text
from salpchain.machine import jobs_that_fit
from salpchain.report.style import STYLE
from salpchain.tasks.config import GOAL_LIMIT
from salpchain.training import presets
from salpchain.training.config import Mix, TrainConfig
from studies import check_same, program, run_of, train_or_go_on

STEPS = 1_500_000  # of every variant: half of what `--length 2..16` takes
LENGTHS = (2, 4, 8, 16, 32, 64)
TRIALS = 100
SEED = 4000  # of the starts that judge (chosen)
LIMIT = "scaled"
GROUPS = ((2, 4, 8, 16), (32, 64))  # lengths that base was trained on, and beyond
ALL = tuple(range(2, 17))  # units
AGAINST = {"trained on 16, a log-std for each unit": "trained on 16"}  # else against base
FALSE = 0.05  # rate of false discoveries among the differences that are told from chance
COLOURED = 30  # points of gain or loss with the strongest colour


def variant(
    lengths: tuple[int, ...] = ALL, weights: tuple[float, ...] = (), **changes: dict[str, Any]
) -> TrainConfig:
    """The base, `quick` on several lengths, with some settings changed."""
    config = presets.choose("quick", mix=Mix(ALL), steps=STEPS)
    parts = {name: replace(getattr(config, name), **new) for name, new in changes.items()}
    task = replace(parts.pop("task", config.task), length=lengths[-1])
    mix = Mix(lengths, weights) if len(lengths) > 1 else Mix()
    return replace(config, task=task, mix=mix, **parts)


VARIANTS: dict[str, TrainConfig] = {
    "base": variant(),
    "observation table1": variant(task={"observation": "table1"}),
    "observation body": variant(task={"observation": "body"}),
    "no place in the chain": variant(task={"observation": "anonymous"}),
    "far distances in metres": variant(task={"observation": "metric"}),
    "graph full": variant(control={"graph": "full"}),
    "graph near": variant(control={"graph": "near"}),
    "graph hub": variant(control={"graph": "hub"}),
    "four layers": variant(control={"depth": 4}),
    "a unit counts once": variant(control={"improved": False}),
    "model gatv2": variant(control={"model": "gatv2", "improved": False}),
    "model gt": variant(control={"model": "gt", "improved": False}),
    "ratio of the chain": variant(ppo={"ratio": "chain"}),
    "credit to each unit": variant(ppo={"credit": "unit"}),
    "no folded starts": variant(task={"folded": 0.0, "stalled": 0.0}),
    # as many folded starts, none of them on the target
    "no starts on the target": variant(task={"folded": 0.3, "stalled": 0.0}),
    "goal of 5 cm": variant(task={"tolerance": GOAL_LIMIT}),
    "no shaping": variant(task={"fine_weight": 0.0}),
    "no entropy": variant(ppo={"entropy": 0.0}),
    "entropy to the end": variant(ppo={"final_entropy": 1.0}),
    "time limit of 256 steps": variant(task={"most_steps": 256}),
    "time limit of 1024 steps": variant(task={"most_steps": 1024}),
    "more of the longer": variant(weights=tuple(map(float, ALL))),
    "trained on 8": variant((8,)),
    "trained on 16": variant((16,)),
    "trained on 16, a log-std for each unit": variant((16,), control={"shared_log_std": False}),
    "trained on 4 to 8": variant(tuple(range(4, 9))),
    "trained on 4 to 16": variant(tuple(range(4, 17))),
}


def study(out: Path, seeds: int, each: Callable[..., Iterable[None]] = map) -> None:
    """All runs that are missing, seed by seed; after each, the report.

    `each`: `map`, or what does the same with several processes, in any order.
    """
    results = results_of(out)
    runs = [
        (run_of(results, name, seed), replace(config, seed=seed))
        for seed in range(seeds)
        for name, config in VARIANTS.items()
    ]
    judge = {"lengths": LENGTHS, "trials": TRIALS, "seed": SEED, "time_limit": LIMIT}
    claim(results, "factors", steps=STEPS, **judge)
    restore(results)
    for run, config in runs:
        check_same(config, run)
    missing = [run for run in runs if not (run[0] / SUMMARY_FILE).exists()]
    for _ in each(run_one, missing):
        write_report(out)
    write_report(out)


def run_one(what: tuple[Path, TrainConfig]) -> None:
    """Trains and tests one variant with one seed, on one core, as far as that is not done."""
    run, config = what
    print(run, flush=True)
    try:
        train_or_go_on(config, run)
        evaluate(load(run), LENGTHS, TRIALS, LIMIT, SEED, run, baseline=False)
    except KeyboardInterrupt:
        sys.exit(130)  # without a word: the process that started this one says it


def write_report(out: Path) -> None:
    """One row for each variant, seed and length; and a table of means over seeds."""
    results, rows = out / RESULTS, []
    for name in VARIANTS:
        for path in sorted(run_of(results, name, 0).parent.glob(f"seed-*/{SUMMARY_FILE}")):
            about = {"variant": name, "seed": path.parent.name}
            for row in read_json(path)["lengths"]:
                means = {key: row[key]["mean"] for key in ("success", "closed_fraction")}
                rows.append({**about, "length": row["length"], **means})
    table = pd.DataFrame(rows)
    write_text(results / "factors.csv", table.to_csv(index=False))
    write_text(out / REPORT_FILE, as_markdown(table))
    write_bytes(results / "factors.png", as_picture(table))


def as_markdown(table: pd.DataFrame) -> str:
    """What each change costs or buys, with intervals; then mean success by length."""
    steps = f"{STEPS:,} steps each, {TRIALS} episodes of each length, time limit `{LIMIT}`"
    return "\n".join(
        [
            "# What makes a controller hold at any length",
            "",
            "`gcn` on `mixed` with `proximity`, trained on 2 to 16 units, one factor changed at a"
            f" time: {steps}. `no starts on the target` has as many folded starts all the same.",
            "",
            *_what_each_buys(table),
            "",
            "Success in percent, mean over seeds (lowest to highest):",
            "",
            "| variant | seeds | " + " | ".join(f"{n} units" for n in LENGTHS) + " |",
            "| --- | --- |" + " --- |" * len(LENGTHS),
            *(_row(name, frame) for name, frame in table.groupby("variant", sort=False)),
            "",
        ]
    )


def _row(name: Any, frame: pd.DataFrame) -> str:
    by_length = 100 * frame.groupby("length").success.agg(["mean", "min", "max"])
    cells = [f"{row['mean']:.0f} ({row['min']:.0f} to {row['max']:.0f})"
             for _, row in by_length.iterrows()]  # fmt: skip
    return f"| {name} | {frame.seed.nunique()} | " + " | ".join(cells) + " |"


def _what_each_buys(table: pd.DataFrame) -> list[str]:
    """Points of success lost or won against `base`, averaged over short and over long lengths."""
    lines = [
        "Points of success more than `base`, or than the variant named [95 % interval of the"
        " difference of means over seeds, Welch's t]. Bold: told from chance with a false discovery"
        f" rate of {100 * FALSE:.0f} % among all differences of this table (Benjamini and"
        " Hochberg). The others may be chance, whatever their interval:",
        "",
        "| change | " + " | ".join(f"mean of {_listed(group)} units" for group in GROUPS) + " |",
        "| --- |" + " --- |" * len(GROUPS),
    ]
    kinds = [_over_lengths(table, group) for group in GROUPS]
    there = set(table.variant)
    pairs = [(name, AGAINST.get(name, "base")) for name in VARIANTS if name != "base"]
    gains = {
        (name, other): [_gain(kind[name].to_numpy(), kind[other].to_numpy()) for kind in kinds]
        for name, other in pairs
        if {name, other} <= there
    }
    tested = [gain.chance for row in gains.values() for gain in row if gain.chance is not None]
    adjusted = false_discovery_control(tested) if tested else []
    least = max((p for p, q in zip(tested, adjusted, strict=True) if q <= FALSE), default=-1.0)
    for (name, other), row in gains.items():
        told = name if other == "base" else f"{name} (against {other})"
        cells = [
            f"**{gain.text}**" if gain.chance is not None and gain.chance <= least else gain.text
            for gain in row
        ]
        lines.append(f"| {told} | " + " | ".join(cells) + " |")
    return lines


def _over_lengths(table: pd.DataFrame, lengths: tuple[int, ...]) -> pd.Series:
    """Mean success in percent of each (variant, seed)."""
    rows = table[table.length.isin(lengths)]
    return 100 * rows.groupby(["variant", "seed"], sort=False).success.mean().round(9)


def _listed(lengths: tuple[int, ...]) -> str:
    return f"{', '.join(map(str, lengths[:-1]))} and {lengths[-1]}"


class Gain(NamedTuple):
    """A difference of means over seeds."""

    text: str  # with its interval
    chance: float | None  # p of Welch's t; None where seeds are too few or do not differ


def _gain(own: np.ndarray, base: np.ndarray) -> Gain:
    mean = f"{own.mean() - base.mean():+.1f}"
    if min(len(own), len(base)) < 2 or np.ptp(own) == np.ptp(base) == 0:
        return Gain(mean, None)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # all may be 100 %
        test = ttest_ind(own, base, equal_var=False)
        interval = test.confidence_interval(0.95)
    text = f"{mean} [{interval.low:+.1f}, {interval.high:+.1f}]"
    return Gain(text, float(test.pvalue))


def as_picture(table: pd.DataFrame) -> bytes:
    """PNG: success in percent of each variant at each length, coloured by its gain on base."""
    success = 100 * table.groupby(["variant", "length"]).success.mean().unstack()
    success = success.loc[[name for name in VARIANTS if name in success.index]]
    gain = success - success.reindex(["base"]).iloc[0]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.5, 1.2 + 0.32 * len(success)), layout="constrained")
        panel = figure.subplots()
        image = panel.imshow(gain, cmap="RdBu", vmin=-COLOURED, vmax=COLOURED, aspect="auto")
        for (row, column), value in np.ndenumerate(success.to_numpy()):
            strong = abs(gain.iat[row, column]) > 0.7 * COLOURED
            colour = "white" if strong else "black"
            panel.text(column, row, f"{value:.0f}", ha="center", va="center", color=colour)
        panel.set_xticks(range(success.shape[1]), [f"{length}" for length in success.columns])
        panel.set_yticks(range(len(success)), success.index)
        panel.set_xlabel("units")
        panel.set_title("success in percent, mean over seeds")
        figure.colorbar(image, label="points more than base", extend="both")
        content = io.BytesIO()
        figure.savefig(content, format="png")
    return content.getvalue()


def main() -> None:
    """Studies into the folder that the command line names."""
    out, *seeds = sys.argv[1:] or [""]
    if not out or len(seeds) > 1 or not all(word in map(str, range(1, 100)) for word in seeds):
        raise InputError("give a folder, and how many seeds: python -m studies.factors.run OUT 3")
    make_writable(Path(out))
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(out) / "cache"))
    fresh = 4  # runs until a process starts anew: compiled programs stay in memory
    with get_context("spawn").Pool(jobs_that_fit(), maxtasksperchild=fresh) as pool:
        study(Path(out), int(seeds[0]) if seeds else 3, pool.imap_unordered)


if __name__ == "__main__":
    program("factors", main, __doc__)
