"""Policies that come with the package. Imports nothing heavy: the command line asks it."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from salpchain.errors import InputError
from salpchain.files import read_json

PARTS = {
    "about", "command", "training_lengths", "steps", "minutes", "licence", "limits",
    "measured", "trials", "seed", "time_limit",
}  # fmt: skip
PAPER_DYNAMICS = "vmas"  # of cards that name none
FOLDER = Path(str(files("salpchain"))) / "policies"


def released(dynamics: str | None = None) -> dict[str, Path]:
    """The files of released policies by name; of those for chains of these dynamics, if given.

    Raises:
        InputError: `dynamics` are asked for, and a card is damaged.
    """
    every = {path.stem: path for path in sorted(FOLDER.glob("*.safetensors"))}
    if dynamics is None:
        return every
    return {name: path for name, path in every.items() if dynamics_of(name) == dynamics}


def dynamics_of(name: str) -> str:
    """The dynamics (`world.dynamics.kind`) of the chains that a released policy is for."""
    return model_card(name).get("dynamics", PAPER_DYNAMICS)


def model_card(name: str) -> dict[str, Any]:
    """What is told of a released policy: how it was trained, and what was measured with it.

    `about`, `command` (that made it), `training_lengths`, `steps` and `minutes` of training,
    `licence`, `limits`, and `measured`: for each length the success with its 95 % interval and the
    closed fraction (shares), and the median of the steps to the goal, over `trials` episodes from
    the starts of `seed` under this `time_limit`. Some have a `suite` too, with the success in each
    of its cells.

    Raises:
        InputError: the card is damaged.
    """
    path = FOLDER / f"{name}.json"
    card = read_json(path)
    if not isinstance(card, dict) or not card.keys() >= PARTS:
        raise InputError(f"{path} is damaged: install salpchain again")
    return card
