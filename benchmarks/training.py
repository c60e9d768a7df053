"""Training with the quick preset, seed by seed: time, success, and zero-shot closed fraction.

When a run first succeeds in 95 % is told by evaluations of the deterministic policy on the way.
Seconds are those of iterations alone, without compilation and evaluations.

python -m benchmarks.training [--seeds N] [--runs FOLDER] [--name NAME] [--overwrite]

Each seed trains in a process of its own, as a user would; a run that is whole is not trained again.
"""

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.run import add_options, begun
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.evaluation.evaluate import evaluate
from salpchain.files import read_json, write_json

TEST_SEED = 1000  # of the starts that judge; training draws from another stream
FRESH_EPISODES = 200
LONGER = (16, 32, 64)
LONGER_TRIALS = 100
EVALUATIONS = 60  # of a training, each of 200 deterministic episodes


def one_seed(seed: int, run: Path) -> dict[str, Any]:
    """Trains unless done, then tests the deterministic policy on fresh episodes."""
    if not (run / "summary.json").exists():
        new = ["--seed", str(seed), "--set", f"evaluations={EVALUATIONS}"]
        words = ["--resume"] if (run / "config.json").exists() else new
        train = [sys.executable, "-m", "salpchain.cli.main", "train", "--out", str(run), *words]
        subprocess.run(train, check=True)
    summary = read_json(run / "summary.json")
    policy = load(run)
    own = evaluate(policy, [8], FRESH_EPISODES, "fixed", TEST_SEED, baseline=False)["lengths"][0]
    longer = evaluate(policy, LONGER, LONGER_TRIALS, "scaled", TEST_SEED, baseline=False)
    return {
        "seed": seed,
        "steps": summary["steps"],
        "seconds": (seconds := iterations_took(run, summary["steps"])),
        "steps_per_second": summary["steps"] / seconds,
        "reached_95_percent": first_to_succeed(run),
        "closing_evaluation": summary["success"],
        "success": own["success"]["mean"],
        "closed_fraction": {e["length"]: e["closed_fraction"]["mean"] for e in longer["lengths"]},
        "longer_success": {e["length"]: e["success"]["mean"] for e in longer["lengths"]},
    }


def first_to_succeed(run: Path, share: float = 0.95) -> dict[str, float] | None:
    """Steps, and seconds of iterations, when an evaluation first gave this success."""
    found = pd.read_csv(run / "evaluations.csv").query(f"success >= {share}")
    if found.empty:
        return None
    steps = int(found.iloc[0]["steps"])
    return {"steps": steps, "seconds": iterations_took(run, steps)}


def iterations_took(run: Path, steps: int) -> float:
    """Seconds of a run's iterations up to these steps; neither compilation nor evaluations."""
    rows = pd.read_csv(run / "metrics.csv")
    speeds = rows["steps_per_second"].to_numpy(float)[rows["steps"].to_numpy() <= steps]
    return float((steps / len(speeds) / speeds).sum())


def main() -> None:
    """Runs all seeds, prints and writes the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--runs", type=Path, default=Path("runs/benchmark"))
    add_options(parser)
    options = parser.parse_args()
    use_devices()
    path, record = begun("training", options, seeds=options.seeds)
    seeds = [one_seed(seed, options.runs / str(seed)) for seed in range(options.seeds)]
    medians = {
        length: statistics.median(seed["closed_fraction"][length] for seed in seeds)
        for length in LONGER
    }
    record |= {
        "episodes": {"8 units, fixed": FRESH_EPISODES, "longer, scaled": LONGER_TRIALS},
        "seeds": seeds,
        "median_closed_fraction": medians,
    }
    print(json.dumps(record, indent=2))
    write_json(path, record)


if __name__ == "__main__":
    main()
