"""Compiled programs kept in the user's cache folder, so that a second start need not compile."""

import contextlib
import hashlib
import os
import re
import sys
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from salpchain import __version__
from salpchain.errors import InputError
from salpchain.files import make_writable
from salpchain.machine import instructions, processor

SWITCH = "SALPCHAIN_CACHE"  # on (the default), off, or a folder
JAX_FOLDER = "JAX_COMPILATION_CACHE_DIR"
JAX_SHORTEST = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"
OFF = ("off", "0", "no", "false")
ON = ("", "on", "1", "yes", "true")
MOST_BYTES = 512 * 2**20  # of all entries, about 0.5 MB for each command and length (chosen)

# What JAX warns of, and then compiles as if there were no cache.
_TROUBLE = re.compile(r"Error (reading|writing) persistent compilation cache entry for '(.*?)'")
_ours: Path | None = None  # the folder that this process set, not its user


def use_cache() -> Path | None:
    """The folder where JAX now keeps compiled programs; None without one.

    It lies in the user's cache folder, named by the versions of salpchain, JAX and jaxlib and by
    the processor, for programs of one need not run on another. The command line calls this by
    itself; in Python call it once, before the first computation. A folder that was set for JAX
    (`JAX_COMPILATION_CACHE_DIR`) is left as it is; `SALPCHAIN_CACHE=off` turns this off, and
    `SALPCHAIN_CACHE=/some/folder` moves it. A cache folder that cannot be written is no error.

    Raises:
        InputError: `SALPCHAIN_CACHE` is none of these.
    """
    root = _root()
    if root is None or set_by_user():
        return None
    folder = root / _key()
    try:
        _make_private(root)
        make_writable(folder)
        _prune(root, MOST_BYTES)
    except OSError:
        return None
    _tell_jax(folder)
    return folder


def set_by_user() -> bool:
    """Whether the user chose a folder for JAX, by environment or in this process."""
    before = os.environ.get(JAX_FOLDER)
    if "jax" in sys.modules:
        before = before or sys.modules["jax"].config.jax_compilation_cache_dir
    return before is not None and before != str(_ours)


def is_off() -> bool:
    """Whether the user wants no programs kept."""
    return os.environ.get(SWITCH, "").lower() in OFF


def _root() -> Path | None:
    """The folder of all versions; None if the cache is off or there is no home."""
    asked = os.environ.get(SWITCH, "")
    if is_off():
        return None
    if asked.lower() not in ON:
        if not Path(asked).is_absolute():
            raise InputError(f"{SWITCH} must be on, off or an absolute folder, got {asked!r}")
        return Path(asked)
    try:
        return _user_cache() / "salpchain" / "compiled"
    except RuntimeError:  # no home
        return None


def _user_cache() -> Path:
    """Where programs of this user keep what they can make again."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return given if given.is_absolute() else Path.home() / ".cache"


def _key() -> str:
    """Versions and processor; JAX itself adds the program, its options and the accelerator."""
    chip = hashlib.sha256(f"{processor()} {instructions()}".encode()).hexdigest()[:12]
    return f"{__version__}-jax{version('jax')}-jaxlib{version('jaxlib')}-{chip}"


def _make_private(root: Path) -> None:
    """Make the folder; raise OSError if others could put programs there for us to run."""
    root.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid") and root.stat().st_uid != os.getuid():
        raise PermissionError(f"{root} belongs to someone else")


def _prune(root: Path, most: int) -> None:
    """Delete the entries that were not used for the longest time until `most` bytes are left.

    JAX can bound its cache too, but locks it for each look, which is slow or impossible on network
    file systems, and never writes again once a process was killed between an entry and its date.
    """
    entries = []
    for path in root.rglob("*"):
        with contextlib.suppress(FileNotFoundError):
            about = path.stat()
            if path.is_file():
                entries.append((max(about.st_atime, about.st_mtime), about.st_size, path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= most:
            return
        path.unlink(missing_ok=True)
        total -= size


def _tell_jax(folder: Path) -> None:
    global _ours
    _ours = folder
    os.environ[JAX_FOLDER] = str(folder)
    os.environ.setdefault(JAX_SHORTEST, "0")
    if "jax" in sys.modules:
        config = sys.modules["jax"].config
        config.update("jax_compilation_cache_dir", str(folder))
        config.update("jax_persistent_cache_min_compile_time_secs", float(os.environ[JAX_SHORTEST]))
    if not isinstance(warnings.showwarning, _Repair):
        warnings.showwarning = _Repair(warnings.showwarning)


class _Repair:
    """Shows warnings; on one about an entry of the cache it deletes that entry instead.

    A killed process leaves half an entry. JAX warns, compiles, and keeps the half; where it is gone
    JAX writes the whole.
    """

    def __init__(self, show: Callable[..., None]) -> None:
        self._show = show

    def __call__(self, message: Any, *about: Any, **more: Any) -> None:
        trouble = _TROUBLE.match(str(message))
        if trouble is None or _ours is None:
            self._show(message, *about, **more)
        elif trouble[1] == "reading":
            _forget(_ours, trouble[2])


def _forget(folder: Path, program: str) -> None:
    for entry in folder.iterdir():
        if entry.name.startswith(f"{program}-"):
            with contextlib.suppress(OSError):
                entry.unlink()
