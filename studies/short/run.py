"""Why do short chains close less of the distance? python -m studies.short.run POLICY OUT

Plays a policy, the same policy where a target is taken at 2 cm instead of the judge's 5.1, the
planner `mpc`, and `mpc` that starts from what the policy would do, which tells how much sooner the
goal can be reached at least. All from the same starts. Writes OUT/results/short.csv and
OUT/report.md. What is there is kept, so a run that was stopped goes on.
"""

import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path

import pandas as pd

from salpchain.controllers.mpc import MPC
from salpchain.controllers.policy import Controller
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.experiments.results import REPORT_FILE, add_part, claim, results_of
from salpchain.files import write_text
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig
from salpchain.training.presets import TIGHT
from studies import program

TRIALS = {2: 50, 3: 50, 4: 32, 6: 32, 8: 32}  # of each length: planning takes its time
SEED = 2001  # of the starts that judge, those of `studies.release`
LIMIT = "fixed"  # the scaled one is the same at these lengths
MEASURES = ["success", "closed_fraction", "steps_to_goal"]


def who_plays(policy: Controller) -> dict[str, tuple[Controller, float]]:
    """The controllers, with the Frechet distance (m) at which their targets are taken."""
    name = policy.card.name
    return {
        name: (policy, GOAL_LIMIT),
        f"{name}, goal of 2 cm": (policy, TIGHT),
        "mpc": (MPC(), GOAL_LIMIT),
        f"mpc, from what {name} would do": (MPC.guided(policy), GOAL_LIMIT),
    }


def play(policy: Controller, who: str, length: int) -> pd.DataFrame:
    """The trials of one controller at one length."""
    controller, tolerance = who_plays(policy)[who]
    task = TaskConfig(tolerance=tolerance)
    (frame,) = run_trials([controller], length, TRIALS[length], LIMIT, SEED, task=task)
    return frame.assign(who=who)[["who", "length", "trial", *MEASURES]]


def study(policy: Controller, out: Path) -> None:
    """All of it, part by part."""
    results, planner = results_of(out), asdict(MPC())
    del planner["physics"]["joint_derivative"]  # it plans without derivatives
    near = {name: getattr(MPC.guided(policy), name) for name in ("elites", "noise")}
    judge = {"time_limit": LIMIT, "tolerances": [GOAL_LIMIT, TIGHT]}
    claim(results, "short", policy, trials=TRIALS, seed=SEED, **judge, mpc=planner, guided=near)
    for who in who_plays(policy):
        for length in TRIALS:
            part = {"who": who, "length": length}
            add_part(results / "short.csv", part, partial(play, policy, who, length))
    write_text(out / REPORT_FILE, report(pd.read_csv(results / "short.csv")))


def report(trials: pd.DataFrame) -> str:
    """One row for each controller and length."""
    lines = [
        "# Short chains",
        "",
        f"Time limit `{LIMIT}`, seed {SEED}. A target is taken at a Frechet distance of"
        f" {100 * GOAL_LIMIT:.1f} cm unless said otherwise.",
        "",
        "| units | who | episodes | targets reached | distance closed | median steps to the goal |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for length in TRIALS:
        for who, own in trials[trials.length == length].groupby("who", sort=False):
            success, closed = 100 * own.success.mean(), 100 * own.closed_fraction.mean()
            steps = own.steps_to_goal.median()
            cells = f"{len(own)} | {success:.1f} % | {closed:.1f} % | {steps:.1f}"
            lines.append(f"| {length} | {who} | {cells} |")
    return "\n".join([*lines, ""])


def main() -> None:
    """Studies the policy that the command line names, into the folder that it names."""
    if len(sys.argv) != 3:
        raise InputError("give a policy and a folder: python -m studies.short.run NAME OUT")
    use_devices()
    study(load(sys.argv[1]), Path(sys.argv[2]))


if __name__ == "__main__":
    program("short", main, __doc__)
