"""Files that are whole or not there: written beside, flushed, renamed; checked when read."""

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from salpchain import given
from salpchain.errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

Arrays = dict[str, np.ndarray]
StrPath = str | os.PathLike[str]  # what every function takes that takes a path

LOCK_FILE = ".lock"
LOOK_EVERY = 0.5  # s between two looks at a lock that another process has (chosen)
_HEADER = "salpchain"


def write_bytes(path: StrPath, content: bytes) -> None:
    """The file with this content, or, if that fails, as it was before.

    Raises:
        InputError: no path; there is no such folder, or a folder of this name.
        OSError: the folder is not writable, or the disk is full.
    """
    path = given.path("path", path)
    if not path.parent.is_dir():
        raise InputError(f"no such folder: {path.parent} (make it, then write {path.name} there)")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file")
    try:
        _write_beside(path, content)
    except OSError as error:  # about the file that was asked for, not the one beside it
        raise OSError(error.errno, error.strerror, str(path)) from None


def _write_beside(path: Path, content: bytes) -> None:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    beside = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.chmod(0o644)
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def make_writable(folder: StrPath) -> None:
    """The folder, made if it is missing, after a file was written there and taken away.

    Raises:
        OSError: it cannot be made, or written to.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from None


@contextmanager
def alone(folder: StrPath, patience: float = 0.0) -> Iterator[None]:
    """Keeps other processes that ask for the same out of a folder, until the end of the block.

    A process that dies lets go of it; another waits for it up to `patience` seconds. Where the
    system has no such locks, nobody is kept out.

    Raises:
        InputError: another process has it.
    """
    if fcntl is None:
        yield
        return
    with (Path(folder) / LOCK_FILE).open("w") as file:
        until = time.monotonic() + patience
        while not _locked(file):
            if time.monotonic() >= until:
                raise InputError(f"{folder} is in use by another process: wait for its end")
            time.sleep(LOOK_EVERY)
        yield


@contextmanager
def writing(path: StrPath) -> Iterator[None]:
    """Keeps other processes that ask for the same from writing a file, until the end of the block.

    The lock is a hidden file beside it, gone at the end.

    Raises:
        InputError: another process is writing it.
        OSError: the folder is missing or not writable.
    """
    path = Path(path)
    if fcntl is None or not path.name:
        yield
        return
    beside = path.with_name(f".{path.name}.lock")
    try:
        file = beside.open("w")
    except OSError as error:  # about the file that was asked for, not the one beside it
        raise OSError(error.errno, error.strerror, str(path)) from None
    with file:
        if not _locked(file) or not _is_at(file, beside):
            raise InputError(f"{path} is being written by another process: wait for its end")
        try:
            yield
        finally:
            beside.unlink(missing_ok=True)


def _is_at(file: IO[str], path: Path) -> bool:
    """Whether the open file is still the one at this path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _locked(file: IO[str]) -> bool:
    """Whether the lock was free; if so, it is ours."""
    assert fcntl is not None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def write_text(path: StrPath, content: str) -> None:
    """`write_bytes` of UTF-8 text."""
    write_bytes(path, content.encode())


def write_json(path: StrPath, content: Any) -> None:
    """`write_text` of indented JSON; NaN is refused."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: StrPath) -> Any:
    """The content of a JSON file.

    Raises:
        InputError: there is no such file, or it is not JSON.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path} is not valid JSON ({error})") from None


def write_arrays(
    path: StrPath, kind: str, version: int, header: Mapping[str, Any], arrays: Arrays
) -> None:
    """Named arrays with a JSON header and a checksum, as one safetensors file."""
    about = {"kind": kind, "version": version, "header": header}
    about["sha256"] = _digest(about, arrays)
    write_bytes(path, save(arrays, metadata={_HEADER: json.dumps(about)}))


def read_arrays(path: StrPath, kind: str, version: int) -> tuple[dict[str, Any], Arrays]:
    """Header and arrays of a file of this kind, written by this version or an older one.

    The file is data: reading it runs no code.

    Raises:
        InputError: no such file; not such a file; cut short; altered; or from a newer version.
    """
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder: give the file in it") from None
    about = _about(path, kind, content)
    if about["version"] > version:
        raise InputError(
            f"{path} was written by a newer salpchain (format {about['version']}, this one reads"
            f" up to {version}): upgrade salpchain"
        )
    try:
        arrays = load(content)
    except SafetensorError as error:
        raise InputError(f"{path} is damaged or cut short ({error})") from None
    if _digest({key: about[key] for key in about if key != "sha256"}, arrays) != about["sha256"]:
        raise InputError(f"{path} was altered or damaged: its checksum does not match its content")
    return about["header"], arrays


def _about(path: StrPath, kind: str, content: bytes) -> dict[str, Any]:
    """Our header out of the safetensors header: 8 bytes of length, then JSON."""
    try:
        size = int.from_bytes(content[:8], "little")
        about = json.loads(json.loads(content[8 : 8 + size])["__metadata__"][_HEADER])
        found, good = about["kind"], type(about["version"]) is int and about["version"] > 0
        good = good and {"header", "sha256"} <= about.keys()
    except (ValueError, KeyError, TypeError, RecursionError):
        good, found = False, kind
    if found != kind:
        raise InputError(f"{path} is a salpchain {found}, not a {kind}")
    if not good:
        raise InputError(f"{path} is not a salpchain {kind}, or is cut short")
    return about


def _digest(about: Mapping[str, Any], arrays: Arrays) -> str:
    """A checksum over everything that the file says: its kind, version, header and arrays."""
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name}{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
