"""Settings of the tasks `dock`, `passage` and `gather`. Imports nothing heavy."""

from dataclasses import dataclass

from salpchain.checks import is_number, one_of
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.physics.sizes import LINK_LENGTH, UNIT_WIDTH
from salpchain.tasks.config import TaskConfig, step_limit
from salpchain.tasks.parting.walls import Zone, check_free, each_wall

PATIENCE = 4  # times the time limit of `reach`, for ways that are gone one after another (chosen)
AUTHORS = 1.2  # chain lengths, the opening in the passage of the paper's authors
THICK = 0.04  # m, of a wall (chosen; as world.placement's)
TUNNEL = 0.5  # m, its length (the issue's)
CLEAR = 0.35  # m, from start and target to the wall beyond a chain's length (chosen)
FARTHEST = 1.3  # chain lengths, from the wall to the middle of start and target, beyond that
TURN = 0.2  # m, between the walls of a winding way, beyond an opening; half as much aside (chosen)
WAYS = {
    "wall": "one opening in a thin wall",
    "two": "two openings in a thin wall",
    "tunnel": "an opening through a wall 0.5 m thick",
    "winding": "two walls, whose openings are not in line",
    "blocks": "the authors' passage: six blocks 1.2 chain lengths wide and one deep, one left out",
}


@dataclass(frozen=True)
class PartingConfig(TaskConfig):
    """What the tasks have in common in which links are cut and closed.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    capture: float = 0.04  # m, from which a joint closes (physics.state.Latch)
    hold: float = 0.0  # s for which the chain must be one and in the target pose

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, low, high in (("capture", 0.001, 0.2), ("hold", 0.0, 60.0)):
            value = getattr(self, name)
            if not (is_number(value) and low <= value <= high):
                raise InputError(f"{name} must be a number, {low:g} to {high:g}, got {told(value)}")

    @property
    def step_limit(self) -> int:
        """Control steps until an episode of `length` units is truncated."""
        return self.most_steps or PATIENCE * step_limit(self.time_limit, self.length)


@dataclass(frozen=True)
class DockConfig(PartingConfig):
    """Two chains, each of half the units, must become one and hold a pose.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    name: str = "dock"
    hold: float = 5.0
    apart: float = 1.0  # m, between the circles round the two chains

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.apart) and 0.1 <= self.apart <= 10):
            raise InputError(f"apart must be a number, 0.1 to 10 m, got {told(self.apart)}")


@dataclass(frozen=True)
class PassageConfig(PartingConfig):
    """A wall across the way, with an opening; the target pose is behind it.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    name: str = "passage"
    opening: float = 0.25  # chain lengths
    way: str = "wall"  # another of `WAYS`; blocks has the authors' opening whatever is asked
    walls: tuple[float, ...] = ()  # m, x, y, x, y of the ends of each further wall

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("way", self.way, WAYS)
        if not (is_number(self.opening) and 0 < self.opening <= 5):
            raise InputError(f"opening must be a number, above 0 to 5, got {told(self.opening)}")
        each_wall(self.walls)

    @property
    def free(self) -> float:
        """Width of the opening in chain lengths."""
        return AUTHORS if self.way == "blocks" else self.opening

    def check_possible(self, length: int) -> None:
        """Raise InputError unless one unit fits the opening for chains of this length, and no wall
        of `walls` stands where they start or arrive."""
        width = self.free * length * LINK_LENGTH
        if width < UNIT_WIDTH:
            least = UNIT_WIDTH / (length * LINK_LENGTH)
            raise InputError(
                f"opening {self.free:g} of {length} units is {100 * width:.1f} cm: no unit fits, at"
                f" {100 * UNIT_WIDTH:g} cm; it must be {least:.3f} or more"
            )
        for zone, what in zip(self._zones(length), ("start", "arrive"), strict=True):
            reach = (THICK + LINK_LENGTH) / 2
            check_free(self.walls, zone, reach, f"chains of {length} units {what}")

    def _zones(self, length: int) -> tuple[Zone, Zone]:
        """Where units of chains of this length may be at first, and in the target pose."""
        extent = length * LINK_LENGTH
        depth, aside = {"tunnel": TUNNEL, "blocks": extent}.get(self.way, THICK), 0.0
        if self.way == "winding":
            width = self.opening * extent
            depth, aside = width + TURN + 2 * THICK, width + TURN / 2
        near = depth / 2 + CLEAR + extent / 2
        far = depth / 2 + CLEAR + extent * (FARTHEST + 0.5)
        start = Zone((-far, -extent), (-near, extent))
        return start, Zone((near, aside - extent), (far, aside + extent))


@dataclass(frozen=True)
class GatherConfig(PartingConfig):
    """Units scattered in pairs, or singly, must become one chain in a pose.

    Raises:
        InputError: an invalid setting; the message states the valid values.
    """

    name: str = "gather"
    group: int = 2  # units that are together at first: 2, or 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if type(self.group) is not int or self.group not in (1, 2):
            raise InputError(f"group must be 1 or 2 units, got {told(self.group)}")
