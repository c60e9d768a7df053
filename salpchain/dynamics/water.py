"""A chain of jet-driven links in water: mass, added mass, linear and quadratic drag.

Each link is a slender body of the water's own density (buoyancy and depth are left out). Its
momentum P = M v, with the added mass of the water along and across it, changes by drag, jets and
joints; the moment v x P (Munk's) turns it across its way. Drag along and across act by themselves
(the cross-flow principle): linear, and quadratic as in Morison's equation.

A substep moves the chain with its velocities, then solves M/dt + drag for the new velocities with
all joints closed (`articulated`). Where mass vanishes, that is the law of `landsalp`.

Sources: Morison et al., The Force Exerted by Surface Waves on Piles, 1950 (form of the load); Lamb,
Hydrodynamics, 1932, section 114 (added mass of spheroids); Hoerner, Fluid-Dynamic Drag, 1965
(drag of cylinders: 1.1 across at Reynolds numbers 1e3 to 1e5, 0.82 along of length 2.7 diameters).
"""

from math import atanh, pi, sqrt
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.dynamics.articulated import Hinges, Load, Resistance, Twist, Vectors, solve
from salpchain.dynamics.landsalp import JETS, LINK, about_middle, fields_of, push_of
from salpchain.dynamics.robot import Dynamics, Part, Table, joints_of, shape_of
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.physics.batching import over_the_batch
from salpchain.physics.state import Chain, Scalar

DENSITY = 1000.0  # kg/m3, fresh water
WIDTH = 0.1  # m, of a link (chosen: a laboratory measures its own)
ACROSS, END_ON = 1.1, 0.82  # drag coefficients of a cylinder across and along (Hoerner)
SLOW = 0.1  # share of the quadratic drag at `cruise` that linear drag has besides (chosen)
NEARLY_EMPTY = 0.1  # fill below which a jet fades (chosen)


def added_mass(aspect: float) -> tuple[float, float, float]:
    """Added mass of a prolate spheroid along, across and turning, times its own mass and inertia.

    `aspect` is its length over its width (Lamb, section 114).

    Raises:
        InputError: a body that is not longer than wide.
    """
    if not aspect > 1:
        raise InputError(f"a slender body is longer than wide, got {aspect:g} times as long")
    square = 1 - 1 / aspect**2
    e = sqrt(square)
    along = 2 * (1 - square) / e**3 * (atanh(e) - e)
    across = 1 / square - (1 - square) / e**3 * atanh(e)
    gap = across - along
    turning = square**2 * gap / ((2 - square) * (2 * square - (2 - square) * gap))
    return along / (2 - along), across / (2 - across), turning


def body(length: float, width: float) -> tuple[float, float, float]:
    """Mass along and across (kg) and moment of inertia (kg m2) with what water adds, of a cylinder.

    Added mass is that of the spheroid of the same length and width.
    """
    mass = DENSITY * pi / 4 * width**2 * length
    inertia = mass * (length**2 / 12 + width**2 / 16)
    more = added_mass(length / width)
    return mass * (1 + more[0]), mass * (1 + more[1]), inertia * (1 + more[2])


def quadratic(length: float, width: float) -> tuple[float, float, float]:
    """Quadratic drag along and across (N s2/m2) and against turning (N m s2) of a cylinder."""
    half = DENSITY / 2
    across = half * ACROSS * width
    return half * END_ON * pi / 4 * width**2, across * length, across * length**4 / 32


def slow_parts(cruise: float) -> tuple[Part, ...]:
    """Two links that alternate, with linear drag a fraction of the quadratic one when cruising."""
    along, across, turning = (SLOW * cruise * c for c in quadratic(LINK, WIDTH))
    return tuple(Part(jet, at, (along, across, turning)) for jet, at in JETS)


CRUISE = 0.033  # m/s, that of the laboratory's chain in water with all thrusters


class Water(Dynamics):
    """A chain of any length in water, whose jets push one way.

    With `lag` a jet follows what is asked for; with `pulse`, the time (s) in which a whole push
    empties it, it must fill again, which takes `refill` without pushing. `inertia` multiplies mass.

    Raises:
        InputError: an invalid constant, named with its unit.
    """

    control_step: Scalar = 0.1 * (LINK / 0.07) * (0.2 / CRUISE)  # s
    substeps: int = eqx.field(default=12, static=True)
    cruise: float = eqx.field(default=CRUISE, static=True)
    parts: tuple[Part, ...] = eqx.field(default=slow_parts(CRUISE), static=True)
    joint_drag: tuple[float, ...] = eqx.field(default=(1e-4,), static=True)  # N m s (chosen)
    jet: Scalar = 0.025  # N (of the order that the measured speeds ask for)
    mass: tuple[float, float, float] = eqx.field(default=body(LINK, WIDTH), static=True)
    squares: tuple[float, float, float] = eqx.field(default=quadratic(LINK, WIDTH), static=True)
    inertia: Scalar = 1.0
    lag: Scalar = 0.2  # s
    pulse: float = eqx.field(default=0.0, static=True)  # s; 0: jets never empty
    refill: float = eqx.field(default=1.0, static=True)  # s
    one_sided: bool = eqx.field(default=True, static=True)

    def __check_init__(self) -> None:
        for name in ("mass", "squares"):
            given = getattr(self, name)
            if len(given) != 3 or min(given) < 0:
                raise InputError(f"Water.{name} must be three numbers, 0 or more, got {given}")
        if not self.pulse >= 0 or not self.refill > 0:
            raise InputError(
                f"Water.pulse must be 0 or more and refill positive (s), got {self.pulse} and"
                f" {self.refill}"
            )
        if not isinstance(self.one_sided, bool):
            raise InputError(f"one_sided must be true or false, got {told(self.one_sided)}")

    def ready(self, chain: Chain) -> Chain:
        """The chain with its jets at rest and full."""
        full = jnp.ones_like(chain.units.angle)
        jets = jnp.stack([0 * full, full], axis=-1)
        return eqx.tree_at(lambda c: c.jets, chain, jets, is_leaf=lambda leaf: leaf is None)

    def advance(self, chain: Chain, thrust: Float[Array, " unit"], current: Any = None) -> Chain:
        """The chain one control step later. Without `jets` its jets push at once, and never empty.

        The current's motion is that at the chain's units when the step begins.
        """
        flow = None if current is None else tuple(current.flow(chain.units.position))
        moved = _swum(self._fixed, self._own, chain, thrust, flow)
        return eqx.tree_at(lambda c: jax.tree.leaves((c.units, c.links, c.jets)), chain, moved)

    def top_speed(self, length: int | Array) -> Scalar:
        """Speed (m/s) of the units' centroid that no chain exceeds under its jets.

        Jets feed a chain only while its root mean square speed is below that at which linear drag
        takes all they give; joints and turning may hold energy that comes back, so the bound is
        that of all the energy that a chain can then have.
        """
        del length
        least = min(min(part.drag[:2]) for part in self.parts) * self.thickness
        turning = min(part.drag[2] for part in self.parts) * self.thickness
        speed = self.jet / least
        spun = self.mass[2] * self.jet**2 / (4 * least * turning)
        return jnp.sqrt((max(self.mass[:2]) * speed**2 + spun) / min(self.mass[:2]))

    def top_spin(self, length: int | Array) -> Scalar:
        """Rate (rad/s) that no chain that stays straight exceeds."""
        return 2 * self.top_speed(length) / self.link_length

    def energy(self, chain: Chain) -> Float[Array, ""]:
        """Kinetic energy (J) of the links and of the water that they carry along."""
        return _energy(self._fixed, self._own, chain)


class Swim(NamedTuple):
    """A chain between two substeps."""

    direction: Array  # rad
    place: Vectors  # m
    twist: Twist
    share: Array  # of a whole push
    fill: Array


def _mass(robot: Water, along: Vectors, present: Array) -> Resistance:
    zero = jnp.zeros_like(along.x)
    ahead, aside, turning = (robot.inertia * size for size in robot.mass)
    return about_middle(along, Vectors(zero, zero), ahead, aside, turning, present)


def _drag(robot: Water, table: Table, along: Vectors, twist: Twist, present: Array) -> Resistance:
    """Drag of each link about its middle at this motion against the water, in world axes."""
    ahead = jnp.abs(along.x * twist.x + along.y * twist.y)
    aside = jnp.abs(along.x * twist.y - along.y * twist.x)
    thick = robot.thickness
    sizes = (
        table.along + thick * robot.squares[0] * ahead,
        table.across + thick * robot.squares[1] * aside,
        table.turning + thick * robot.squares[2] * jnp.abs(twist.w),
    )
    zero = jnp.zeros_like(along.x)
    return about_middle(along, Vectors(zero, zero), *sizes, present)


def _times(matrix: Resistance, twist: Twist) -> Load:
    """The load of a motion, of matrices without a part between moving and turning."""
    return Load(
        matrix.xx * twist.x + matrix.xy * twist.y,
        matrix.xy * twist.x + matrix.yy * twist.y,
        matrix.ww * twist.w,
    )


def _jets(robot: Water, state: Swim, asked: Array, dt: Any, remembers: bool) -> tuple[Array, Array]:
    """Share of the whole push of each jet, and how full it is, after a substep."""
    if not remembers:
        return asked, state.fill
    wanted = asked
    if robot.pulse > 0:
        wanted = asked * jnp.clip(state.fill / NEARLY_EMPTY, 0.0, 1.0)
    gone = jnp.where(robot.lag > 0, jnp.exp(-dt / jnp.maximum(robot.lag, 1e-9)), 0.0)
    share = wanted + gone * (state.share - wanted)
    if robot.pulse == 0:
        return share, state.fill
    push = jnp.abs(share)
    change = (1 - push) / robot.refill - push / robot.pulse
    return share, jnp.clip(state.fill + dt * change, 0.0, 1.0)


@over_the_batch
def _swum(fixed: Any, own: Any, chain: Chain, thrust: Array, flow: Any) -> list[Array]:
    """Fields of units, links and jets after a control step, in the order of the chain's."""
    robot: Water = eqx.combine(fixed, own)
    table, joints, remembers = robot.table(thrust), joints_of(chain), chain.jets is not None
    low = 0.0 if robot.one_sided else -1.0
    asked = jnp.where(chain.present, jnp.clip(thrust, low, 1.0), 0.0)
    still = jnp.zeros_like(thrust)
    around = Twist(still, still, still)
    if flow is not None:
        around = Twist(flow[0][:, 0], flow[0][:, 1], flow[1] + still)

    def substep(_: Any, state: Swim) -> Swim:
        return _substep(robot, table, joints, chain.present, asked, around, state, remembers)

    moving = (jnp.where(chain.present, row, 0.0) for row in _motion_of(chain))
    share, fill = (still, still) if chain.jets is None else (chain.jets[:, 0], chain.jets[:, 1])
    place = Vectors(chain.units.position[:, 0], chain.units.position[:, 1])
    state = Swim(chain.units.angle - table.mount, place, Twist(*moving), share, fill)
    state = jax.lax.fori_loop(0, robot.substeps, substep, state)
    moved = fields_of(robot, state.direction, state.place, state.twist, joints)
    return [*moved, jnp.stack([state.share, state.fill], axis=1)] if remembers else moved


def _motion_of(chain: Chain) -> Twist:
    velocity = chain.units.velocity
    return Twist(velocity[:, 0], velocity[:, 1], chain.units.angular_velocity)


def _substep(
    robot: Water,
    table: Table,
    joints: tuple[Array, Array],
    present: Array,
    asked: Array,
    around: Twist,
    state: Swim,
    remembers: bool,
) -> Swim:
    dt, twist = robot.control_step / robot.substeps, state.twist
    against = Twist(*(a - b for a, b in zip(twist, around, strict=True)))
    momentum = _times(_mass(robot, _facing(state.direction), present), against)
    munk = against.x * momentum.y - against.y * momentum.x
    direction = state.direction + dt * twist.w
    place = Vectors(state.place.x + dt * twist.x, state.place.y + dt * twist.y)
    share, fill = _jets(robot, state, asked, dt, remembers)
    shape = shape_of(robot, table, direction, *joints)
    mass = _mass(robot, shape.along, present)
    drag = _drag(robot, table, shape.along, against, present)
    # Empty slots have 1 of each, which only keeps their equations from being 0 = 0.
    matrix = Resistance(*(m / dt + d for m, d in zip(mass, drag, strict=True)))
    push = push_of(shape, table, share * robot.jet)
    carried = _times(matrix, around)
    load = Load(
        momentum.x / dt + push.x + carried.x,
        momentum.y / dt + push.y + carried.y,
        momentum.w / dt - munk + push.w + carried.w,
    )
    load = Load(*(jnp.where(present, row, 0.0) for row in load))
    stiff = shape.hinges.drag + dt * robot.angle_stiffness  # the spring as it will be
    hinges = Hinges(shape.hinges.arm, shape.hinges.joined, stiff, shape.hinges.torque)
    return Swim(direction, place, solve(matrix, load, hinges), share, fill)


def _facing(direction: Array) -> Vectors:
    return Vectors(jnp.cos(direction), jnp.sin(direction))


@over_the_batch
def _energy(fixed: Any, own: Any, chain: Chain) -> Array:
    robot: Water = eqx.combine(fixed, own)
    table, twist = robot.table(chain.units.angle), _motion_of(chain)
    along = _facing(chain.units.angle - table.mount)
    load = _times(_mass(robot, along, chain.present), twist)
    each = load.x * twist.x + load.y * twist.y + load.w * twist.w
    return jnp.where(chain.present, each, 0.0).sum(axis=0) / 2
