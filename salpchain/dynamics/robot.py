"""What robots of jointed links with a jet each have in common: how they are built, and their chain.

A unit of the `Chain` is one of the robot's rigid links: its position is the link's middle, its
heading the direction in which its jet pushes, so its angle is the link's own direction plus a fixed
one, its `mount`. Neighbours are joined end to end by hinges; a link of the `Chain` is what pictures
draw there, the bar between the middles of two neighbours.
"""

from dataclasses import dataclass
from math import radians
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.dynamics.articulated import Hinges, Vectors, closed
from salpchain.errors import InputError
from salpchain.physics.batching import over_the_batch
from salpchain.physics.sizes import LINK_LENGTH
from salpchain.physics.state import Chain, Physics, Scalar, at_rest

PAPER_SPEED = 0.2  # m/s, about the top speed of the paper's chains
PAPER_STEP = 0.1  # s, their control step
QUARTER = np.pi / 2  # rad, from a unit's angle to its heading


@dataclass(frozen=True)
class Part:
    """How one link of a robot is built.

    Raises:
        InputError: a constant that cannot be.
    """

    jet: float  # degrees, from the link's direction (towards the next link) to the jet's push
    at: tuple[float, float] = (0.0, 0.0)  # m, of the jet from the link's middle, along and across
    drag: tuple[float, float, float] = (1.0, 1.0, 1.0)  # N s/m along, across; N m s turning
    on_wheel: bool = False  # drag acts where the jet is and along and across the jet, not the link

    def __post_init__(self) -> None:
        numbers = (self.jet, *self.at, *self.drag)
        if len(self.at) != 2 or len(self.drag) != 3 or not np.isfinite(numbers).all():
            raise InputError(f"a Part needs a jet, two places and three drags, got {self}")
        if min(self.drag) <= 0:
            raise InputError(f"Part.drag must be positive (N s/m, N m s), got {self.drag}")


class Table(eqx.Module):
    """The parts of a chain by unit, each (unit, 1): constants of a program."""

    mount: Any  # rad, the unit's angle minus its link's direction
    at: Vectors  # m, of the jet from the link's middle, along and across
    frame: Any  # rad, from the link's direction to that along which drag is `along`
    place: Vectors  # m, where drag acts
    along: Any  # N s/m
    across: Any
    turning: Any  # N m s
    joint_drag: Any  # N m s, of the joint before the unit


class Dynamics(Physics):
    """Physics of a robot's chain. `parts` come in turn along it, and so do the joints' drags.

    Of what it inherits, masses, joint and contact stiffness are the paper's and not used: joints
    never open, and units pass each other freely. `substeps` are those of a control step.
    """

    link_length: Scalar = 0.272  # m
    unit_length: Scalar = 0.16  # m, of the box that is drawn (chosen)
    unit_width: Scalar = 0.1  # m (chosen)
    angle_stiffness: Scalar = 0.0  # N m for each rad that a joint is bent
    parts: tuple[Part, ...] = eqx.field(default=(Part(90.0),), static=True)
    joint_drag: tuple[float, ...] = eqx.field(default=(0.01,), static=True)  # N m s
    jet: Scalar = 1.0  # of a whole thrust
    thickness: Scalar = 1.0  # times all drag
    cruise: float = eqx.field(default=0.05, static=True)  # m/s, of a chain that swims well

    def __check_init__(self) -> None:
        for name, kind in (("parts", Part), ("joint_drag", float)):
            given = getattr(self, name)
            if not given or not isinstance(given, tuple) or not isinstance(given[0], kind):
                raise InputError(f"{name} must be a tuple of {kind.__name__}, got {given!r}")
        if min(self.joint_drag) < 0:
            raise InputError(f"joint_drag must be 0 or more (N m s), got {self.joint_drag}")

    @property
    def scale(self) -> float:
        """How many times longer its links are than the paper's."""
        return float(self.link_length) / LINK_LENGTH

    @property
    def tempo(self) -> float:
        """How many times longer it takes for what the paper's chains do, such as a link's way."""
        return self.scale * PAPER_SPEED / self.cruise

    def advance(self, chain: Chain, thrust: Float[Array, " unit"], current: Any = None) -> Chain:
        """The chain one control step later, under thrusts in [-1, 1] held for the whole step."""
        raise NotImplementedError

    def ready(self, chain: Chain) -> Chain:
        """The chain with what these dynamics remember of it: nothing unless overridden."""
        return chain

    def settle(self, chain: Chain) -> Chain:
        """A chain whose units point along it, with their mounts, and its joints closed.

        The first unit stays; the angles between units, as they are and at rest, are kept.
        """
        return _settled(self._fixed, self._own, chain)

    def straight(self, length: int, bends: Any = None) -> Chain:
        """A chain at rest along +x whose first link is at the origin, ready to swim.

        `bends` are the angles (rad) of its joints, each unit against the one before.
        """
        zeros = jnp.zeros(length)
        turns = zeros[1:] if bends is None else jnp.asarray(bends, float)
        place = jnp.stack([self.link_length * jnp.arange(length), zeros], axis=1)
        chain, angle = at_rest(place, zeros), jnp.concatenate([zeros[:1], jnp.cumsum(turns)])
        return self.ready(self.settle(eqx.tree_at(lambda c: c.units.angle, chain, angle)))

    def directions(self, chain: Chain) -> Float[Array, " unit"]:
        """The directions of the links (rad), each towards the next."""
        return chain.units.angle - self.table(chain.units.angle[:, None]).mount[:, 0]

    def top_speed(self, length: int | Array) -> Scalar:
        """Speed (m/s) of the units' centroid that no chain exceeds."""
        raise NotImplementedError

    def top_spin(self, length: int | Array) -> Scalar:
        """Rate of turning (rad/s) that no chain which stays straight exceeds."""
        raise NotImplementedError

    @property
    def _fixed(self) -> Any:
        """What is known when a program is compiled."""
        return eqx.partition(self, lambda leaf: isinstance(leaf, float | int))[0]

    @property
    def _own(self) -> Any:
        """What each episode has of its own."""
        return eqx.partition(self, lambda leaf: isinstance(leaf, float | int))[1]

    def table(self, like: Float[Array, "unit batch"]) -> Table:
        """The parts of as many units, in the same precision."""
        parts = [self.parts[i % len(self.parts)] for i in range(like.shape[0])]
        joints = [self.joint_drag[(i - 1) % len(self.joint_drag)] for i in range(like.shape[0])]
        rows = [
            (radians(p.jet), *p.at, radians(p.jet) if p.on_wheel else 0.0, *p.drag, p.on_wheel)
            for p in parts
        ]
        jet, x, y, frame, along, across, turning, wheel = (
            jnp.asarray(column, like.dtype)[:, None] for column in np.array(rows).T
        )
        thick = self.thickness
        return Table(
            jet - QUARTER, Vectors(x, y), frame, Vectors(wheel * x, wheel * y),
            along * thick, across * thick, turning * thick,
            jnp.asarray(joints, like.dtype)[:, None] * thick,
        )  # fmt: skip


class Shape(eqx.Module):
    """Where the links of a chain point, with the batch last."""

    along: Vectors  # unit vectors
    hinges: Hinges


def shape_of(robot: Dynamics, table: Table, direction: Array, rest: Array, joined: Array) -> Shape:
    """The links' directions (rad) as vectors, and the joints between them.

    `rest` is how much each unit's angle exceeds that of the unit before at rest, `joined` whether
    it hangs on it; of the first unit neither counts.
    """
    along = Vectors(jnp.cos(direction), jnp.sin(direction))
    half = robot.link_length / 2
    angle = direction + table.mount
    bend = angle - jnp.concatenate([angle[:1], angle[:-1]]) - rest
    torque = -robot.angle_stiffness * bend
    drag = jnp.broadcast_to(table.joint_drag, direction.shape)
    return Shape(along, Hinges(Vectors(half * along.x, half * along.y), joined, drag, torque))


def turned(along: Vectors, x: Any, y: Any) -> Vectors:
    """Vectors of each link's own axes, in world axes."""
    return Vectors(along.x * x - along.y * y, along.y * x + along.x * y)


def facing(along: Vectors, angle: Array) -> Vectors:
    """Unit vectors at a fixed angle (rad) from the links."""
    return turned(along, jnp.cos(angle), jnp.sin(angle))


def before(row: Array) -> Array:
    """What each joint has, told by the unit after it; the first has the same as the second."""
    return jnp.concatenate([row[:1], row]) if len(row) else row


def joints_of(chain: Chain) -> tuple[Array, Array]:
    """How much each unit's angle exceeds that before it at rest, and whether it hangs on it."""
    rest = chain.rest_angle[:, 0] - chain.rest_angle[:, 1]
    none = jnp.zeros_like(chain.units.angle[:1])
    joined = jnp.concatenate([none.astype(bool), chain.joined])
    return jnp.concatenate([none, rest]), joined


def bars(place: Vectors, direction: Array) -> tuple[Array, Array]:
    """Position (link, 2, batch) and angle of the bars between the middles of neighbours."""
    middle = [(row[1:] + row[:-1]) / 2 for row in place]
    return jnp.stack(middle, axis=1), (direction[1:] + direction[:-1]) / 2


def laid(
    robot: Dynamics, direction: Array, place: Vectors, joints: tuple[Array, Array]
) -> tuple[Vectors, Shape, Table]:
    """Places (m) with all joints closed, the shape and the parts."""
    table = robot.table(direction)
    shape = shape_of(robot, table, direction, *joints)
    return closed(place, shape.hinges), shape, table


@over_the_batch
def _laid_out(fixed: Any, own: Any, chain: Chain) -> tuple[Array, ...]:
    """Positions and angles of units and links of a chain whose units point along it."""
    robot: Dynamics = eqx.combine(fixed, own)
    direction = chain.units.angle
    place = Vectors(chain.units.position[:, 0], chain.units.position[:, 1])
    place, _, table = laid(robot, direction, place, joints_of(chain))
    middle, angle = bars(place, direction)
    mount = jnp.broadcast_to(table.mount, direction.shape)
    return jnp.stack(place, axis=1), direction + mount, middle, angle, mount


def _settled(fixed: Any, own: Any, chain: Chain) -> Chain:
    position, angle, middle, along, mount = _laid_out(fixed, own, chain)
    rest = chain.rest_angle - jnp.stack([mount[:-1], mount[1:]], axis=-1)
    return eqx.tree_at(
        lambda c: (
            c.units.position, c.units.angle, c.links.position, c.links.angle, c.rest_angle
        ),
        chain,
        (position, angle, middle, along, rest),
    )  # fmt: skip


def scale_of(physics: Physics) -> float:
    """How many times longer links are than the paper's, for what is told in lengths of a link.

    1 of the paper's own dynamics, whatever their constants are.
    """
    return physics.scale if isinstance(physics, Dynamics) else 1.0


def tempo_of(physics: Physics) -> float:
    """How many times longer the chain takes for what the paper's do; 1 of the paper's dynamics."""
    return physics.tempo if isinstance(physics, Dynamics) else 1.0


def mounts_of(physics: Physics, length: int) -> Float[np.ndarray, " unit"]:
    """The angle (rad) of each unit minus that of its rigid link; none of the paper's units."""
    if not isinstance(physics, Dynamics):
        return np.zeros(0)
    parts = physics.parts
    return np.array([radians(parts[i % len(parts)].jet) - QUARTER for i in range(length)])


def settled(physics: Physics, chain: Chain) -> Chain:
    """The chain as these dynamics have it; as it is, of the paper's."""
    return physics.settle(chain) if isinstance(physics, Dynamics) else chain
