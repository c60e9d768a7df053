"""Whole learners as files: what `--resume` continues from, bit for bit."""

from pathlib import Path
from typing import Any

import jax.random as jr
from jaxtyping import PRNGKeyArray

from salpchain.errors import InputError
from salpchain.files import StrPath, read_arrays, write_arrays
from salpchain.training.learner import TrainState
from salpchain.trees import from_arrays, to_arrays

KIND = "checkpoint"
VERSION = 2
LAYOUT = 3  # of the learner's records: one of another layout cannot go on
REMEDIES = {  # by what a checkpoint says of the process that wrote it
    "floats": "set JAX_ENABLE_X64={x64} to go on",
    "keys": "set JAX_DEFAULT_PRNG_IMPL={value} to go on",
}
CHECKPOINT_FILE = "checkpoint.safetensors"


def save_checkpoint(learner: TrainState, run: StrPath) -> None:
    """The learner as one file in the run folder; the one before is replaced only by a whole one.

    Raises:
        OSError: the folder is not writable, or the disk is full.
    """
    header = {"iteration": int(learner.iteration), **_written_by(learner, learner.key)}
    header["layout"] = LAYOUT
    header["devices"] = len(learner.states.time.devices())
    write_arrays(Path(run) / CHECKPOINT_FILE, KIND, VERSION, header, to_arrays(learner))


def _written_by(learner: TrainState, key: PRNGKeyArray) -> dict[str, str]:
    """The type of its numbers and the kind of its random keys, which JAX's switches decide."""
    return {"floats": str(learner.states.reward.dtype), "keys": str(jr.key_impl(key))}


def load_checkpoint(run: StrPath, template: TrainState) -> TrainState:
    """The learner saved last.

    Raises:
        InputError: there is none, or it is damaged, altered, from another version, of a run with
            other settings, or written under other switches of JAX.
    """
    path = Path(run) / CHECKPOINT_FILE
    if not path.exists():
        raise InputError(f"{run} has nothing to resume: it has no {CHECKPOINT_FILE}")
    header, arrays = read_arrays(path, KIND, VERSION)
    _check_switches(path, header, template)
    return from_arrays(template, arrays, str(path))


def _check_switches(path: Path, header: dict[str, Any], template: TrainState) -> None:
    """Raise InputError unless numbers and keys are of the kinds that this process works with."""
    if header.get("layout") != LAYOUT:
        raise InputError(f"{path} is of an older salpchain: train anew in another folder")
    for name, here in _written_by(template, jr.key(0)).items():
        value = header.get(name)
        if value != here:
            remedy = REMEDIES[name].format(value=value, x64=int(value == "float64"))
            raise InputError(f"{path} was written with {value} {name}, here are {here}: {remedy}")
