"""Controllers by name or path, as every command takes them. Imports nothing heavy until asked."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from salpchain.control.released import released
from salpchain.errors import InputError

if TYPE_CHECKING:
    from salpchain.control.policy import Controller


class Written(NamedTuple):
    """A controller that needs no training."""

    module: str
    kind: str
    about: str
    live: bool  # quick enough to steer while a person watches


WRITTEN = {
    "greedy": Written(
        "salpchain.control.greedy", "Greedy", "each unit thrusts to its own target point", True
    ),
    "approach": Written(
        "salpchain.control.approach", "Approach", "turns, approaches and bends as a whole", True
    ),
    "mpc": Written("salpchain.control.mpc", "MPC", "plans by sampling on the engine, slow", False),
}


def controller(source: str) -> "Controller":
    """The controller of this name, or the policy in this file or run folder.

    Raises:
        InputError: there is none; or the file is damaged, altered or from a newer version.
    """
    if source in WRITTEN:
        written = WRITTEN[source]
        return getattr(import_module(written.module), written.kind)()
    check_there(source)
    from salpchain.control.storage import load

    return load(source)


def check_there(source: str) -> None:
    """Nothing, if this names a controller or is a path that exists.

    Raises:
        InputError: neither; the message lists the names.
    """
    names = [*released(), *WRITTEN]
    if source not in names and not Path(source).exists():
        raise InputError(
            f"no such run folder or policy: {source} (a path, or one of {', '.join(names)})"
        )
