"""Can a chain learn to part? python -m studies.passage.run OUT

One graph network for every unit, begun with `any-length-1` and trained on `passage` (opening 0.25
of the chain, 8 to 16 units, walls in sight), twice: with thrusts alone, as a chain that folds and
squeezes through, and with the action `grip`, by which units let go of each other and take hold.
Both against `any-length-1` as it is and `caravan`, which parts by a hand-written plan. Writes
OUT/results/passage.csv, a row for each trial, and OUT/report.md. What is there is kept.
"""

import sys
from pathlib import Path

import pandas as pd

from salpchain.controllers.named import load
from salpchain.controllers.policy import Controller
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.statistics import share
from salpchain.evaluation.trials import run_trials
from salpchain.experiments.results import REPORT_FILE, add_part, claim, results_of
from salpchain.files import write_text
from salpchain.tasks.parting.config import PassageConfig
from salpchain.training.config import TrainConfig
from salpchain.training.settings import preset
from studies import program, train_or_go_on

CELLS = ((0.25, 8), (0.25, 16), (0.25, 32), (0.5, 16))  # opening in chain lengths, units
TRIALS = 60
SEED = 2028  # of the starts that judge (chosen)
TRAINED = {"squeezing": "thrust", "gripping": "grip"}
WRITTEN = ("any-length-1", "caravan")
LEARNED = {
    "start": "any-length-1",
    "task.name": "passage",
    "task.opening": 0.25,
    "task.observation": "studies.passage.seen:WALLS",
    "task.time_limit": "scaled",
    "ppo.gamma": 0.998,  # the way round a wall pays late
    "ppo.learning_rate": 1e-3,
    "steps": 2_500_000,
}


def recipe(name: str) -> TrainConfig:
    """The run that has this name."""
    settings = {**LEARNED, "task.action": TRAINED[name], "name": name}
    return preset(length="8,12,16", settings=settings)


def made(name: str, out: Path) -> Controller:
    """The controller of this name, trained first if it is one to train."""
    if name in WRITTEN:
        return load(name)
    train_or_go_on(recipe(name), out / "runs" / name)
    return load(out / "runs" / name)


def trials(controller: Controller, opening: float, length: int) -> pd.DataFrame:
    """The trials of one controller in one cell."""
    task = PassageConfig(opening=opening)
    (frame,) = run_trials([controller], length, TRIALS, "scaled", SEED, task=task)
    kept = ["trial", "success", "steps_to_goal", "closed_fraction", "docks", "parted_links"]
    kept += ["wall_contacts", "wall_impulse"]
    about = {"controller": controller.card.name, "opening": opening, "length": length}
    return pd.DataFrame({**about, **{name: frame[name] for name in kept}})


def study(out: Path) -> None:
    """Trains, tests and reports, part by part."""
    results = results_of(out)
    claim(results, "passage", trials=TRIALS, seed=SEED, steps=LEARNED["steps"])
    for name in (*TRAINED, *WRITTEN):
        for opening, length in CELLS:
            part = {"controller": name, "opening": opening, "length": length}
            play = lambda c=name, w=opening, n=length: trials(made(c, out), w, n)  # noqa: E731
            add_part(results / "passage.csv", part, play)
    write_text(out / REPORT_FILE, report(pd.read_csv(results / "passage.csv")))


def report(frame: pd.DataFrame) -> str:
    """The table in Markdown."""
    said = [
        "# Can a chain learn to part?\n",
        f"{TRIALS} episodes of `passage` in each cell, scaled time limit, starts of seed {SEED}.\n",
        "| opening | units | controller | success (95 %) | median steps | joints closed | median"
        " largest impulse on a wall |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for opening, length in CELLS:
        for name in (*TRAINED, *WRITTEN):
            rows = frame.query("controller == @name and opening == @opening and length == @length")
            success = share(int(rows.success.sum()), len(rows))
            mean, low, high = (100 * success[part] for part in ("mean", "low", "high"))
            said.append(
                f"| {opening} | {length} | `{name}` | {mean:.0f} % ({low:.0f} to {high:.0f}) |"
                f" {rows.steps_to_goal.median():.0f} | {rows.docks.mean():.1f} |"
                f" {rows.wall_impulse.median():.1f} N s |"
            )
    return "\n".join([*said, ""])


def main() -> None:
    """Studies in the folder that the command line names."""
    if len(sys.argv) != 2:
        raise InputError("give a folder: python -m studies.passage.run OUT")
    use_devices(1)
    study(Path(sys.argv[1]))


if __name__ == "__main__":
    program("passage", main, __doc__)
