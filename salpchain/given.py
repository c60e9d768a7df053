"""What a caller gives a public function, checked: what is wrong is told in one line.

Imports nothing heavy. Numbers of NumPy and JAX are taken like Python's own.
"""

import operator
import os
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any, TypeVar

from salpchain.errors import InputError

Kind = TypeVar("Kind")

LONGEST = 80  # characters of a value that are shown (chosen)


def told(value: Any) -> str:
    """The value in a few words: as Python writes it, or what it is where that would be long."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    shape = getattr(value, "shape", ())
    if isinstance(shape, tuple) and shape:
        return f"{type(value).__name__} of shape {shape}"
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"a value of type {type(value).__name__}"


def index(value: Any) -> int | None:
    """The whole number that this is; None for anything else, truth values and texts too."""
    if isinstance(value, bool) or str(getattr(value, "dtype", "")) == "bool":
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """The whole number.

    Raises:
        InputError: none, or out of range.
    """
    number = index(value)
    if number is None or number < least or (most is not None and number > most):
        bounds = f"{least} or more" if most is None else f"{least} to {most}"
        raise InputError(f"{name} must be a whole number, {bounds}, got {told(value)}")
    return number


def is_scalar(value: Any) -> bool:
    """Whether this is a number, or an array or a tracer in the place of one."""
    if isinstance(value, int | float):
        return not isinstance(value, bool) and bool(value == value)
    return hasattr(value, "dtype")


def seconds(name: str, value: Any) -> float:
    """The time (s), 0 or more.

    Raises:
        InputError: no number, or a negative one.
    """
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value < inf:
        raise InputError(f"{name} must be a time in seconds, 0 or more, got {told(value)}")
    return value


def flag(name: str, value: Any) -> bool:
    """The truth value.

    Raises:
        InputError: none.
    """
    if str(getattr(value, "dtype", "")) == "bool" and not value.shape:
        value = bool(value)
    return instance(name, value, bool, "True or False")


def function(name: str, value: Any) -> Any:
    """The function, or None.

    Raises:
        InputError: neither.
    """
    if value is not None and not callable(value):
        raise InputError(f"{name} must be a function, or None, got {told(value)}")
    return value


def functions(name: str, value: Any) -> tuple[Any, ...]:
    """The functions; of a single one, it alone; of None, none.

    Raises:
        InputError: anything else, or anything else among them.
    """
    if value is None or callable(value):
        return () if value is None else (value,)
    if not isinstance(value, list | tuple) or not all(map(callable, value)):
        raise InputError(f"{name} must be a function, or a list of them, got {told(value)}")
    return tuple(value)


def instance(name: str, value: Any, kind: type[Kind], right: str) -> Kind:
    """The value, which is of this class.

    Raises:
        InputError: it is not; `right` says what would be.
    """
    if not isinstance(value, kind):
        raise InputError(f"{name} must be {right}, got {told(value)}")
    return value


def path(name: str, value: Any) -> Path:
    """The path.

    Raises:
        InputError: neither a text nor a path, or an empty one.
    """
    usable = isinstance(value, str | os.PathLike) and isinstance(os.fspath(value), str)
    if not usable or value == "" or "\0" in str(value):
        raise InputError(f"{name} must be a path, such as 'runs/eight', got {told(value)}")
    return Path(value)


def paths(name: str, values: Any) -> list[Path]:
    """The paths; of a single one, a list of it.

    Raises:
        InputError: anything else among them, or none at all.
    """
    given = (
        [values]
        if isinstance(values, str | os.PathLike)
        else several(name, values, "paths, as a list")
    )
    return [path(name, value) for value in given]


def several(name: str, values: Any, right: str) -> list[Any]:
    """The values as a list.

    Raises:
        InputError: no list of any, or an empty one; `right` says what would be.
    """
    iterate: Callable[[], Any] | None = getattr(values, "__iter__", None)
    if iterate is None or isinstance(values, type | str | bytes | dict):
        raise InputError(f"{name} must be {right}, got {told(values)}")
    try:
        found = list(values)
    except TypeError:  # an array without axes
        raise InputError(f"{name} must be {right}, got {told(values)}") from None
    if not found:
        raise InputError(f"{name} must have at least one, got none")
    return found
