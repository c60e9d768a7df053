"""Packs raw results of a study into one file: python -m studies.archive pack|unpack|check FOLDER

`pack` writes FOLDER/raw.tar.xz and its checksum, FOLDER/SHA256SUMS, from all files in the folders
below FOLDER but reports, weights and caches; the files stay. `unpack` writes those that are not
there. `check` says whether the archive is whole, and what is unpacked still the same. Nothing that
differs is overwritten.
"""

import sys
from pathlib import Path

from salpchain.archive import ARCHIVE, check, pack, unpack
from salpchain.errors import InputError
from studies import program


def main() -> None:
    """Does what the command line says, and says what came of it."""
    match sys.argv[1:]:
        case ["pack", folder]:
            print(f"{pack(folder)} files packed: {Path(folder) / ARCHIVE}")
        case ["unpack", folder]:
            print(f"{unpack(folder)} files written into {folder}")
        case ["check", folder]:
            number, there = check(folder)
            print(f"{Path(folder) / ARCHIVE} is whole: {number} files, {there} of them unpacked")
        case _:
            raise InputError("give what to do: python -m studies.archive pack|unpack|check FOLDER")


if __name__ == "__main__":
    program("archive", main, __doc__)
