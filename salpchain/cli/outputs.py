"""Files that commands write: what a user has there already is replaced only when that was asked."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from salpchain.errors import InputError


def check_new(path: Path) -> None:
    """Raise InputError if there is such a file already."""
    if path.exists():
        raise InputError(f"{path} exists: choose another --out, or add --overwrite to replace it")


def write_new(paths: Sequence[Path], overwrite: bool, make: Callable[[Path], object]) -> None:
    """Let `make` write the files, if none is there, all are to be replaced, or none would change.

    `make` is given the path of the first and writes the others, of other suffixes, beside it; the
    same bytes each time.

    Raises:
        InputError: a file is there with another content.
    """
    there = [path for path in paths if path.is_file()]
    if there and not overwrite:
        with tempfile.TemporaryDirectory() as folder:
            make(Path(folder) / paths[0].name)
            for path in there:
                if path.read_bytes() != (Path(folder) / path.name).read_bytes():
                    check_new(path)
    if overwrite or there != list(paths):
        make(paths[0])
