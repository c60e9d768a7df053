"""The state of a chain of units and links, and the constants of its physics."""

from dataclasses import dataclass, fields
from math import inf
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int
from numpy import pi

from salpchain.errors import InputError
from salpchain.given import index, is_scalar, told
from salpchain.physics.joints import FORCES
from salpchain.physics.sizes import LINK_LENGTH, UNIT_LENGTH, UNIT_WIDTH

Scalar = float | Float[Array, ""]  # traced or not


class Bodies(eqx.Module):
    """Rigid bodies in the plane."""

    position: Float[Array, "body 2"]  # m, world
    angle: Float[Array, " body"]  # rad, anticlockwise from +x, not wrapped
    velocity: Float[Array, "body 2"]  # m/s, world
    angular_velocity: Float[Array, " body"]  # rad/s

    @property
    def heading(self) -> Float[Array, "body 2"]:
        """Unit vectors along which units push, 90 degrees anticlockwise from their axes."""
        return heading(self.angle)


@dataclass(frozen=True)
class Latch:
    """What a joint that closes again allows, and how gently it closes.

    The numbers are chosen: about half a link, and 30 degrees.

    Raises:
        InputError: a number that is not positive, or an angle beyond pi.
    """

    distance: float = 0.04  # m, between a link's free end and the unit, at most
    angle: float = 0.52  # rad, that link and unit are off the angle at rest, at most
    speed: float = 0.1  # m/s, of the free end against the unit, at most
    closing: float = 0.025  # m/s, at which the joint's slack is taken up
    turning: float = 0.4  # rad/s, at which its twist is

    def __post_init__(self) -> None:
        for one, unit in (("distance", "m"), ("angle", "rad"), ("speed", "m/s"),
                          ("closing", "m/s"), ("turning", "rad/s")):  # fmt: skip
            value = getattr(self, one)
            if not (isinstance(value, int | float) and 0 < value < inf):
                raise InputError(f"Latch.{one} must be positive ({unit}), got {told(value)}")
        if self.angle > pi:
            raise InputError(f"Latch.angle must be at most pi (rad), got {self.angle}")


class Docking(eqx.Module):
    """What a chain has whose links can be cut and closed again while it swims.

    A link that is cut keeps its first joint: it hangs on the unit of the lower index. Its second
    joint closes on the unit of the higher index with a slack, so that nothing snaps.
    """

    slack: Float[Array, " link"]  # m, opening at which the second joint is at rest
    twist: Float[Array, " link"]  # rad, added to its rest angle
    # m, rad, m/s: how far off it was when it last closed; None is not recorded and not paid.
    caught: Float[Array, "link 3"] | None = None
    catches: Int[Array, " link"] | None = None  # how often it has closed; None likewise
    latch: Latch = eqx.field(static=True, default_factory=Latch)


class Chain(eqx.Module):
    """n units, the n-1 links between them, and the masks that say which of them exist.

    A link acts where `linked` is true and both its units are `present`. A masked slot exerts
    nothing, feels nothing and stays where it is, so chains of many lengths, and chains that
    split, are one compiled program.
    """

    units: Bodies
    links: Bodies
    rest_angle: Float[Array, "link 2"]  # rad, link angle minus the angle of its two units at rest
    present: Bool[Array, " unit"]
    linked: Bool[Array, " link"]
    touching: Bool[Array, ""]  # whether some two units pushed each other in the last control step
    # Whether an obstacle pushed a unit in the last control step; None is not recorded and not paid.
    blocked: Bool[Array, ""] | None = None
    # Of jets that remember: share of the whole push now, and how full each is. None: they do not.
    jets: Float[Array, "unit 2"] | None = None
    # N s, of obstacles on units in the last control step, as the sum over units; None likewise.
    impulse: Float[Array, ""] | None = None
    docking: Docking | None = None  # of links that can be cut and closed; None of fixed ones

    @property
    def joined(self) -> Bool[Array, "link *batch"]:
        """Links that act: linked, with both units present."""
        return self.linked & self.present[:-1] & self.present[1:]

    @property
    def held(self) -> Bool[Array, "link *batch"]:
        """Links that hang on their first unit: those that act, and of a chain that docks all."""
        return self.joined if self.docking is None else self.present[:-1] & self.present[1:]


class Physics(eqx.Module):
    """Constants of the dynamics; the defaults are the paper's world in VMAS 1.5.2.

    Every field but the two last may be a traced scalar, so that constants can be randomised.

    Raises:
        InputError: an invalid constant, named with its unit.
    """

    unit_length: Scalar = UNIT_LENGTH  # m, along the chain
    unit_width: Scalar = UNIT_WIDTH  # m, across the chain
    unit_mass: Scalar = 1.0  # kg
    link_length: Scalar = LINK_LENGTH  # m, between the centres of two units
    link_mass: Scalar = 1.0  # kg
    joint_stiffness: Scalar = 900.0  # N/m
    angle_stiffness: Scalar = 0.1  # N m
    contact_stiffness: Scalar = 1500.0  # N/m
    contact_gap: Scalar = 4 / 600  # m, boxes closer than this repel (VMAS LINE_MIN_DIST)
    softness: Scalar = 1e-3  # m, width of the soft onset of joint and contact (VMAS contact_margin)
    drag: Scalar = 0.25  # share of every velocity lost at the start of a control step
    control_step: Scalar = 0.1  # s
    substeps: int = eqx.field(default=15, static=True)
    joint_derivative: str = eqx.field(default="spring", static=True)  # or exact: see docs/gradients

    def __check_init__(self) -> None:
        if index(self.substeps) is None:
            given = told(self.substeps)
            raise InputError(f"Physics.substeps must be a whole number, got {given}")
        for name, unit in _POSITIVE.items():
            value = getattr(self, name)
            if isinstance(value, int | float) and not value > 0:
                raise InputError(f"Physics.{name} must be positive ({unit}), got {value}")
        if isinstance(self.drag, int | float) and not 0 <= self.drag < 1:
            raise InputError(f"Physics.drag must lie in [0, 1), got {self.drag}")
        if not isinstance(self.joint_derivative, str) or self.joint_derivative not in FORCES:
            raise InputError(
                f"Physics.joint_derivative must be {' or '.join(FORCES)},"
                f" got {told(self.joint_derivative)}"
            )
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type == Scalar and not is_scalar(value):
                raise InputError(f"Physics.{field.name} must be a number, got {told(value)}")

    @property
    def unit_inertia(self) -> Any:
        """Moment of inertia of a box (kg m2); of many, where the constants are."""
        size = self.unit_length**2 + self.unit_width**2
        return self.unit_mass * size / 12

    @property
    def link_inertia(self) -> Any:
        """Moment of inertia of a rod (kg m2); of many, where the constants are."""
        return self.link_mass * self.link_length**2 / 12


_POSITIVE = {
    "unit_length": "m",
    "unit_width": "m",
    "unit_mass": "kg",
    "link_length": "m",
    "link_mass": "kg",
    "joint_stiffness": "N/m",
    "contact_stiffness": "N/m",
    "softness": "m",
    "control_step": "s",
    "substeps": "count",
}


def at_rest(
    position: Float[Array, "unit 2"],
    angle: Float[Array, " unit"],
    present: Bool[Array, " unit"] | None = None,
    linked: Bool[Array, " link"] | None = None,
) -> Chain:
    """A motionless chain through these unit poses, every link between its two units' centres.

    The angles that links and units have now become the rest angles. Joints are closed where
    neighbours are one link length apart.
    """
    ahead = position[1:] - position[:-1]
    link_angle = jnp.arctan2(ahead[:, 1], ahead[:, 0])
    sides = jnp.stack([link_angle - angle[:-1], link_angle - angle[1:]], axis=-1)
    ones = jnp.ones_like(angle, dtype=bool)
    return Chain(
        units=_still(position, angle),
        links=_still((position[1:] + position[:-1]) / 2, link_angle),
        rest_angle=sides,
        present=ones if present is None else present,
        linked=ones[1:] if linked is None else linked,
        touching=jnp.zeros((), bool),
    )


def _still(position: Float[Array, "body 2"], angle: Float[Array, " body"]) -> Bodies:
    return Bodies(position, angle, jnp.zeros_like(position), jnp.zeros_like(angle))


def heading(angle: Float[Array, " unit"]) -> Float[Array, "unit 2"]:
    """Unit vectors in which a positive thrust pushes: the unit's angle + 90 degrees."""
    return jnp.stack([-jnp.sin(angle), jnp.cos(angle)], axis=-1)


def wrap(angle: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The same angle in [-pi, pi)."""
    return jnp.mod(angle + pi, 2 * pi) - pi
