"""Failed trials of an evaluation of dock, passage or gather, by what they failed of.

python -m studies.failures FOLDER [POLICY TASK [PATH=VALUE ...]]

FOLDER is what `salpchain evaluate --out` wrote. Prints how many of the policy's failed trials have
which cause, and writes FOLDER/failures.csv: length, trial, cause and the measures that tell it.
With the policy, the task and the settings (`task.opening=0.5`) of the evaluation it also records
the first trial of each cause and length, FOLDER/failure-CAUSE-LENGTH-TRIAL.html. A chaotic swim may
end otherwise when it is recorded; the program says so where it does.
"""

import sys
from pathlib import Path

import pandas as pd

from salpchain.cli.settings import changed
from salpchain.controllers.named import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE, TRIALS_FILE
from salpchain.evaluation.kept import read_kept
from salpchain.evaluation.recording import record
from salpchain.files import write_text
from salpchain.report.replay import write_replay
from salpchain.world.presets import world_config
from studies import program

STUCK = 1.0  # N s, of one contact: 50 times what a unit at a tenth of top speed gives (chosen)
FAR = 0.5  # of the mean distance at the start (chosen)
TELLING = ["final_distance", "start_distance", "docks", "parted_links", "wall_impulse", "steps"]


def cause(trial: "pd.Series") -> str:
    """What a trial failed of; the first that holds."""
    far = trial.final_distance > FAR * trial.start_distance
    if far and trial.wall_impulse > STUCK:
        return "stuck at a wall"
    if far:
        return "lost"
    if trial.parted_links and not trial.docks:
        return "never docked"
    return "out of time: parted" if trial.parted_links else "out of time: one chain"


def failures(folder: Path) -> pd.DataFrame:
    """The failed trials of the policy of an evaluation, with their causes.

    Raises:
        InputError: no such evaluation, or one of a task whose chains do not part.
    """
    if not (folder / TRIALS_FILE).exists():
        raise InputError(f"{folder} holds no {TRIALS_FILE}: give what salpchain evaluate wrote")
    rows, policy = pd.read_csv(folder / TRIALS_FILE), read_kept(folder / SUMMARY_FILE)["policy"]
    missing = [name for name in TELLING if name not in rows]
    if missing:
        raise InputError(f"{folder} is of a task whose chains do not part: it has no {missing[0]}")
    failed = rows[(rows.policy == policy) & ~rows.success.astype(bool)].copy()
    failed["cause"] = [cause(trial) for _, trial in failed.iterrows()]
    return failed.loc[:, ["length", "trial", "cause", *TELLING, "seed", "time_limit"]]


def told(failed: pd.DataFrame) -> str:
    """How many trials of each length have which cause."""
    if not len(failed):
        return "no trial failed"
    lines = []
    for length in sorted(failed.length.unique()):
        of_it = failed[failed.length == length]
        for what in sorted(of_it.cause.unique()):
            trials = of_it.trial[of_it.cause == what].tolist()
            listed = ", ".join(map(str, trials))
            lines.append(f"{length} units, {what}: {len(trials)} (trials {listed})")
    return "\n".join(lines)


def replay(failed: pd.DataFrame, folder: Path, policy: str, task: str, sets: list[str]) -> None:
    """Records the first trial of each cause and length."""
    controller = load(policy)
    world, config = changed(world_config("still"), task, sets)
    for one in failed.drop_duplicates(["length", "cause"]).to_dict("records"):
        length, trial = int(one["length"]), int(one["trial"])
        limit, seed = str(one["time_limit"]), int(one["seed"])
        (swim,) = record(controller, length, limit, seed, trial, world=world, task=config)
        name = str(one["cause"]).replace(":", "").replace(" ", "-")
        page = folder / f"failure-{name}-{length}-{trial}.html"
        write_replay([swim], page)
        print(f"wrote {page}{': this time it succeeded' if swim.success else ''}")


def main() -> None:
    """Does what the command line asks."""
    folder, *words = sys.argv[1:] or [""]
    if not folder or len(words) == 1:
        raise InputError("give FOLDER, or FOLDER POLICY TASK [PATH=VALUE ...]")
    use_devices(1)
    failed = failures(Path(folder))
    write_text(Path(folder) / "failures.csv", failed.to_csv(index=False))
    print(told(failed))
    if words:
        replay(failed, Path(folder), words[0], words[1], words[2:])


if __name__ == "__main__":
    program("failures", main, __doc__)
