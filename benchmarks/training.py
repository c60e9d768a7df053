"""Training with the quick preset, seed by seed: time, success, and zero-shot closed fraction.

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

from benchmarks.run import add_options, begun
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.evaluation.evaluate import evaluate
from salpchain.files import read_json, write_json

TEST_SEED = 1000  # of the starts that judge; training draws from another stream
FRESH_EPISODES = 200
LONGER = (16, 32, 64)
LONGER_TRIALS = 100


def one_seed(seed: int, run: Path) -> dict[str, Any]:
    """Trains unless done, then tests the deterministic policy on fresh episodes."""
    if not (run / "summary.json").exists():
        words = ["--resume"] if (run / "config.json").exists() else ["--seed", str(seed)]
        train = [sys.executable, "-m", "salpchain.cli.main", "train", "--out", str(run), *words]
        subprocess.run(train, check=True)
    summary = read_json(run / "summary.json")
    policy = load(run)
    own = evaluate(policy, [8], FRESH_EPISODES, "fixed", TEST_SEED, baseline=False)["lengths"][0]
    longer = evaluate(policy, LONGER, LONGER_TRIALS, "scaled", TEST_SEED, baseline=False)
    return {
        "seed": seed,
        "steps": summary["steps"],
        "seconds": summary["seconds"],
        "steps_per_second": summary["steps"] / summary["seconds"],
        "reached_95_percent_in_training": summary["reached_95_percent"],
        "closing_evaluation": summary["success"],
        "success": own["success"]["mean"],
        "closed_fraction": {e["length"]: e["closed_fraction"]["mean"] for e in longer["lengths"]},
        "longer_success": {e["length"]: e["success"]["mean"] for e in longer["lengths"]},
    }


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
