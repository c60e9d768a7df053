"""Settings of the task. Imports nothing heavy: the command line's help reads these classes."""

from dataclasses import dataclass, is_dataclass
from math import inf, isfinite
from typing import Any, get_args, get_type_hints

from salpchain.errors import InputError
from salpchain.given import index, instance, told
from salpchain.world.config import Range

SHORTEST, LONGEST = 2, 512  # units
TIME_LIMITS = ("fixed", "scaled")
PLAYED_LIMIT = "scaled"  # where a policy is played and nothing else was asked for
ACTION_SIZES: dict[str, int] = {"thrust": 1, "pair": 2}
OBSERVATION_SIZES: dict[str, int] = {
    "body": 22,
    "table1": 24,
    "proximity": 24,
    "anonymous": 23,
    "metric": 24,
}
GOAL_LIMIT = 0.05129329438755058  # m, where exp(-Frechet distance) = 0.95 (paper equation 7)
FIXED_LIMIT = 512  # control steps (the paper's)
STEPS_PER_UNIT = 32  # control steps for each unit under the scaled limit


@dataclass(frozen=True)
class TaskConfig:
    """The Salp Chain Locomotion Domain, as one run plays it.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    length: int = 8  # number of units; the slots of a batch that mixes lengths
    observation: str = "body"  # or another of OBSERVATION_SIZES
    action: str = "thrust"  # or pair
    time_limit: str = "fixed"  # or scaled
    fence: bool = False  # clamp to abs(x), abs(y) <= length / 4 m and end there
    contact: bool = True  # units collide
    fine_weight: float = 0.0  # of the shaping term; 0 is the paper's reward
    folded: float = 0.0  # share of episodes that start from a folded chain; 0 is the paper's
    stalled: float = 0.0  # share that starts on the target with a part folded back; likewise
    tolerance: float = GOAL_LIMIT  # m, Frechet distance at which the target pose is taken
    most_steps: int = 0  # control steps of an episode whatever its length; 0: as `time_limit` says

    def __post_init__(self) -> None:
        set_field(self, "length", check_length(self.length))
        one_of("observation", self.observation, OBSERVATION_SIZES)
        one_of("action", self.action, ACTION_SIZES)
        one_of("time limit", self.time_limit, TIME_LIMITS)
        for name in ("fence", "contact"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} must be True or False, got {told(getattr(self, name))}")
        if not (_is_number(self.fine_weight) and 0 <= self.fine_weight < inf):
            raise InputError(
                f"fine_weight must be a number, 0 or more, got {told(self.fine_weight)}"
            )
        for name in ("folded", "stalled"):
            share = getattr(self, name)
            if not (_is_number(share) and 0 <= share <= 1):
                raise InputError(f"{name} must be a share, 0 to 1, got {told(share)}")
        if self.folded + self.stalled > 1:
            raise InputError(
                f"folded and stalled must be at most 1 together, got {self.folded} + {self.stalled}"
            )
        if not (_is_number(self.tolerance) and 0 < self.tolerance <= 1):
            raise InputError(f"tolerance must lie in (0, 1] m, got {told(self.tolerance)}")
        if type(self.most_steps) is not int or self.most_steps < 0:
            raise InputError(
                f"most_steps must be a whole number, 0 or more, got {told(self.most_steps)}"
            )

    @property
    def step_limit(self) -> int:
        """Control steps until an episode of `length` units is truncated."""
        return self.most_steps or step_limit(self.time_limit, self.length)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


KINDS: dict[Any, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a finite number",
    str: "text",
    tuple[int, ...]: "whole numbers",
    tuple[float, ...]: "finite numbers",
    Range: "a number or a range such as 0:0.08",
}


def is_kind(value: object, kind: Any) -> bool:
    """Whether this is a value of one of `KINDS`; a truth value is no number."""
    if kind is float:
        return _is_number(value) and isfinite(value)  # type: ignore[arg-type]
    if kind in KINDS and not get_args(kind):
        return type(value) is kind
    return isinstance(value, tuple) and all(is_kind(one, get_args(kind)[0]) for one in value)


def check_kinds(config: Any) -> None:
    """Raise InputError unless every field of a dataclass is of its kind, as annotated."""
    for name, kind in get_type_hints(type(config)).items():
        value = getattr(config, name)
        if kind in KINDS and not is_kind(value, kind):
            raise InputError(f"{name} must be {KINDS[kind]}, got {told(value)}")
        if is_dataclass(kind) and isinstance(kind, type):
            instance(name, value, kind, f"a {kind.__name__}")


def set_field(config: Any, name: str, value: object) -> None:
    """Put a checked value in the place of what a frozen dataclass was given."""
    object.__setattr__(config, name, value)


def check_length(length: Any) -> int:
    """The length, as Python's own number.

    Raises:
        InputError: it is not a number of units that a chain can have.
    """
    number = index(length)
    if number is None:
        raise InputError(f"length must be a whole number of units, got {told(length)}")
    if not SHORTEST <= number <= LONGEST:
        raise InputError(f"length must be {SHORTEST} to {LONGEST} units, got {number}")
    return number


def check_seed(seed: Any) -> int:
    """The seed, as Python's own number.

    Raises:
        InputError: it is not one of the 2^32 seeds that start different random numbers.
    """
    number = index(seed)
    if number is None or not 0 <= number < 2**32:
        raise InputError(f"seed must be 0 to {2**32 - 1}, got {told(seed)}")
    return number


def one_of(what: str, name: object, known: object) -> None:
    """Raise InputError unless the name is among the known ones; the message lists them."""
    names = list(known)  # type: ignore[call-overload]
    if not isinstance(name, str) or name not in names:
        raise InputError(f"unknown {what} {told(name)}: choose one of {', '.join(names)}")


def step_limit(time_limit: str, length: int) -> int:
    """Control steps until an episode of this length is truncated."""
    return FIXED_LIMIT if time_limit == "fixed" else max(FIXED_LIMIT, STEPS_PER_UNIT * length)
