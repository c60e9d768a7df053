"""Settings of a world: what it holds, each number fixed or drawn anew for every episode.

Imports nothing heavy: the command line's help reads these classes.
"""

from dataclasses import Field, dataclass, field, fields, replace
from math import isfinite
from typing import Any

from salpchain.checks import is_number, one_of
from salpchain.errors import InputError
from salpchain.given import instance, told
from salpchain.ranges import Range, as_range

NONE, ONE, FIVE, TEN = (Range(x, x) for x in (0.0, 1.0, 5.0, 10.0))
CORE = Range(0.2, 0.5)
RADII, PIECES, ANGLES = Range(0.03, 0.08), Range(0.3, 0.6), Range(0.0, 1.5)
ALONG, ASIDE = Range(0.1, 0.9), Range(0.0, 0.6)


def _check(
    config: Any, name: str, low: float = 0.0, high: float = float("inf"), steps: bool = False
) -> None:
    """Make a field a range, and raise InputError unless it lies between these bounds.

    Of `steps`, both ends must be whole numbers.
    """
    try:
        given = as_range(getattr(config, name))
    except InputError as error:
        raise InputError(f"{config.ROOM}.{name} {error}") from None
    if not low <= given.low <= given.high <= high:
        bounds = f"lie in {low:g} to {high:g}" if isfinite(high) else f"be {low:g} or more"
        raise InputError(f"{config.ROOM}.{name} must {bounds}, got {given}")
    if steps and not all(float(end).is_integer() for end in given):
        raise InputError(f"{config.ROOM}.{name} must be whole control steps, got {given}")
    object.__setattr__(config, name, given)


@dataclass(frozen=True)
class DynamicsConfig:
    """Constants of the physics, as multiples of the paper's."""

    ROOM = "world.dynamics"

    mass: Range = ONE  # of units and links
    drag: Range = ONE
    stiffness: Range = ONE  # of the joints, against stretching and bending
    substeps: int = 1  # a whole multiple; the same in every episode
    kind: str = "vmas"  # or another of `KINDS`
    across: float = 3.0  # drag across a link over drag along it, of landsalp
    spring: float = 0.0  # N m for each rad that a joint is bent, of landsalp and water

    def __post_init__(self) -> None:
        one_of("world.dynamics.kind", self.kind, KINDS)
        for name, low, high in (("across", 0.1, 100.0), ("spring", 0.0, 10.0)):
            value = getattr(self, name)
            if not (is_number(value) and low <= value <= high):
                raise InputError(
                    f"world.dynamics.{name} must be a number, {low:g} to {high:g}, got"
                    f" {told(value)}"
                )
        for name in ("mass", "stiffness"):
            _check(self, name, 0.05, 20.0)
        _check(self, "drag", 0.0, 3.9)
        least, most = 1, MOST_SUBSTEPS
        if type(self.substeps) is not int or not least <= self.substeps <= most:
            raise InputError(
                f"world.dynamics.substeps must be a whole number, {least} to {most}, got"
                f" {told(self.substeps)}"
            )


KINDS = ("vmas", "landsalp", "water")  # the paper's world, a robot on wheels, one in water
MOST_SUBSTEPS = 20  # times those of the paper (chosen)


@dataclass(frozen=True)
class CurrentConfig:
    """The water's motion; directions and the places of vortices are drawn for each episode."""

    ROOM = "world.current"

    speed: Range = NONE  # m/s, uniform, in a random direction
    shear: Range = NONE  # 1/s, growth of the speed across its random direction
    vortex: Range = NONE  # m/s, at the core of one vortex on the way to the target
    vortex_radius: Range = CORE  # m, of its core
    wander: Range = NONE  # m/s, standard deviation of what changes in time
    relaxation: Range = TEN  # s, in which a change is forgotten

    def __post_init__(self) -> None:
        for name in ("speed", "vortex", "wander"):
            _check(self, name, 0.0, 1.0)
        _check(self, "shear", 0.0, 1.0)
        _check(self, "vortex_radius", 0.01, 100.0)
        _check(self, "relaxation", 0.1, 1e6)


@dataclass(frozen=True)
class ThrusterConfig:
    """The thrusters of the units."""

    ROOM = "world.thrusters"

    dead: Range = NONE  # fraction of the units that are dead, rounded to whole units
    failing: Range = NONE  # fraction that fails at a random time of the episode
    gain: Range = ONE  # of each unit by itself
    lag: Range = NONE  # s, time constant of a first-order response
    one_sided: bool = False  # jets that push along the unit's heading only
    one_sided_share: float = 1.0  # of the episodes that have them; `spared` leaves those under 1

    def __post_init__(self) -> None:
        _check(self, "dead", 0.0, 1.0)
        _check(self, "failing", 0.0, 1.0)
        _check(self, "gain", 0.0, 2.0)
        _check(self, "lag", 0.0, 10.0)
        if not isinstance(self.one_sided, bool):
            raise InputError(
                f"world.thrusters.one_sided must be true or false, got {told(self.one_sided)}"
            )
        if self.one_sided_share != 1 and not self.one_sided:
            raise InputError(
                "world.thrusters.one_sided_share is of episodes with jets that push one way: give"
                f" world.thrusters.one_sided=true, got {told(self.one_sided_share)} without"
            )
        if not (is_number(self.one_sided_share) and 0 <= self.one_sided_share <= 1):
            raise InputError(
                "world.thrusters.one_sided_share must be a share of the episodes, 0 to 1, got"
                f" {told(self.one_sided_share)}"
            )


@dataclass(frozen=True)
class SensingConfig:
    """What the chain is told of itself, and how late it and its actions come."""

    ROOM = "world.sensing"

    position: Range = NONE  # m, standard deviation of the noise; velocities likewise in m/s
    angle: Range = NONE  # rad, standard deviation; turning likewise in rad/s
    position_bias: Range = NONE  # m, standard deviation of an offset that lasts the episode
    angle_bias: Range = NONE  # rad
    dropped: Range = NONE  # probability in each step that a unit begins to tell nothing
    dropped_steps: Range = FIVE  # control steps for which it does
    stuck: Range = NONE  # probability in each step that a unit's reading begins to repeat
    stuck_steps: Range = FIVE  # control steps for which it does
    delay: Range = NONE  # control steps by which readings are late
    action_delay: Range = NONE  # control steps by which actions are late
    repeat: Range = ONE  # control steps for which an action is held

    def __post_init__(self) -> None:
        for name in ("position", "angle", "position_bias", "angle_bias"):
            _check(self, name, 0.0, 10.0)
        for name in ("dropped", "stuck"):
            _check(self, name, 0.0, 1.0)
        for name in ("dropped_steps", "stuck_steps"):
            _check(self, name, 1.0, 1e6, steps=True)
        for name in ("delay", "action_delay"):
            _check(self, name, 0.0, MOST_DELAY, steps=True)
        _check(self, "repeat", 1.0, MOST_DELAY, steps=True)


MOST_DELAY = 20.0  # control steps (chosen)


@dataclass(frozen=True)
class ObstacleConfig:
    """Walls and posts; none is put where it would cover the chain's start or its target."""

    ROOM = "world.obstacles"

    posts: Range = NONE  # how many
    post_radius: Range = RADII  # m, of each by itself
    walls: Range = NONE  # how many straight pieces
    wall_length: Range = PIECES  # chain lengths, of each by itself
    wall_angle: Range = ANGLES  # rad, between a piece and the way to the target, to either side
    along: Range = ALONG  # where their centres are: fraction of the way to the target
    aside: Range = ASIDE  # chain lengths from the way, to either side
    room: Range = NONE  # chain lengths of free water round start and target, in four walls; 0: none

    def __post_init__(self) -> None:
        for name in ("posts", "walls"):
            _check(self, name, 0.0, MOST_OBSTACLES)
        _check(self, "post_radius", 0.01, 1.0)
        _check(self, "wall_length", 0.05, 5.0)
        _check(self, "wall_angle", 0.0, 1.6)
        _check(self, "along", -1.0, 2.0)
        for name in ("aside", "room"):
            _check(self, name, 0.0, 10.0)


MOST_OBSTACLES = 32.0  # of a kind (chosen)


@dataclass(frozen=True)
class WorldConfig:
    """A distribution over worlds, one of which is drawn for each episode.

    Raises:
        InputError: a part of another kind, a number that is no range, or out of bounds.
    """

    name: str = "still"  # of the preset that it comes from
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    current: CurrentConfig = field(default_factory=CurrentConfig)
    thrusters: ThrusterConfig = field(default_factory=ThrusterConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    obstacles: ObstacleConfig = field(default_factory=ObstacleConfig)
    spared: Range = NONE  # share of these that an episode is spared, each by itself, but obstacles

    ROOM = "world"

    def __post_init__(self) -> None:
        instance("world.name", self.name, str, "a text")
        _check(self, "spared", 0.0, 1.0)
        for part in self._parts:
            kind: Any = part.default_factory
            instance(kind.ROOM, getattr(self, part.name), kind, f"a {kind.__name__}")
        self._check_dynamics()

    def _check_dynamics(self) -> None:
        """Raise InputError unless these dynamics know all that the world holds."""
        kind = self.dynamics.kind
        wrong = {
            "obstacles": kind != "vmas" and self.obstacles != ObstacleConfig(),
            "current": kind == "landsalp" and self.current != CurrentConfig(),
            "dynamics.mass": kind == "landsalp" and self.dynamics.mass != ONE,
            "dynamics.drag below 0.05": kind != "vmas" and self.dynamics.drag.low < 0.05,
        }
        for name, is_wrong in wrong.items():
            if is_wrong:
                raise InputError(
                    f"world.dynamics.kind={kind} knows no world.{name}: leave that out"
                )

    @property
    def is_still(self) -> bool:
        """Whether this is the paper's world: still water and nothing that fails."""
        return replace(self, name="still", spared=NONE) == WorldConfig()

    @property
    def _parts(self) -> "list[Field[Any]]":
        return [one for one in fields(self) if one.name not in ("name", "spared")]

    def changes(self, base: "WorldConfig") -> dict[str, Any]:
        """What is otherwise than in another world, by path."""
        found: dict[str, Any] = {}
        if self.spared != base.spared:
            found["spared"] = self.spared
        for part in self._parts:
            here, there = getattr(self, part.name), getattr(base, part.name)
            for one in fields(here):
                value = getattr(here, one.name)
                if value != getattr(there, one.name):
                    found[f"{part.name}.{one.name}"] = value
        return found
