"""Makes the policies that come with the package: python -m studies.release NAME [RUNS]

Trains (or goes on training) in RUNS/NAME, tests 200 episodes of each length with starts that no
training and no choice has seen, and writes the policy and its model card to salpchain/policies/.
"""

import dataclasses
import sys
from pathlib import Path
from typing import Any

from salpchain.control.policy import Policy
from salpchain.control.released import FOLDER
from salpchain.control.storage import load, save_policy
from salpchain.errors import InputError
from salpchain.evaluation.evaluate import evaluate
from salpchain.files import write_json
from salpchain.training import presets, run_folder
from salpchain.training.config import Mix, TrainConfig
from salpchain.training.trainer import resume, train

LENGTHS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
TRIALS = 200
SEED = 2000  # of the starts that judge (chosen)


def any_length() -> TrainConfig:
    """`gcn` on `mixed`, trained on 2 to 16 units: `salpchain train --length 2..16`, but longer."""
    return presets.choose("quick", mix=Mix(tuple(range(2, 17))), steps=12_000_000)


RECIPES = {
    "any-length": (any_length, "one controller for every length, trained on 2 to 16 units"),
    "paper-gcn-8": (lambda: presets.choose("quick", length=8), "gcn on mixed, trained on 8 units"),
}


def release(name: str, runs: Path) -> None:
    """Trains, tests and writes one policy."""
    make, about = RECIPES[name]
    run = runs / name
    if not (run / run_folder.SUMMARY_FILE).exists():
        if (run / run_folder.CONFIG_FILE).exists():
            resume(run)
        else:
            train(make(), run)
    trained = load(run)
    policy = Policy(trained.network, dataclasses.replace(trained.card, name=name))
    summary = evaluate(policy, LENGTHS, TRIALS, "scaled", SEED, run / "evaluation", baseline=False)
    save_policy(policy, FOLDER / f"{name}.safetensors")
    write_json(FOLDER / f"{name}.json", _card(name, about, summary))


def _card(name: str, about: str, summary: dict[str, Any]) -> dict[str, Any]:
    return {
        "about": about,
        "command": f"python -m studies.release {name}",
        "limits": "simulated only; straight starts at rest and targets of the SCLD;"
        " no sensor noise, no delay, no current",
        "licence": "Apache-2.0",
        "trials": TRIALS,
        "measured": [
            {
                "length": row["length"],
                "success": row["success"]["mean"],
                "closed_fraction": row["closed_fraction"]["mean"],
            }
            for row in summary["lengths"]
        ],
    }


def main() -> None:
    """Makes the policy that the command line names."""
    if len(sys.argv) < 2 or sys.argv[1] not in RECIPES:
        raise InputError(f"name a policy to make: {', '.join(RECIPES)}")
    release(sys.argv[1], Path(sys.argv[2] if len(sys.argv) > 2 else "runs/release"))


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        print(f"studies.release: {error}", file=sys.stderr)
        sys.exit(2)
