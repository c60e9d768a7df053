"""Policies that come with the package. Imports nothing heavy: the command line asks it."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from salpchain.files import read_json

FOLDER = Path(str(files("salpchain"))) / "policies"


def released() -> dict[str, Path]:
    """The files of released policies by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.safetensors"))}


def model_card(name: str) -> dict[str, Any]:
    """What is told of a released policy: how it was trained, and what was measured with it.

    `about`, `command` (that made it), `training_lengths`, `steps` and `minutes` of training,
    `licence`, `limits`, and `measured`: for each length the success and closed fraction (shares)
    and the median of the steps to the goal over `trials` episodes.
    """
    return read_json(FOLDER / f"{name}.json")
