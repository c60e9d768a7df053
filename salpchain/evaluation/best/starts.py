"""The starts of the best-known solutions: the same for everybody, stored with the package."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from jaxtyping import Float

from salpchain.errors import InputError
from salpchain.files import StrPath, read_arrays, write_arrays
from salpchain.given import told, whole

LENGTHS = (2, 3, 4, 6, 8, 12, 16, 32)  # units
STARTS = 100  # of each length
SEED = 3030  # start k of a length is trial k of this seed (chosen)
VERSION = 1  # of the starts: another set of them would be version 2
KIND = "starts"
FOLDER = Path(str(files("salpchain"))) / "solutions"
FILE = "starts.safetensors"
# sha256 over the arrays, as `digest` has it: what a solution is for
DIGEST = "4bce93c199b807ea3fe7e6db191089169e7571d799e1f44275bb5ee76ba305a7"


@dataclass(frozen=True, eq=False)
class Starts:
    """The starts of one length: straight chains at rest, and the poses that they must take."""

    position: Float[np.ndarray, "start unit 2"]  # m, of the units
    angle: Float[np.ndarray, " start"]  # rad, of all units
    target: Float[np.ndarray, "start unit 2"]  # m

    @property
    def length(self) -> int:
        """Units of the chains."""
        return self.position.shape[1]


def check_place(length: object, start: object) -> tuple[int, int]:
    """A length and the number of one of its starts.

    Raises:
        InputError: there are no starts of this length, or no such number.
    """
    if type(length) is not int or length not in LENGTHS:
        known = ", ".join(map(str, LENGTHS))
        raise InputError(f"length must be one of {known} units, got {told(length)}")
    return length, whole("start", start, least=0, most=STARTS - 1)


@cache
def load(length: int) -> Starts:
    """The starts of a length.

    Raises:
        InputError: there are none of this length, or the file is damaged.
    """
    check_place(length, 0)
    return read(FOLDER / FILE)[length]


def read(path: StrPath) -> dict[int, Starts]:
    """The starts in a file, by length.

    Raises:
        InputError: no such file, a damaged one, or other starts than those of this version.
    """
    header, arrays = read_arrays(path, KIND, VERSION)
    starts = {
        length: Starts(*(arrays[f"{name}-{length}"] for name in Starts.__annotations__))
        for length in header["lengths"]
    }
    if digest(starts) != DIGEST:
        raise InputError(f"{path} holds other starts than version {VERSION}: install again")
    return starts


def write(starts: dict[int, Starts], path: StrPath) -> None:
    """Stores starts, by length."""
    header = {"lengths": list(starts), "seed": SEED, "digest": digest(starts)}
    write_arrays(path, KIND, VERSION, header, _named(starts))


def digest(starts: dict[int, Starts]) -> str:
    """A checksum over every number of every start."""
    from hashlib import sha256

    total = sha256()
    for name, array in sorted(_named(starts).items()):
        total.update(f"{name}{array.shape}".encode() + np.asarray(array, "<f4").tobytes())
    return total.hexdigest()


def _named(starts: dict[int, Starts]) -> dict[str, np.ndarray]:
    return {
        f"{name}-{length}": np.ascontiguousarray(getattr(some, name), "<f4")
        for length, some in starts.items()
        for name in Starts.__annotations__
    }
