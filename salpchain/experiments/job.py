"""What a sweep runs: jobs, each the work of one process."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable


@runtime_checkable
class Job(Protocol):
    """Work that one process does: a training with its tests, several side by side, or any other.

    What is done is read from files alone, so a job may be killed at any time and begun again: its
    command goes on from there. A job is sent to other machines, and must survive `pickle`.
    """

    @property
    def folder(self) -> Path:
        """The folder that all jobs of a sweep share, an absolute path."""
        ...

    @property
    def label(self) -> str:
        """What names its log file: no other job of the sweep has it."""
        ...

    @property
    def parts(self) -> Sequence[str]:
        """The names of what it does, such as runs."""
        ...

    @property
    def cost(self) -> float:
        """Seconds of one core that all of it takes, about."""
        ...

    def left(self) -> list[str]:
        """Which of its parts are not done."""
        ...

    def done(self) -> float:
        """Seconds of its cost that are done."""
        ...

    def command(self, devices: int | None) -> list[str]:
        """The arguments of the Python that does what is left, on this many devices or on all.

        A status other than 0 says that it failed for good, and its last line why.
        """
        ...
