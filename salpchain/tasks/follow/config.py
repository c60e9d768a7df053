"""Settings of the task `follow`. Imports nothing heavy."""

from dataclasses import dataclass

from salpchain.checks import is_number
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.tasks.config import TaskConfig

TOP_SPEED = 0.5  # m/s, beyond what any chain swims (chosen)


@dataclass(frozen=True)
class FollowConfig(TaskConfig):
    """A target pose that moves along a smooth path, to be followed until the time is over.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    name: str = "follow"
    speed: float = 0.05  # m/s, of the target's centroid
    turning: float = 0.5  # curvature of the path, times the chain's length: at most this

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, most in (("speed", TOP_SPEED), ("turning", 10.0)):
            value = getattr(self, name)
            if not (is_number(value) and 0 <= value <= most):
                raise InputError(f"{name} must be a number, 0 to {most:g}, got {told(value)}")
