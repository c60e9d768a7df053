"""Controllers by name or path, as every command takes them. Imports nothing heavy until asked."""

import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from salpchain.controllers.released import released
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.given import told
from salpchain.plugins import find, is_path

if TYPE_CHECKING:
    from salpchain.controllers.policy import Controller


class Written(NamedTuple):
    """A controller that needs no training."""

    module: str
    kind: str
    about: str
    live: bool  # quick enough to steer while a person watches


WRITTEN = {
    "greedy": Written(
        "salpchain.controllers.greedy", "Greedy", "each unit thrusts to its own target point", True
    ),
    "approach": Written(
        "salpchain.controllers.approach", "Approach", "turns, approaches and bends as a whole", True
    ),
    "mpc": Written(
        "salpchain.controllers.mpc", "MPC", "plans by sampling on the engine, slow", False
    ),
    "caravan": Written(
        "salpchain.controllers.caravan",
        "Caravan",
        "parts to pass, joins again; above a policy",
        True,
    ),
}


LONGEST_NAME = 100  # characters (chosen; a file may be called so)


def load(source: StrPath) -> "Controller":
    """The controller of this name, or the policy in this file or run folder.

    A name wins over a folder that is called so: `./NAME`, or a `Path`, is the folder.

    Raises:
        InputError: there is none; or the file is damaged, altered or from a newer version.
    """
    if isinstance(source, str) and source in WRITTEN:
        written = WRITTEN[source]
        return getattr(import_module(written.module), written.kind)()
    if is_own(source):
        return _own(str(source))
    if not isinstance(source, str | os.PathLike):
        raise InputError(f"load takes {_sources()}, got {told(source)}")
    check_there(source)
    from salpchain.controllers import storage

    return storage.load(source)


def is_own(source: object) -> bool:
    """Whether this is `module:Class` of a user's own, and no path to a file that is called so."""
    return is_path(source) and not Path(str(source)).exists()


def _own(name: str) -> "Controller":
    """The controller of a user's own: an object, or one made of a class without arguments."""
    found = find("controller", name)
    try:
        made = found() if isinstance(found, type) else found
    except TypeError as error:
        raise InputError(f"controller {name} cannot be made without arguments: {error}") from None
    return controller(made)


def controller(meant: "Controller | StrPath") -> "Controller":
    """The controller that is meant: this one, or the one of this name or path.

    Raises:
        InputError: it is none; or as `load`.
    """
    if isinstance(meant, str | os.PathLike):
        return load(meant)
    from salpchain.controllers.policy import PolicyCard

    card, act = getattr(meant, "card", None), getattr(meant, "act", None)
    if isinstance(meant, type) or not isinstance(card, PolicyCard) or not callable(act):
        raise InputError(
            f"a controller is {_sources()}, or an object with a card and an act, got {told(meant)}"
        )
    return meant


def _sources() -> str:
    return f"the path of a run or a policy, or one of {', '.join(names())}, or module:Class"


def is_name(source: StrPath) -> bool:
    """Whether this names a controller; a path never does, not even to a folder called so."""
    return isinstance(source, str) and source in names()


def names() -> list[str]:
    """The names of all controllers that come with the package."""
    return [*released(), *WRITTEN]


def check_name(name: str) -> None:
    """Raise InputError unless a policy of a user's own may be called so."""
    if not name.strip() or name != name.strip() or len(name) > LONGEST_NAME:
        raise InputError(
            f"name must have 1 to {LONGEST_NAME} characters, none of them a space at an end,"
            f" got {name!r}"
        )
    check_printable(name)
    if name[0] in ".-" or set(name) & set("/\\"):
        raise InputError(f"name must have no / and no \\ and not begin with . or -, got {name!r}")
    if name in names():
        raise InputError(
            f"name {name!r} is that of a controller that comes with the package: choose another"
        )


def check_printable(name: str) -> None:
    """Raise InputError unless a controller's name can stand in a line of a table."""
    if not name.isprintable():
        raise InputError(
            f"name must have no line breaks and no control characters, got {told(name)}"
        )


def check_live(source: str) -> None:
    """Raise InputError if this names a controller that is too slow to steer live.

    Raises:
        InputError: it does; the message lists those that are quick enough.
    """
    if source in WRITTEN and not WRITTEN[source].live:
        quick = ", ".join(n for n in names() if n not in WRITTEN or WRITTEN[n].live)
        raise InputError(f"{source} is too slow to steer live: choose a run, or one of {quick}")


def check_there(source: StrPath) -> None:
    """Raise InputError unless this names a controller or is a path that exists."""
    if not is_name(source) and not is_own(source) and not os.path.exists(source):  # noqa: PTH110 - of a name too long, a path's own raises
        shown = source if str(source).strip() else repr(source)  # nothing would be seen of blanks
        raise InputError(
            f"no such run folder or policy: {shown} (a path, or one of {', '.join(names())})"
        )
