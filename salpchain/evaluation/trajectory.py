"""Trajectories: what pictures, videos and pages are drawn from, and their files."""

import io
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from salpchain import given
from salpchain.checks import check_kinds, check_length, check_seed, one_of
from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.files import StrPath, write_bytes
from salpchain.physics.sizes import LINK_LENGTH, UNIT_LENGTH, UNIT_WIDTH
from salpchain.tasks.config import TIME_LIMITS

FORMAT = 1
AROUND = "around"  # the field whose arrays stand beside the others in a file
PARTED = 0.02  # m, that no joint which holds is open (chosen): full thrust opens one by millimetres
LARGEST = 2**31  # bytes that a file may unpack to (chosen; the longest episode takes 1.6 GiB)

Points = np.ndarray  # (time, body, 2)
Angles = np.ndarray  # (time, body)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One episode as it was: every body at every control step, and what was done in between.

    Shapes are checked when it is made, as a file may hold anything. Time runs from the start to
    the end, both counted; what a step has (thrust, reward) is one fewer: entry k holds from time
    k to time k + 1.

    Raises:
        InputError: a field of another shape or kind than stated, or an invalid number.
    """

    policy: str  # name of the controller
    seed: int  # of the starts
    trial: int  # number of the start among those of the seed
    time_limit: str  # fixed or scaled
    length: int  # units
    dt: float  # s between two times
    success: bool  # whether the goal was reached
    unit_position: Points  # m
    unit_angle: Angles  # rad, not wrapped
    unit_velocity: Points  # m/s
    unit_angular_velocity: Angles  # rad/s
    link_position: Points  # m
    link_angle: Angles  # rad, not wrapped
    link_velocity: Points  # m/s
    link_angular_velocity: Angles  # rad/s
    thrust: np.ndarray  # (step, unit) N
    reward: np.ndarray  # (step,) the task's, unshaped
    target: np.ndarray  # (unit, 2) m; (time, unit, 2) of one that moves
    identity: str = ""  # of the controller, as `salpchain.identity`; empty in files of before
    world: str = "still"  # in which it swam
    task: str = "reach"  # what it was to do
    unit_length: float = UNIT_LENGTH  # m, along the chain
    unit_width: float = UNIT_WIDTH  # m, across it
    link_length: float = LINK_LENGTH  # m
    # (unit,) rad, of units that are rigid links: their angle minus the link's; else none
    mounts: np.ndarray = field(default_factory=lambda: np.zeros(0))
    around: Surroundings = field(default_factory=Surroundings)  # what was there

    def __post_init__(self) -> None:
        check_kinds(self)
        check_length(self.length)
        check_seed(self.seed)
        one_of("time limit", self.time_limit, TIME_LIMITS)
        if self.trial < 0:
            raise InputError(f"trial must be 0 or more, got {self.trial}")
        lengths = ("unit_length", "unit_width", "link_length")
        for name, unit in (("dt", "s"), *((name, "m") for name in lengths)):
            if not 0 < getattr(self, name) < 1e3:
                raise InputError(f"{name} must be positive ({unit}), got {getattr(self, name)}")
        for one in fields(self):
            if one.name not in (*_SCALARS, AROUND):
                given.instance(one.name, getattr(self, one.name), np.ndarray, "a NumPy array")
        times = len(np.atleast_1d(self.unit_position))
        if times < 1:
            raise InputError("unit_position has no time: it must hold at least the start")
        for name, shape in _shapes(times, self.length).items():
            moves = name == "target" and self.target_moves
            _check_array(name, getattr(self, name), (times, *shape) if moves else shape)
        if self.is_rigid:
            _check_array("mounts", self.mounts, (self.length,))
        self.around.check(times - 1, self.length)

    @property
    def unit_size(self) -> tuple[float, float]:
        """Of a unit, along the chain and across it (m)."""
        return self.unit_length, self.unit_width

    @property
    def scale(self) -> float:
        """How many times larger than for the paper's chains goal and jets are, as links are."""
        return self.link_length / LINK_LENGTH if self.is_rigid else 1.0

    @property
    def is_rigid(self) -> bool:
        """Whether each unit is a rigid link, hinged to the next end to end."""
        return self.mounts.size > 0

    @property
    def steps(self) -> int:
        """Control steps of the episode."""
        return len(self.unit_position) - 1

    @property
    def duration(self) -> float:
        """Duration of the episode (s)."""
        return self.steps * self.dt

    @property
    def unusual(self) -> list[str]:
        """The task and the world, where they are not the paper's."""
        return [name for name in (self.task, self.world) if name not in ("reach", "still")]

    @property
    def target_moves(self) -> bool:
        """Whether the target is another at each time."""
        return self.target.ndim == 3

    @property
    def targets(self) -> Float[np.ndarray, "time unit 2"]:
        """The target points (m) at every time."""
        return np.broadcast_to(self.target, self.unit_position.shape)

    @cached_property
    def distance(self) -> Float[np.ndarray, " time"]:
        """Mean distance (m) of the units to their target points at that time."""
        return np.linalg.norm(self.unit_position - self.target, axis=-1).mean(axis=1)

    @cached_property
    def centroid(self) -> Float[np.ndarray, "time 2"]:
        """Mean position of the units (m)."""
        return self.unit_position.mean(axis=1)

    @cached_property
    def link_ends(self) -> Float[np.ndarray, "time link 2"]:
        """The second end (m) of every link: where the next unit is, unless the link is cut.

        A cut link hangs on the unit before it, at its first end.
        """
        return 2 * self.link_position - self.unit_position[:, :-1]

    @cached_property
    def hinges(self) -> Float[np.ndarray, "time end 2"]:
        """Of units that are rigid links: the first end (m) of the first, then each second end."""
        angle = self.unit_angle - self.mounts
        half = self.link_length / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        ends = self.unit_position + half
        return np.concatenate([self.unit_position[:, :1] - half[:, :1], ends], axis=1)

    @cached_property
    def parted(self) -> Bool[np.ndarray, "time link"]:
        """Which links are cut: those whose second end is off its unit."""
        off = np.linalg.norm(self.link_ends - self.unit_position[:, 1:], axis=-1)
        return off > PARTED

    @property
    def closed_fraction(self) -> float:
        """1 - mean distance at the end / mean distance at the start."""
        return float(1 - self.distance[-1] / max(self.distance[0], 1e-9))

    def save(self, path: StrPath) -> None:
        """The trajectory as one compressed `.npz`, atomically; data only, never code.

        Raises:
            InputError: no path; there is no such folder, or a folder of this name.
            OSError: the folder is not writable, or the disk is full.
        """
        names = [one.name for one in fields(self) if one.name != AROUND]
        named: dict[str, Any] = {name: np.asarray(getattr(self, name)) for name in names}
        named |= self.around.named()
        content = io.BytesIO()
        np.savez_compressed(content, format=np.asarray(FORMAT), **named)
        write_bytes(path, content.getvalue())

    @classmethod
    def load(cls, path: StrPath) -> "Trajectory":
        """The trajectory in a file, every field checked.

        Raises:
            InputError: no such file; not a trajectory; cut short; a field that is missing, of
                another shape or kind, or not finite; or from a newer version.
        """
        path = given.path("path", path)
        named = _read(path)
        try:
            names = [one.name for one in fields(cls) if one.name != AROUND]
            there = [one.name for one in fields(Surroundings) if one.name in named]
            around = Surroundings(**{name: named[name] for name in there})
            return cls(**{name: _plain(named, name, path) for name in names}, around=around)
        except InputError as error:
            said = str(error)
            raise InputError(said if str(path) in said else f"{path}: {said}") from None


def as_swims(meant: Trajectory | Sequence[Trajectory]) -> list[Trajectory]:
    """The trajectories that a caller means: one, or several.

    Raises:
        InputError: something else, or none at all.
    """
    if isinstance(meant, Trajectory):
        return [meant]
    right = "a trajectory, such as salpchain.record or Trajectory.load give"
    return [
        given.instance("each of swims", swim, Trajectory, right)
        for swim in given.several("swims", meant, "trajectories, as a list")
    ]


def _shapes(times: int, length: int) -> dict[str, tuple[int, ...]]:
    """The shape of every array."""
    shapes: dict[str, tuple[int, ...]] = {}
    for body, count in (("unit", length), ("link", length - 1)):
        shapes |= {
            f"{body}_position": (times, count, 2),
            f"{body}_angle": (times, count),
            f"{body}_velocity": (times, count, 2),
            f"{body}_angular_velocity": (times, count),
        }
    return shapes | {
        "thrust": (times - 1, length),
        "reward": (times - 1,),
        "target": (length, 2),
    }


def _check_array(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if array.dtype.kind != "f" or array.shape != shape:
        raise InputError(
            f"{name} has shape {array.shape} and type {array.dtype}, expected {shape} of floats"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds numbers that are not finite")


_SCALARS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "policy": ("U", str),
    "seed": ("iu", int),
    "trial": ("iu", int),
    "time_limit": ("U", str),
    "length": ("iu", int),
    "dt": ("f", float),
    "success": ("b", bool),
    "identity": ("U", str),
    "world": ("U", str),
    "task": ("U", str),
    "unit_length": ("f", float),
    "unit_width": ("f", float),
    "link_length": ("f", float),
}
# What old files lack.
_LATER = {
    "identity": np.asarray(""),
    "world": np.asarray("still"),
    "task": np.asarray("reach"),
    "unit_length": np.asarray(UNIT_LENGTH),
    "unit_width": np.asarray(UNIT_WIDTH),
    "link_length": np.asarray(LINK_LENGTH),
    "mounts": np.zeros(0),
}


def _plain(named: dict[str, np.ndarray], name: str, path: Path) -> Any:
    """A field as the record has it: arrays as they are, the others as plain values."""
    named = _LATER | named
    if name not in named:
        raise InputError(f"{path} is not a whole trajectory: the field {name} is missing")
    array = named[name]
    if name not in _SCALARS:
        return array
    kinds, make = _SCALARS[name]
    if array.ndim or array.dtype.kind not in kinds:
        raise InputError(f"{path}: {name} must be one value, got {array.dtype} {array.shape}")
    return make(array[()])


_DAMAGE = (zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, OSError, RuntimeError)


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a file, without pickle."""
    if not path.is_file():
        raise InputError(f"no such trajectory: {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST:
            raise InputError(f"{path} unpacks to {size:,} bytes, more than any trajectory")
        with np.load(path, allow_pickle=False) as file:
            named = {name: file[name] for name in file.files}
    except InputError:
        raise
    except PermissionError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{path} is not a trajectory, or is cut short ({error})") from None
    return _of_our_format(named, path)


def _of_our_format(named: dict[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    version = named.pop("format", None)
    if version is None or version.ndim or version.dtype.kind not in "iu":
        raise InputError(f"{path} is not a salpchain trajectory: it does not state its format")
    if version > FORMAT:
        raise InputError(
            f"{path} was written by a newer salpchain (format {version}, this one reads up to"
            f" {FORMAT}): upgrade salpchain"
        )
    return named
