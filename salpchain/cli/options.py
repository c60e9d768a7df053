"""What several commands read from their options."""

from typing import Annotated

import tyro

from salpchain.errors import InputError

Whole = Annotated[str, tyro.conf.arg(metavar="INT")]
Name = Annotated[str, tyro.conf.arg(metavar="NAME")]
Folder = Annotated[str, tyro.conf.arg(metavar="FOLDER")]
Lengths = Annotated[str, tyro.conf.arg(metavar="FIRST:LAST:STEP | N,N,...")]

MOST = 1_000_000  # trials or chains that one may ask for (chosen)


def whole(name: str, text: str) -> int | None:
    """The whole number that an option holds; None where it was left out.

    Raises:
        InputError: it is something else.
    """
    if text == "":
        return None
    try:
        return int(text.replace("_", ""))
    except ValueError:
        raise InputError(f"--{name} must be a whole number, got {text!r}") from None


def number(name: str, text: str) -> int:
    """`whole` for an option that cannot be left out."""
    value = whole(name, text)
    if value is None:
        raise InputError(f"--{name} must be a whole number, got nothing")
    return value


def positive(name: str, text: str) -> int:
    """`number`, at least 1 and at most a million."""
    value = number(name, text)
    if not 1 <= value <= MOST:
        raise InputError(f"--{name} must be at least 1 and at most {MOST:,}, got {value}")
    return value
