"""Settings that every task has. Imports nothing heavy: the command line's help reads them."""

from dataclasses import dataclass
from math import inf

from salpchain.checks import check_length, is_number, one_of, set_field
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.tasks.features import check_observation
from salpchain.tasks.registry import check_task

TIME_LIMITS = ("fixed", "scaled")
PLAYED_LIMIT = "scaled"  # where a policy is played and nothing else was asked for
ACTION_SIZES: dict[str, int] = {"thrust": 1, "pair": 2, "grip": 2}
GOAL_LIMIT = 0.05129329438755058  # m, where exp(-Frechet distance) = 0.95 (paper equation 7)
FIXED_LIMIT = 512  # control steps (the paper's)
STEPS_PER_UNIT = 32  # control steps for each unit under the scaled limit


@dataclass(frozen=True)
class TaskConfig:
    """A task as one run plays it: without more said, the paper's Salp Chain Locomotion Domain.

    A task with settings of its own has a subclass: frozen, and each with a default.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    length: int = 8  # number of units; the slots of a batch that mixes lengths
    observation: str = "body"  # or another of `features.OBSERVATIONS`
    action: str = "thrust"  # or pair, or grip
    time_limit: str = "fixed"  # or scaled
    fence: bool = False  # clamp to abs(x), abs(y) <= length / 4 m and end there
    contact: bool = True  # units collide
    fine_weight: float = 0.0  # of the shaping term; 0 is the paper's reward
    time_weight: float = 0.0  # what each control step costs; 0 is the paper's reward
    folded: float = 0.0  # share of episodes that start from a folded chain; 0 is the paper's
    stalled: float = 0.0  # share that starts on the target with a part folded back; likewise
    tolerance: float = GOAL_LIMIT  # m, Frechet distance at which the target pose is taken
    most_steps: int = 0  # control steps of an episode whatever its length; 0: as `time_limit` says
    name: str = "reach"  # of the task: another of `registry.TASKS`, or module:Class

    def __post_init__(self) -> None:
        set_field(self, "length", check_length(self.length))
        check_task(self.name)
        check_observation(self.observation)
        one_of("action", self.action, ACTION_SIZES)
        one_of("time limit", self.time_limit, TIME_LIMITS)
        for name in ("fence", "contact"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} must be True or False, got {told(getattr(self, name))}")
        for name in ("fine_weight", "time_weight"):
            weight = getattr(self, name)
            if not (is_number(weight) and 0 <= weight < inf):
                raise InputError(f"{name} must be a number, 0 or more, got {told(weight)}")
        for name in ("folded", "stalled"):
            share = getattr(self, name)
            if not (is_number(share) and 0 <= share <= 1):
                raise InputError(f"{name} must be a share, 0 to 1, got {told(share)}")
        if self.folded + self.stalled > 1:
            raise InputError(
                f"folded and stalled must be at most 1 together, got {self.folded} + {self.stalled}"
            )
        if not (is_number(self.tolerance) and 0 < self.tolerance <= 1):
            raise InputError(f"tolerance must lie in (0, 1] m, got {told(self.tolerance)}")
        if type(self.most_steps) is not int or self.most_steps < 0:
            raise InputError(
                f"most_steps must be a whole number, 0 or more, got {told(self.most_steps)}"
            )

    def check_possible(self, length: int) -> None:
        """Raise InputError if it can be told that no chain of this length can do it."""

    @property
    def step_limit(self) -> int:
        """Control steps until an episode of `length` units is truncated."""
        return self.most_steps or step_limit(self.time_limit, self.length)


def step_limit(time_limit: str, length: int) -> int:
    """Control steps until an episode of this length is truncated."""
    return FIXED_LIMIT if time_limit == "fixed" else max(FIXED_LIMIT, STEPS_PER_UNIT * length)
