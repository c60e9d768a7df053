"""Programs that make what the repository keeps: released policies and studies."""

import sys
from collections.abc import Callable
from pathlib import Path

from salpchain.errors import InputError
from salpchain.training import run_folder
from salpchain.training.config import TrainConfig
from salpchain.training.trainer import resume, train


def program(name: str, main: Callable[[], None], about: str | None) -> None:
    """The program; bad input is one line and exit status 2, an interrupt one and 130."""
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(about)
        return
    try:
        main()
    except (InputError, OSError) as error:
        print(f"studies.{name}: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"studies.{name}: stopped; the same command goes on", file=sys.stderr)
        sys.exit(130)


def check_same(config: TrainConfig, run: Path) -> None:
    """Raise InputError if the folder holds a run with other settings.

    Raises:
        InputError: one with other settings, or a damaged one.
    """
    if (run / run_folder.CONFIG_FILE).exists() and run_folder.read_config(run)[0] != config:
        raise InputError(f"{run} holds a run with other settings: choose another folder")


def train_or_go_on(config: TrainConfig, run: Path) -> None:
    """A whole run with these settings, on one core: new, gone on with, or as it is.

    Shared out over several cores, sums come in another order and weights differ.

    Raises:
        As `train` and `resume`; and InputError: the folder holds a run with other settings.
    """
    check_same(config, run)
    if (run / run_folder.SUMMARY_FILE).exists():
        return
    if (run / run_folder.CONFIG_FILE).exists():
        resume(run)
    else:
        train(config, run, devices=1)


def run_of(out: Path, name: str, seed: int) -> Path:
    """The run folder of one seed of what has this name."""
    return out / name.replace(" ", "-") / f"seed-{seed}"
