"""Results that a folder holds already, and whether those of other trials may take their place."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from salpchain.errors import InputError
from salpchain.evaluation.config import SUMMARY_FILE
from salpchain.files import StrPath, read_json
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import label as task_label
from salpchain.world.config import WorldConfig
from salpchain.world.presets import label


def _refused(message: str) -> InputError:
    """The error that says how results may be replaced."""
    python = ": choose another folder, or give overwrite=True"
    return InputError(message, python=python, shell=": choose another folder, or add --overwrite")


def settings(
    lengths: Sequence[int],
    trials: int,
    time_limit: str,
    seed: int,
    world: WorldConfig,
    task: TaskConfig,
    baseline: bool,
) -> dict[str, Any]:
    """What makes two evaluations of one controller the same, by the names of the options."""
    return {
        "lengths": sorted(set(lengths)),
        "trials": trials,
        "time limit": time_limit,
        "seed": seed,
        "world": label(world),
        "task": task_label(task),
        "baseline": baseline,
    }


def check_kept(folder: StrPath, name: str, identity: str, asked: dict[str, Any]) -> None:
    """Raise InputError if the folder holds results of another controller, name or trials.

    Args:
        folder: of the evaluation; it may be missing.
        name: what the controller is called.
        identity: the controller's.
        asked: the settings of the evaluation that would be written.
    """
    path = Path(folder) / SUMMARY_FILE
    if not path.exists():
        return
    content = read_kept(path)
    has = content.get("identity")
    if has != identity:
        whose = f"{content.get('policy', 'something else')}, {_told(has)}"
        raise _refused(f"{folder} holds results of {whose}, not of {name}, {identity}")
    if content.get("policy") != name:
        called = f"{content.get('policy', 'no name')}, not {name} (the same weights, {identity})"
        raise _refused(f"{folder} holds results under the name {called}")
    for setting, value in _settings_of(content).items():
        if value != asked[setting]:
            raise _refused(
                f"{folder} holds other results of {name}: {setting} {_text(value)} there,"
                f" {_text(asked[setting])} asked for"
            )


def read_kept(path: StrPath) -> dict[str, Any]:
    """The summary in a file.

    Raises:
        InputError: it is none.
    """
    try:
        content = read_json(path)
    except InputError as error:
        raise _refused(str(error)) from None
    if not isinstance(content, dict) or not isinstance(content.get("lengths"), list):
        raise _refused(f"{path} is no evaluation")
    return content


def _settings_of(summary: dict[str, Any]) -> dict[str, Any]:
    """The settings that a summary tells of; of unequal numbers of trials, all."""
    rows = [row for row in summary["lengths"] if isinstance(row, dict)]
    trials = sorted({row.get("trials") for row in rows}, key=str)
    return {
        "lengths": [row.get("length") for row in rows],
        "trials": trials[0] if len(trials) == 1 else trials,
        "time limit": summary.get("time_limit"),
        "seed": summary.get("seed"),
        "world": summary.get("world", "still"),
        "task": summary.get("task", "reach"),
        "baseline": summary.get("baseline") is not None,
    }


def _told(identity: object) -> str:
    return identity if isinstance(identity, str) else "which does not say of which weights"


def _text(value: Any) -> str:
    """A setting as one would type it; many lengths by their ends."""
    if not isinstance(value, list):
        return str(value)
    if len(value) > 4:
        return f"{value[0]},...,{value[-1]} ({len(value)} of them)"
    return ",".join(map(str, value))
