"""What a name stands for: something of the package, of an installed one, or of a user's module.

`reach` is in a table, `mymodule:Hover` is the object of that name in a module that Python can
import (or that lies in the working folder), and an installed package may announce names of its own
by entry points.
"""

import sys
from collections.abc import Iterable
from difflib import SequenceMatcher
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

from salpchain.errors import InputError
from salpchain.given import told


def is_path(name: object) -> bool:
    """Whether this has the form `module:name`."""
    if not isinstance(name, str):
        return False
    module, colon, attribute = name.partition(":")
    words = [*module.split("."), *attribute.split(".")]
    return bool(colon) and all(word.isidentifier() for word in words)


def check_known(kind: str, name: object, known: Iterable[str]) -> None:
    """Raise InputError unless the name is known, announced, or of the form `module:name`."""
    names = [*known]
    if isinstance(name, str) and (name in names or is_path(name) or name in _announced(kind)):
        return
    choices = ", ".join([*names, *_announced(kind)])
    raise InputError(
        f"unknown {kind} {told(name)}: choose one of {choices}, or one of your own as module:Name"
    )


@cache
def find(kind: str, name: str) -> Any:
    """The object that a name of the form `module:name`, or one that a package announces, means.

    `kind` is a word such as `task`; entry points are of the group `salpchain.tasks`.

    Raises:
        InputError: there is none, or its module cannot be imported; the message says why.
    """
    if not is_path(name):
        try:
            return _announced(kind)[name].load()
        except Exception as error:
            raise InputError(f"{kind} {name} cannot be loaded: {_reason(error)}") from error
    module, _, attribute = name.partition(":")
    here = _imported(module, f"{kind} {name}")
    for word in attribute.split("."):
        if not hasattr(here, word):
            own = ", ".join(_own_names(here, word)[:10]) or "nothing"
            raise InputError(f"{kind} {name}: {module} has no {word}, it has {own}")
        here = getattr(here, word)
    return here


def path_of(thing: type) -> str:
    """The name by which `find` finds a class."""
    return f"{thing.__module__}:{thing.__qualname__}"


def _own_names(here: object, wanted: str) -> list[str]:
    """The public names of a module that were not imported into it, the most alike first."""
    home = getattr(here, "__name__", None)
    names = [
        name
        for name, value in vars(here).items()
        if not name.startswith("_")
        and not isinstance(value, ModuleType)
        and getattr(value, "__module__", home) == home
    ]
    return sorted(names, key=lambda name: -SequenceMatcher(None, wanted, name).ratio())


def _imported(module: str, what: str) -> object:
    """The module, which may lie in the working folder, as for `python -m`."""
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name and (module == error.name or module.startswith(f"{error.name}.")):
            raise InputError(
                f"{what}: there is no module {error.name}, neither installed nor in this folder"
            ) from None
        raise InputError(f"{what}: importing {module} failed: {_reason(error)}") from error
    except Exception as error:
        raise InputError(f"{what}: importing {module} failed: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """An error in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


@cache
def _announced(kind: str) -> dict[str, EntryPoint]:
    """The names of a kind that installed packages announce."""
    return {point.name: point for point in entry_points(group=f"salpchain.{kind}s")}
