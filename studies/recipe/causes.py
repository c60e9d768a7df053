"""Why does the paper's own recipe learn so slowly? One thing at a time, from `quick` and to it.

python -m studies.recipe.causes OUT [STEPS]

`gcn` on `mixed`, 8 units, seed 0: `quick` with one thing as in preset `paper`, and `paper` with one
thing as in `quick`, each for STEPS chain-steps (default 600,000) on one core. OUT/causes.csv has
success and closed fraction of 200 episodes without noise, and the speed; it is printed too. What is
there is kept: stopped, it goes on.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.files import make_writable, read_json, write_text
from salpchain.training.config import TrainConfig
from salpchain.training.run_folder import METRICS_FILE, SUMMARY_FILE
from salpchain.training.settings import flat, preset
from studies import program, run_of, train_or_go_on

STEPS = 600_000
UNITS = 8
THINGS = {
    "learning rate": ("ppo.learning_rate", "ppo.final_rate"),
    "epochs": ("ppo.epochs",),
    "what units observe": ("task.observation",),
    "reward": ("task.fine_weight",),
    "action": ("task.action",),
    "chains at once": ("ppo.envs", "ppo.rollout", "ppo.minibatch"),
    "spread of actions": ("control.shared_log_std",),
    "ratio that is clipped": ("ppo.ratio",),
    "weight of the entropy": ("ppo.final_entropy",),
    "fence": ("task.fence",),
}


def variants(steps: int) -> Iterator[tuple[str, str, TrainConfig]]:
    """The preset that is begun from, what of it is as in the other, and the settings."""
    for name, other in (("quick", "paper"), ("paper", "quick")):
        there = flat(preset(other, length=UNITS))
        yield name, "nothing", _with(name, {}, steps)
        for thing, paths in THINGS.items():
            yield name, thing, _with(name, {path: there[path] for path in paths}, steps)


def _with(name: str, changes: dict[str, Any], steps: int) -> TrainConfig:
    return preset(name, length=UNITS, settings={**changes, "steps": steps, "evaluations": 0})


def study(out: Path, steps: int) -> None:
    """All runs that are missing; after each, the table."""
    rows = []
    for name, thing, config in variants(steps):
        run = run_of(out, f"{name} {thing}", config.seed)
        train_or_go_on(config, run)
        rows.append({"preset": name, "as in the other": thing, **_measured(run)})
        write_text(out / "causes.csv", pd.DataFrame(rows).to_csv(index=False))
        print(", ".join(map(str, rows[-1].values())), flush=True)


def _measured(run: Path) -> dict[str, float]:
    summary = read_json(run / SUMMARY_FILE)
    speed = pd.read_csv(run / METRICS_FILE)["steps_per_second"].median()
    return {
        "success": summary["success"],
        "closed_fraction": summary["closed_fraction"],
        "steps_per_second": round(float(speed)),
    }


def main() -> None:
    """Reads the words; makes what is missing."""
    out, *number = sys.argv[1:] or [""]
    if not out or len(number) > 1 or not all(x.isascii() and x.isdigit() for x in number):
        raise InputError("give a folder, and how many steps: python -m studies.recipe.causes OUT")
    steps = int(number[0]) if number else STEPS
    list(variants(steps))  # refused before anything is written
    use_devices(1)
    make_writable(Path(out))
    study(Path(out), steps)


if __name__ == "__main__":
    program("recipe.causes", main, __doc__)
