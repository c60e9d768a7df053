"""What is told while controllers swim: the share of all work done, and what is being done.

Compiling may take a minute, so it is told as such. JAX runs the body of a compiled function only
when it traces it: what a body says here, it says before each compilation, and never in a step.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[float, str], None]  # told the share of all work done, and what is done
COMPILING = "compiling"  # what is done while a program is compiled

_listener: ContextVar[Callable[[], None] | None] = ContextVar("compiling", default=None)


def compiling() -> None:
    """Said in the body of a compiled function, when it is about to be compiled."""
    listener = _listener.get()
    if listener is not None:
        listener()


@contextmanager
def telling(
    progress: Progress | None, names: str, units: str, before: float = 0.0, part: float = 1.0
) -> Iterator[Callable[[float], None]]:
    """What is told the share of a part of the work, and tells of it, and of compiling meanwhile.

    Args:
        progress: is told.
        names: who swims.
        units: how many units they have, in words.
        before: share of all work that was done earlier.
        part: share of all work that this part is.
    """
    share = 0.0

    def done(now: float) -> None:
        nonlocal share
        share = now
        tell(units)

    def tell(what: str) -> None:
        if progress:
            progress(before + part * share, f"{names}, {what}")

    token = _listener.set(lambda: tell(f"{COMPILING} for {units}"))
    try:
        yield done
    finally:
        _listener.reset(token)
