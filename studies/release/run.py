"""Makes the policies that come with the package: python -m studies.release.run NAME [RUNS]

Trains (or goes on training) in RUNS/NAME, tests 200 episodes of each length with starts that no
training and no choice has seen, and writes the policy and its model card to salpchain/policies/,
all measures of the test to studies/release/results/.
"""

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from salpchain.controllers.policy import Policy
from salpchain.controllers.released import FOLDER
from salpchain.controllers.storage import load, save_policy
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE
from salpchain.evaluation.evaluate import evaluate
from salpchain.experiments.results import RESULTS
from salpchain.files import read_json, write_json
from salpchain.training import presets, run_folder
from salpchain.training.config import Mix, TrainConfig
from studies import program, train_or_go_on

LENGTHS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
TRIALS = 200
SEED = 2001  # of the starts that judge (chosen)
LIMIT = "scaled"
TESTS = Path(__file__).parent / RESULTS


def any_length() -> TrainConfig:
    """`gcn` on `mixed`, trained on 2 to 16 units: `salpchain train --length 2..16`, but longer.

    An episode has 16 units eight times as often as 2: short chains are learned in passing.
    """
    lengths = tuple(range(2, 17))
    mix = Mix(lengths, weights=tuple(float(length) for length in lengths))
    return presets.choose("quick", mix=mix, steps=30_000_000)


def paper(model: str, length: int) -> Callable[[], TrainConfig]:
    """The paper's controller for one training length, trained with `quick`."""
    return lambda: presets.choose("quick", model=model, length=length)


RECIPES = {
    "any-length": (any_length, "one controller for every length, trained on 2 to 16 units"),
    **{
        f"paper-{model}-{length}": (
            paper(model, length),
            f"{model} on mixed, {length} units alone, with quick",
        )
        for model, length in (("gcn", 8), ("gcn", 16), ("gt", 8), ("gt", 16))
    },
}


def release(name: str, runs: Path) -> None:
    """Trains, tests and writes one policy; what is tested is the file that is released."""
    make, about = RECIPES[name]
    run = runs / name
    use_devices()
    train_or_go_on(make(), run)
    trained = load(run)
    policy = Policy(trained.network, dataclasses.replace(trained.card, name=name))
    file = run / f"{name}.safetensors"
    save_policy(policy, file, half=True)
    tested = run / "evaluation"
    if not (tested / SUMMARY_FILE).exists():
        evaluate(load(file), LENGTHS, TRIALS, LIMIT, SEED, tested, baseline=False)
    summary = read_json(tested / SUMMARY_FILE)
    for folder in (FOLDER, TESTS):
        folder.mkdir(exist_ok=True)
    write_json(TESTS / f"{name}.json", summary)
    save_policy(policy, FOLDER / file.name, half=True)
    trained_for = read_json(run / run_folder.SUMMARY_FILE)
    write_json(FOLDER / f"{name}.json", _card(policy, about, trained_for, summary))


def _card(
    policy: Policy, about: str, trained_for: dict[str, Any], summary: dict[str, Any]
) -> dict[str, Any]:
    name = policy.card.name
    return {
        "about": about,
        "training_lengths": policy.card.lengths,
        "steps": trained_for["steps"],
        "minutes": round(trained_for["seconds"] / 60, 1),
        "command": f"python -m studies.release.run {name}",
        "limits": "simulated only; measured from straight starts at rest, with exact sensors, no"
        " delay and no current",
        "licence": "Apache-2.0",
        "trials": TRIALS,
        "seed": SEED,
        "time_limit": LIMIT,
        "measured": [
            {
                "length": row["length"],
                "success": row["success"]["mean"],
                "interval": [row["success"]["low"], row["success"]["high"]],
                "closed_fraction": row["closed_fraction"]["mean"],
                "steps_to_goal": row["steps_to_goal"]["median"],
            }
            for row in summary["lengths"]
        ],
    }


def main() -> None:
    """Makes the policy that the command line names."""
    if len(sys.argv) not in (2, 3) or sys.argv[1] not in RECIPES:
        raise InputError(f"name a policy to make, and a folder: {', '.join(RECIPES)}")
    release(sys.argv[1], Path(sys.argv[2] if len(sys.argv) > 2 else "runs/release"))


if __name__ == "__main__":
    program("release", main, __doc__)
