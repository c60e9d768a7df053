"""Whole learners as files: what `--resume` continues from, bit for bit."""

from pathlib import Path

from salpchain.errors import InputError
from salpchain.files import StrPath, read_arrays, write_arrays
from salpchain.training.learner import Learner
from salpchain.trees import from_arrays, to_arrays

KIND = "checkpoint"
VERSION = 1
CHECKPOINT_FILE = "checkpoint.safetensors"


def save_checkpoint(learner: Learner, run: StrPath) -> None:
    """The learner as one file in the run folder; the one before is replaced only by a whole one.

    Raises:
        OSError: the folder is not writable, or the disk is full.
    """
    header = {"iteration": int(learner.iteration)}
    write_arrays(Path(run) / CHECKPOINT_FILE, KIND, VERSION, header, to_arrays(learner))


def load_checkpoint(run: StrPath, template: Learner) -> Learner:
    """The learner saved last.

    Raises:
        InputError: there is none, or it is damaged, altered, from a newer version, or of a run
            with other settings.
    """
    path = Path(run) / CHECKPOINT_FILE
    if not path.exists():
        raise InputError(f"{run} has nothing to resume: it has no {CHECKPOINT_FILE}")
    _, arrays = read_arrays(path, KIND, VERSION)
    return from_arrays(template, arrays, str(path))
