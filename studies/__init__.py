"""Programs that make what the repository keeps: released policies and studies."""

import sys
from collections.abc import Callable

from salpchain.errors import InputError


def program(name: str, main: Callable[[], None]) -> None:
    """The program; bad input is one line and exit status 2, an interrupt one and 130."""
    try:
        main()
    except InputError as error:
        print(f"studies.{name}: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"studies.{name}: stopped; the same command goes on", file=sys.stderr)
        sys.exit(130)
