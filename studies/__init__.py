"""Programs that make what the repository keeps: released policies and studies."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from salpchain.errors import InputError
from salpchain.files import write_text


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


def add_part(path: Path, part: dict[str, Any], play: Callable[[], pd.DataFrame]) -> None:
    """The rows of this part, added to the CSV file unless they are there."""
    known = pd.read_csv(path) if path.exists() else None
    if known is not None and (known[list(part)] == pd.Series(part)).all(axis=1).any():
        return
    print(", ".join(f"{key} {value}" for key, value in part.items()), flush=True)
    whole = pd.concat([frame for frame in (known, play()) if frame is not None])
    write_text(path, whole.to_csv(index=False))
