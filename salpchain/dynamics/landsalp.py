"""A drag-dominated chain of jet-driven links: LandSalp, the robot on wheels, and longer ones.

Nothing has inertia: the pushes of the jets are met by drag at every moment. With q the pose of the
body and the angles of the joints, J the motion of the links' frames and joints for each q', D their
drag and J_w, D_w the rows of the jets,

    q' = (J^T D J)^-1 J_w^T D_w u    where jets set velocities u (wheels that are driven),
    q' = (J^T D J)^-1 J_w^T f        where jets push with forces f.

Here the same is solved for the motion of every link, joint by joint (`articulated`), in a number of
operations linear in the length.

Sources: Yang et al., Geometric Data-Driven Multi-Jet Locomotion Inspired by Salps, arXiv 2503.08817
(the model, the robot and its identified drag); the laboratory's public simulator
yanhaoy/Salp-Simulation-Matlab (lengths, jets, wheels: main.m; 10 N s/m along a link of jets that
push).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy import cos, radians, sin, sqrt

from salpchain.dynamics.articulated import Load, Resistance, Twist, Vectors, solve
from salpchain.dynamics.robot import (
    Dynamics,
    Part,
    Shape,
    Table,
    bars,
    facing,
    joints_of,
    laid,
    shape_of,
    turned,
)
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.physics.batching import over_the_batch
from salpchain.physics.state import Chain, Scalar

LINK = 0.272  # m (main.m)
ALONG = 10.0  # N s/m along a link, of jets that push (main.m)
CRUISE = 0.05  # m/s, the upper end of what such robots make (3 to 5 cm/s)
SPRING = 0.15  # N m, a joint's stiffness where it has one
JETS = ((-57.0, (0.0140, 0.0091)), (-130.0, (0.0128, -0.0107)))  # degrees; m (main.m)
MEASURED = ((55.94, 42.73, 0.6726), (73.66, 86.93, 0.7322), (57.76, 23.30, 0.2602))  # 2503.08817
JOINTS = (0.0115, 0.0137)  # N m s (2503.08817)
PEAK = 0.123  # m/s, the largest that a jet of the published gait sets


def chain_parts(across: float = 3.0, along: float = ALONG) -> tuple[Part, ...]:
    """Two links that alternate, whose drags are as L : across L : across L^3 / 12.

    3 is that of slender bodies in slow flow, 10 that of the laboratory's simulator.
    """
    drag = along, across * along, across * along * LINK**2 / 12
    return tuple(Part(jet, at, drag) for jet, at in JETS)


def whole_jet(across: float = 3.0, along: float = ALONG) -> float:
    """The push (N) of all jets with which a straight chain moves sideways with `CRUISE`."""
    sideways = sum(-sin(radians(jet)) for jet, _ in JETS) / len(JETS)
    return float(CRUISE * across * along / sideways)


class LandSalp(Dynamics):
    """A chain of any length whose jets push: two kinds of links alternate, as in the robot.

    A whole thrust is `jet` newton, with which a straight chain moves sideways with `cruise`, as the
    paper's chains do with theirs. `sets_speed` makes it a speed (m/s) that a wheel is driven with.

    Raises:
        InputError: an invalid constant, named with its unit.
    """

    control_step: Scalar = (
        0.1 * (LINK / 0.07) * (0.2 / CRUISE)
    )  # s, in which it makes as many links
    substeps: int = eqx.field(default=4, static=True)
    parts: tuple[Part, ...] = eqx.field(default=chain_parts(), static=True)
    joint_drag: tuple[float, ...] = eqx.field(default=(sum(JOINTS) / 2,), static=True)
    jet: Scalar = whole_jet()  # N
    sets_speed: bool = eqx.field(default=False, static=True)

    def __check_init__(self) -> None:
        if not isinstance(self.sets_speed, bool):
            raise InputError(f"sets_speed must be true or false, got {told(self.sets_speed)}")

    @classmethod
    def robot(cls, **others: Any) -> "LandSalp":
        """The three links that exist, with the drag that was identified."""
        kinds = zip((JETS[0], JETS[1], JETS[0]), MEASURED, strict=True)
        parts = tuple(Part(jet, at, drag, on_wheel=True) for (jet, at), drag in kinds)
        given = {"parts": parts, "joint_drag": JOINTS, "jet": PEAK, "sets_speed": True} | others
        return cls(**given)

    def advance(self, chain: Chain, thrust: Float[Array, " unit"], current: Any = None) -> Chain:
        """The chain one control step later; it moves over ground, so no current carries it.

        Velocities are those of the last substep.

        Raises:
            InputError: a current.
        """
        if current is not None:
            raise InputError("a LandSalp moves on the ground: leave the current out, or use water")
        moved = _drifted(self._fixed, self._own, chain, thrust)
        return eqx.tree_at(lambda c: jax.tree.leaves((c.units, c.links)), chain, moved)

    def top_speed(self, length: int | Array) -> Scalar:
        """Speed (m/s) of the units' centroid that no chain exceeds.

        The power that drag takes, V.A V over all links, is at most that of the links if each were
        free, for joints only constrain them: the root mean square speed is at most that.
        """
        del length
        speed = max(sqrt(self._free(part) / min(part.drag[:2])) for part in self.parts)
        return self.jet * speed / (1.0 if self.sets_speed else self.thickness)

    def top_spin(self, length: int | Array) -> Scalar:
        """Rate of turning (rad/s) that no straight chain exceeds, by the same balance of power."""
        free = max(self._free(part) for part in self.parts)
        least = min(min(part.drag[:2]) for part in self.parts)
        squares = self.link_length**2 * (length**2 - 1) / 12
        spin = self.jet * jnp.sqrt(free / (least * jnp.maximum(squares, 1e-9)))
        return spin / (1.0 if self.sets_speed else self.thickness)

    def _free(self, part: Part) -> float:
        """The power (W) that a whole thrust of 1 spends on a link by itself, turning included."""
        along, across, turning = part.drag
        if part.on_wheel or self.sets_speed:
            return along if self.sets_speed else 1 / along
        jet = radians(part.jet)
        arm = part.at[0] * sin(jet) - part.at[1] * cos(jet)
        return float(cos(jet) ** 2 / along + sin(jet) ** 2 / across + arm**2 / turning)


def drag_of(shape: Shape, table: Table, present: Array) -> Resistance:
    """The drag of every link about its middle in world axes; 1 of slots that are empty."""
    axis, arm = facing(shape.along, table.frame), turned(shape.along, *table.place)
    return about_middle(axis, arm, table.along, table.across, table.turning, present)


def about_middle(
    axis: Vectors, arm: Vectors, along: Any, across: Any, turning: Any, present: Array
) -> Resistance:
    """A resistance along and across an axis, that acts `arm` (m) from each link's middle, about
    the middle in world axes; 1 of slots that are empty."""
    more = along - across
    zero = jnp.zeros_like(axis.x)
    local = Resistance(
        across + more * axis.x**2, more * axis.x * axis.y, across + more * axis.y**2,
        zero, zero, turning + zero,
    )  # fmt: skip
    rows = local.about(arm, -1.0)
    one = Resistance(1.0, 0.0, 1.0, 0.0, 0.0, 1.0)
    return Resistance(*(jnp.where(present, row, own) for row, own in zip(rows, one, strict=True)))


def push_of(shape: Shape, table: Table, force: Array) -> Load:
    """The load about each link's middle of a jet's force (N)."""
    axis = facing(shape.along, table.mount + jnp.pi / 2)
    return Load(force * axis.x, force * axis.y, jnp.zeros_like(force)).about(
        turned(shape.along, *table.at), -1.0
    )


@over_the_batch
def _drifted(fixed: Any, own: Any, chain: Chain, thrust: Array) -> list[Array]:
    """Fields of units and links after a control step, in the order of the chain's."""
    robot: LandSalp = eqx.combine(fixed, own)
    table, joints = robot.table(thrust), joints_of(chain)
    push = jnp.where(chain.present, jnp.clip(thrust, -1.0, 1.0), 0.0) * robot.jet
    push = push * table.along if robot.sets_speed else push
    dt = robot.control_step / robot.substeps

    def motion(direction: Array) -> Twist:
        shape = shape_of(robot, table, direction, *joints)
        load = push_of(shape, table, push)
        return solve(drag_of(shape, table, chain.present), load, shape.hinges)

    def substep(_: Any, state: tuple[Array, Vectors, Twist]) -> tuple[Array, Vectors, Twist]:
        direction, place, _ = state
        begun = motion(direction)
        twist = motion(direction + dt / 2 * begun.w)
        place = Vectors(place.x + dt * twist.x, place.y + dt * twist.y)
        return direction + dt * twist.w, place, twist

    place = Vectors(chain.units.position[:, 0], chain.units.position[:, 1])
    direction = chain.units.angle - table.mount
    still = Twist(*[jnp.zeros_like(thrust)] * 3)
    state = jax.lax.fori_loop(0, robot.substeps, substep, (direction, place, still))
    direction, place, twist = state
    return fields_of(robot, direction, place, twist, joints)


def fields_of(
    robot: Dynamics, direction: Array, place: Vectors, twist: Twist, joints: tuple[Array, Array]
) -> list[Array]:
    """Fields of units and links of a chain with these directions, places and motions."""
    place, _, table = laid(robot, direction, place, joints)
    middle, angle = bars(place, direction)
    velocity = jnp.stack([twist.x, twist.y], axis=1)
    between = [(row[1:] + row[:-1]) / 2 for row in (velocity, twist.w)]
    units = [jnp.stack(place, axis=1), direction + table.mount, velocity, twist.w]
    return [*units, middle, angle, *between]
