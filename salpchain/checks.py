"""Checks of what settings hold: lengths, seeds, names, types. Imports nothing heavy."""

from dataclasses import is_dataclass
from math import isfinite
from typing import Any, get_args, get_type_hints

from salpchain.errors import InputError
from salpchain.given import index, instance, told
from salpchain.ranges import Range

SHORTEST, LONGEST = 2, 1024  # units


def is_number(value: object) -> bool:
    """Whether this is a number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


KINDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a finite number",
    str: "text",
    tuple[int, ...]: "whole numbers",
    tuple[float, ...]: "finite numbers",
    Range: "a number or a range such as 0:0.08",
}


def is_kind(value: object, kind: Any) -> bool:
    """Whether this is a value of one of `KINDS`; a truth value is no number."""
    if kind is float:
        return is_number(value) and isfinite(value)  # type: ignore[arg-type]
    if kind in KINDS and not get_args(kind):
        return type(value) is kind
    return isinstance(value, tuple) and all(is_kind(one, get_args(kind)[0]) for one in value)


def check_kinds(config: Any) -> None:
    """Raise InputError unless every field of a dataclass is of its kind, as annotated."""
    for name, kind in get_type_hints(type(config)).items():
        value = getattr(config, name)
        if kind in KINDS and not is_kind(value, kind):
            raise InputError(f"{name} must be {KINDS[kind]}, got {told(value)}")
        if is_dataclass(kind) and isinstance(kind, type):
            instance(name, value, kind, f"a {kind.__name__}")


def set_field(config: Any, name: str, value: object) -> None:
    """Put a checked value in the place of what a frozen dataclass was given."""
    object.__setattr__(config, name, value)


def check_length(length: Any) -> int:
    """The length, as Python's own number.

    Raises:
        InputError: it is not a number of units that a chain can have.
    """
    number = index(length)
    if number is None:
        raise InputError(f"length must be a whole number of units, got {told(length)}")
    if not SHORTEST <= number <= LONGEST:
        raise InputError(f"length must be {SHORTEST} to {LONGEST} units, got {number}")
    return number


def check_seed(seed: Any) -> int:
    """The seed, as Python's own number.

    Raises:
        InputError: it is not one of the 2^32 seeds that start different random numbers.
    """
    number = index(seed)
    if number is None or not 0 <= number < 2**32:
        raise InputError(f"seed must be a whole number 0 to {2**32 - 1}, got {told(seed)}")
    return number


def one_of(what: str, name: object, known: object) -> None:
    """Raise InputError unless the name is among the known ones; the message lists them."""
    names = list(known)  # type: ignore[call-overload]
    if not isinstance(name, str) or name not in names:
        raise InputError(f"unknown {what} {told(name)}: choose one of {', '.join(names)}")
