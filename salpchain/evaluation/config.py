"""Settings of an evaluation. Imports nothing heavy: the command line checks its input with it."""

from collections.abc import Iterable, Sequence
from typing import Any

from salpchain.checks import LONGEST, check_length
from salpchain.errors import InputError
from salpchain.given import index, several
from salpchain.networks.config import SINGLE_LENGTH

TRIALS_FILE = "evaluation.csv"
SUMMARY_FILE = "evaluation.json"
SLOTS = (16, 32, 64, 128, 256, 512, LONGEST)  # of programs, which many lengths share (chosen)
Lengths = int | str | Iterable[int]  # what a function takes that takes lengths
MEANT = "a number of units, a list of them, or a text such as 4..16"
RANGE_HELP = "give lengths as 4..16, 4:64:4 (from:to:step, the end included), 4,8,16 or 8"


def parse_lengths(text: str) -> list[int]:
    """The lengths that a text names, ascending and each once.

    Raises:
        InputError: as `list_lengths`.
    """
    return sorted(set(list_lengths(text)))


def list_lengths(text: str) -> list[int]:
    """The lengths that a text names, as typed.

    Parts between commas are numbers or ranges whose end is included: `4:64:4` is 4, 8, ..., 64,
    and `4..16` every length from 4 to 16.

    Raises:
        InputError: nothing, no whole number, a range that is none, or a length out of bounds.
    """
    lengths = [length for part in text.split(",") for length in _part(part.strip(), text)]
    try:
        return [check_length(length) for length in lengths]
    except ValueError as error:
        raise InputError(f"lengths {text!r}: {error}") from None


def as_lengths(meant: Any) -> list[int]:
    """The lengths that a caller means, in that order: one, several, or a text such as `4..16`.

    Raises:
        InputError: none at all, or what is no length.
    """
    if isinstance(meant, str):
        return list_lengths(meant)
    if index(meant) is not None:
        return [check_length(meant)]
    return [check_length(length) for length in several("lengths", meant, MEANT)]


def programs(model: str, lengths: Iterable[int]) -> int:
    """How many programs trials at these lengths take: one for each number of slots."""
    if model in SINGLE_LENGTH:
        return len(set(lengths))
    return len({next(slots for slots in SLOTS if length <= slots) for length in lengths})


def lengths_as_text(lengths: Sequence[int]) -> str:
    """The text that names these lengths, ascending and each once: `4..16`, or `4,8,16`."""
    first, last = lengths[0], lengths[-1]
    if len(lengths) > 2 and last - first == len(lengths) - 1:
        return f"{first}..{last}"
    return ",".join(map(str, lengths))


def _part(part: str, text: str) -> list[int]:
    """The lengths of one number or one range."""
    numbers = [_number(piece, text) for piece in part.replace("..", ":").split(":")]
    if len(numbers) == 1:
        return numbers
    if ".." in part and len(numbers) == 2:
        numbers.append(1)
    if len(numbers) != 3:
        raise InputError(f"lengths {text!r}: a range has three numbers; {RANGE_HELP}")
    first, last, step = numbers
    if step < 1:
        raise InputError(f"lengths {text!r}: the step must be positive, got {step}")
    if last < first:
        raise InputError(f"lengths {text!r}: the range runs backwards; {RANGE_HELP}")
    for bound in (first, last):
        _check_bound(bound, text)
    return list(range(first, last + 1, step))


def _check_bound(bound: int, text: str) -> None:
    """Stops an absurd range before it becomes an absurd list."""
    try:
        check_length(bound)
    except ValueError as error:
        raise InputError(f"lengths {text!r}: {error}") from None


def _number(piece: str, text: str) -> int:
    digits = piece.strip()
    if not (digits.removeprefix("-").isascii() and digits.removeprefix("-").isdigit()):
        what = f"{digits!r} is not a whole number" if digits else "a number is missing"
        raise InputError(f"lengths {text!r}: {what}; {RANGE_HELP}")
    return int(digits)
