"""Best-known solutions: their file, and what of a user's own is taken into it.

Thrusts are whole numbers of 1/127 N, kept as bytes and compressed. Read and written without JAX.
"""

import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int8

from salpchain import given
from salpchain.errors import InputError
from salpchain.evaluation.best.starts import DIGEST, FOLDER, SEED, STARTS, check_place
from salpchain.files import StrPath, read_arrays, write_arrays, writing
from salpchain.given import told
from salpchain.tasks.config import step_limit

KIND = "best-known solutions"
FORMAT = 1
QUANTA = 127  # of thrust in one newton: what a byte holds
LARGEST = 2**26  # bytes that a file to be added may unpack to (chosen)
MOST_WORDS = 200  # characters of who and how (chosen)

Thrusts = Int8[np.ndarray, "step unit"]  # in 1/127 N


@dataclass(frozen=True, eq=False)
class Solution:
    """Thrusts that take one start to its target."""

    thrusts: Thrusts
    who: str  # found it
    how: str  # it was found

    @property
    def steps(self) -> int:
        """Control steps until the goal."""
        return len(self.thrusts)

    @property
    def newtons(self) -> np.ndarray:
        """The thrusts (N), (step, unit)."""
        return self.thrusts.astype(np.float32) / QUANTA


Found = dict[int, Solution]  # by the number of the start


def quantised(thrusts: np.ndarray) -> Thrusts:
    """Thrusts (N) as whole numbers of 1/127 N."""
    return np.round(np.clip(thrusts, -1.0, 1.0) * QUANTA).astype(np.int8)


def load(length: int, folder: StrPath = FOLDER) -> Found:
    """The best-known solutions of a length, by the number of their start; none if no file is there.

    Raises:
        InputError: no starts of this length; a damaged file, one of another length, for other
            starts, or from a newer version.
    """
    check_place(length, 0)
    path = path_of(length, folder)
    if not path.exists():
        return {}
    header, arrays = read_arrays(path, KIND, FORMAT)
    if header["length"] != length or header["starts"] != DIGEST:
        raise InputError(f"{path} holds solutions of other starts than those of {length} units")
    numbers, steps = arrays["start"], arrays["steps"]
    raw = np.frombuffer(zlib.decompress(arrays["thrusts"].tobytes()), np.int8)
    every = np.split(raw.reshape(length, -1).T, np.cumsum(steps)[:-1])
    words = zip(header["who"], header["how"], strict=True)
    return {
        int(number): Solution(thrusts, *said)
        for number, thrusts, said in zip(numbers, every, words, strict=True)
    }


def save(length: int, found: Found, folder: StrPath = FOLDER) -> None:
    """Writes the solutions of a length, atomically.

    Raises:
        InputError: there is no such folder.
        OSError: it is not writable, or the disk is full.
    """
    numbers = sorted(found)
    every = [found[number] for number in numbers]
    raw = np.concatenate([one.thrusts for one in every]).T  # a unit's thrusts change seldom
    arrays = {
        "start": np.array(numbers, np.int32),
        "steps": np.array([one.steps for one in every], np.int32),
        "thrusts": np.frombuffer(zlib.compress(raw.tobytes(), 9), np.uint8),
    }
    header = {
        "length": length,
        "starts": DIGEST,
        "who": [one.who for one in every],
        "how": [one.how for one in every],
    }
    write_arrays(path_of(length, folder), KIND, FORMAT, header, arrays)


def keep(length: int, offered: Found, folder: StrPath = FOLDER) -> Found:
    """Takes into the file of a length what is better than what it holds; returns all of it.

    Raises:
        InputError: a damaged file, or another process is writing it.
        OSError: it is not writable, or the disk is full.
    """
    with writing(path_of(length, folder)):
        found = load(length, folder)
        better = {
            number: one
            for number, one in offered.items()
            if number not in found or one.steps < found[number].steps
        }
        if better:
            found |= better
            save(length, found, folder)
    return found


def path_of(length: int, folder: StrPath = FOLDER) -> Path:
    """The file of a length."""
    return given.path("folder", folder) / f"{length}.safetensors"


@dataclass(frozen=True, eq=False)
class Offer:
    """What somebody wants to add."""

    length: int
    start: int
    solution: Solution

    def shortened(self, steps: int) -> "Offer":
        """The same with its first steps alone."""
        thrusts = self.solution.thrusts[:steps]
        return replace(self, solution=replace(self.solution, thrusts=thrusts))


def read_offer(path: StrPath, who: str, how: str) -> Offer:
    """A solution in a file: `length`, `start` and `thrusts` (step, unit) in N as an `.npz`, or a
    trajectory that `salpchain rollout` recorded from one of the starts.

    Raises:
        InputError: no such file; no `.npz`; a field that is missing or of another shape; a start
            that is not there; thrusts that are not finite, beyond 1 N, or more than the time limit;
            `who` or `how` that is no line of text.
    """
    path = given.path("path", path)
    for name, text in (("who", who), ("how", how)):
        if not (text.strip() and text.isprintable() and len(text) <= MOST_WORDS):
            raise InputError(
                f"{name} must be one line of 1 to {MOST_WORDS} characters, got {told(text)}"
            )
    named = _read(path)
    if "thrust" in named and "trial" in named:
        named = _of_trajectory(named, path)
    for name in ("length", "start", "thrusts"):
        if name not in named:
            raise InputError(f"{path} has no {name}: give length, start and thrusts (step, unit)")
    length, start = (_number(named, name, path) for name in ("length", "start"))
    check_place(length, start)
    thrusts = _checked(named["thrusts"], length, path)
    return Offer(length, start, Solution(quantised(thrusts), who, how))


def _of_trajectory(named: dict[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """The fields of an offer that a recorded trajectory has."""
    seed, trial = (_number(named, name, path) for name in ("seed", "trial"))
    usual = all(str(named.get(name, usual)) == usual for name, usual in _USUAL.items())
    if seed != SEED or not usual:
        raise InputError(
            f"{path} is no swim from one of these starts: record it in still water, task reach,"
            f" with --seed {SEED} and --trial 0 to {STARTS - 1}"
        )
    return {"length": named["length"], "start": np.asarray(trial), "thrusts": named["thrust"]}


_USUAL = {"world": "still", "task": "reach"}


def _number(named: dict[str, np.ndarray], name: str, path: Path) -> int:
    value = named[name]
    if value.ndim or value.dtype.kind not in "iu":
        raise InputError(f"{path}: {name} must be one whole number, got {told(value)}")
    return int(value)


def _checked(thrusts: np.ndarray, length: int, path: Path) -> np.ndarray:
    """Thrusts (N) of a swim that this length can have."""
    most = step_limit("scaled", length)
    right = thrusts.ndim == 2 and thrusts.shape[1] == length and 1 <= len(thrusts) <= most
    if thrusts.dtype.kind != "f" or not right:
        raise InputError(
            f"{path}: thrusts must be floats (step, {length}), 1 to {most} steps, got"
            f" {thrusts.dtype} {thrusts.shape}"
        )
    if not np.isfinite(thrusts).all() or np.abs(thrusts).max() > 1.0:
        raise InputError(f"{path}: thrusts must be finite and lie in [-1, 1] N")
    return thrusts


_DAMAGE = (zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, OSError, RuntimeError)


def _read(path: Path) -> dict[str, Any]:
    """The arrays of an `.npz`, without pickle."""
    if not path.is_file():
        raise InputError(f"no such file: {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST:
            raise InputError(f"{path} unpacks to {size:,} bytes, more than any solution")
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (InputError, PermissionError):
        raise
    except _DAMAGE as error:
        raise InputError(f"{path} is no .npz with a solution, or is cut short ({error})") from None
