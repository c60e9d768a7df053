"""Standard output and error: results go to one, progress and notices to the other.

No stream decides over the work: a character that it cannot show is written as its number, a
reader that has gone is no error, and where a result cannot be written the command still does all
that it was asked for, says so and exits with 1.
"""

import io
import os
import sys
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console

_quiet = False


class Tolerant(io.RawIOBase):
    """A file that takes everything; the first failure to write is kept."""

    def __init__(self, number: int) -> None:
        """For a file descriptor."""
        self.number, self.failure = number, None

    def writable(self) -> bool:
        """Always."""
        return True

    def fileno(self) -> int:
        """The file descriptor."""
        return self.number

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self.number)

    def write(self, content: Any, /) -> int:
        """Writes what can be written; says that all of it was."""
        left = memoryview(content).cast("B")
        size = len(left)
        try:
            while left and self.failure is None:
                left = left[os.write(self.number, left) :]
        except OSError as error:
            self.failure: OSError | None = error
        return size


def install() -> Tolerant:
    """Put tolerant streams in place of this process's; returns that of the results."""
    _fill_closed()
    tolerant = Tolerant(1)
    sys.stdout, sys.stderr = _text(tolerant, sys.stdout), _text(Tolerant(2), sys.stderr)
    return tolerant


def _fill_closed() -> None:
    """Open streams that were closed, on nothing: else the next file would take their place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115


def _text(raw: Tolerant, before: TextIO) -> TextIO:
    """Text in the encoding of the stream before; a line at a time where that did so."""
    lines = getattr(before, "line_buffering", False) or raw.isatty()
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=before.encoding,
        errors="backslashreplace",
        line_buffering=lines,
        write_through=getattr(before, "write_through", False),
    )


def close(results: Tolerant, status: int) -> int:
    """The exit status, after all is written: 1 if results were lost in an otherwise good end."""
    sys.stdout.flush()
    failure = results.failure
    if failure is None or isinstance(failure, BrokenPipeError):
        return status
    said = (failure.strerror or str(failure)).lower()
    print(f"salpchain: error: not all output could be written: {said}", file=sys.stderr)
    return status or 1


def set_quiet(quiet: bool) -> None:
    """Whether progress and notices are left out."""
    global _quiet
    _quiet = quiet


def notices() -> "Console":
    """Where progress and notices are shown."""
    from rich.console import Console

    return Console(stderr=True, quiet=_quiet)


def say(line: str) -> None:
    """Shows a notice, if there is one to show."""
    if line and not _quiet:
        print(line, file=sys.stderr)
