"""What several commands read from their options."""

from typing import Annotated, Any

import tyro

from salpchain.errors import InputError
from salpchain.world.presets import WORLDS


def text_option(metavar: str, name: str | None = None) -> Any:
    """An option read as text; a default of nothing is not shown. `name`: if not the field's."""
    return tyro.conf.arg(name=name, metavar=metavar, help_behavior_hint=_default)


def _default(shown: str) -> str:
    return "" if shown in ("", "''", "()") else f"(default: {shown})"


Whole = Annotated[str, text_option("INT")]
Name = Annotated[str, text_option("NAME")]
Folder = Annotated[str, text_option("FOLDER")]
Lengths = Annotated[str, text_option("FIRST:LAST:STEP | FIRST..LAST | N,N,...")]
DRAWN = [name for name in WORLDS if name != "still"]
WORLD = (
    "Where it swims: still (the paper's; default), or a world drawn anew for each episode: "
    f"{', '.join(DRAWN[:-1])} or {DRAWN[-1]} (docs/world.md)."
)
World = Annotated[str, tyro.conf.arg(metavar="NAME", help=WORLD, help_behavior_hint="")]
Task = Annotated[str, text_option("NAME|module:Class")]
Flag = Annotated[bool, tyro.conf.arg(help_behavior_hint="")]

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


def decimals(name: str, text: str) -> tuple[float, ...]:
    """The numbers between the commas of an option; none where it was left out.

    Raises:
        InputError: one is no number.
    """
    try:
        return tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise InputError(f"--{name} must be numbers such as 0.9 or 1,2,1, got {text!r}") from None


def positive(name: str, text: str) -> int:
    """`number`, at least 1 and at most a million."""
    value = number(name, text)
    if not 1 <= value <= MOST:
        raise InputError(f"--{name} must be at least 1 and at most {MOST:,}, got {value}")
    return value
