"""How the units of a jointed chain move together, in a number of operations linear in their number.

Each unit is a rigid body whose motion V (velocity of its centre, rate of turning) takes a load
A V - b: A is its resistance where nothing has inertia, its resistance and mass over a time step
where it has. Neighbours are joined end to end by hinges. From the last unit to the first, a unit
and all that hang on it become one body with a resistance and a load of its own, as in the
articulated-body algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7); from the
first to the last, the motions follow.

Arrays have the units first and the batch last; the loop over units is a `lax.scan`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Row = Float[Array, "unit batch"]


class Vectors(NamedTuple):
    """A vector of each unit in world axes."""

    x: Any
    y: Any


class Resistance(NamedTuple):
    """A symmetric matrix of each unit about its centre, in world axes: load for each motion."""

    xx: Any  # N s/m
    xy: Any
    yy: Any
    xw: Any  # N s
    yw: Any
    ww: Any  # N m s

    def about(self, arm: Vectors, sign: float = 1.0) -> "Resistance":
        """The same, told by the motion of the point `arm` (m) away from where it was told.

        With `sign` -1, told by that of the point from which `arm` leads here.
        """
        x, y = sign * arm.y, -sign * arm.x
        xw = self.xw + self.xx * x + self.xy * y
        yw = self.yw + self.xy * x + self.yy * y
        ww = self.ww + x * (xw + self.xw) + y * (yw + self.yw)
        return Resistance(self.xx, self.xy, self.yy, xw, yw, ww)


class Load(NamedTuple):
    """Force and torque about the centre of each unit; or, `Twist`, its motion."""

    x: Any  # N
    y: Any
    w: Any  # N m

    def about(self, arm: Vectors, sign: float = 1.0) -> "Load":
        """The same about a point, as `Resistance.about`."""
        return Load(self.x, self.y, self.w + sign * (arm.y * self.x - arm.x * self.y))


class Twist(NamedTuple):
    """Velocity of the centre and rate of turning of each unit."""

    x: Any  # m/s
    y: Any
    w: Any  # rad/s


class Hinges(NamedTuple):
    """The joints before each unit; that before the first one is none."""

    arm: Vectors  # m, from a unit's centre to its second end, where the next begins
    joined: Bool[Array, "unit batch"]  # whether it hangs on the unit before
    drag: Any  # N m s, torque against bending for each rad/s
    torque: Any  # N m, on the unit, the opposite on the unit before: of a spring


class Passed(NamedTuple):
    """What hangs on a unit, as it is felt at its centre."""

    resistance: Resistance
    load: Load


def solve(resistance: Resistance, load: Load, hinges: Hinges) -> Twist:
    """The motion in which every unit's load is met and no joint opens.

    A unit that is not there needs a resistance of its own, such as 1, no load and no joint.
    """
    arm = hinges.arm
    before = Vectors(*(jnp.concatenate([row[:1], row[:-1]]) for row in arm))
    rows = resistance, load, hinges, before
    none = jnp.zeros_like(arm.x[0])
    start = Passed(Resistance(*[none] * 6), Load(none, none, none))
    _, kept = jax.lax.scan(_hang, start, rows, reverse=True)
    still = Twist(none, none, none)
    return jax.lax.scan(_follow, still, (kept, hinges.joined, arm, before))[1]


def _hang(passed: Passed, rows: Any) -> tuple[Passed, tuple[Array, ...]]:
    """One unit with all that hangs on it, as the unit before feels it; and what `_follow` needs.

    The unit's rate w is eliminated from the balance of torques about the joint, with v the joint's
    velocity and w' the rate of the unit before: a.v + ww w - b = torque - drag (w - w').
    """
    resistance, load, hinges, before = rows
    body = Resistance(*(a + b for a, b in zip(resistance, passed.resistance, strict=True)))
    force = Load(*(a + b for a, b in zip(load, passed.load, strict=True)))
    at, pull = body.about(hinges.arm, -1.0), force.about(hinges.arm, -1.0)
    drag, known = hinges.drag, pull.w + hinges.torque
    share = 1 / (at.ww + drag)
    x, y, turn, carried = at.xw * share, at.yw * share, known * share, drag * share
    joint = Resistance(
        at.xx - at.xw * x, at.xy - at.xw * y, at.yy - at.yw * y,
        at.xw * carried, at.yw * carried, at.ww * carried,
    )  # fmt: skip
    felt = Load(pull.x - at.xw * turn, pull.y - at.yw * turn, drag * turn - hinges.torque)
    on, by = joint.about(before, -1.0), felt.about(before, -1.0)
    joined = hinges.joined
    # Only the first unit of a chain, and an empty slot, moves by itself: mostly none of a batch.
    free = jax.lax.cond(joined.all(), lambda: (turn, turn, turn), lambda: _alone(body, force))
    passed = Passed(
        Resistance(*(jnp.where(joined, row, 0.0) for row in on)),
        Load(*(jnp.where(joined, row, 0.0) for row in by)),
    )
    kept = [jnp.where(joined, a, b) for a, b in zip((x, y, turn), free, strict=True)]
    return passed, (*kept, carried)


def _follow(one: Twist, rows: Any) -> tuple[Twist, Twist]:
    """The motion of a unit after that of the unit before."""
    (x, y, turn, carried), joined, arm, before = rows
    at_x, at_y = one.x - one.w * before.y, one.y + one.w * before.x
    rate = turn - x * at_x - y * at_y + carried * one.w
    rate = jnp.where(joined, rate, turn)
    twist = Twist(
        jnp.where(joined, at_x - rate * arm.y, x), jnp.where(joined, at_y + rate * arm.x, y), rate
    )
    return twist, twist


def _alone(body: Resistance, force: Load) -> tuple[Array, Array, Array]:
    """The motion of a body on which nothing pulls but what hangs on it."""
    x, y = body.xw / body.ww, body.yw / body.ww
    xx, xy, yy = body.xx - body.xw * x, body.xy - body.xw * y, body.yy - body.yw * y
    left_x, left_y = force.x - x * force.w, force.y - y * force.w
    share = 1 / (xx * yy - xy * xy)
    vx, vy = (yy * left_x - xy * left_y) * share, (xx * left_y - xy * left_x) * share
    return vx, vy, force.w / body.ww - x * vx - y * vy


def closed(place: Vectors, hinges: Hinges) -> Vectors:
    """The places (m) of the units with every joint closed: each follows from the unit before."""

    def lay(last: tuple[Array, Array], rows: Any) -> tuple[tuple[Array, Array], Vectors]:
        x, y, joined, arm, before = rows
        here = (
            jnp.where(joined, last[0] + before.x + arm.x, x),
            jnp.where(joined, last[1] + before.y + arm.y, y),
        )
        return here, Vectors(*here)

    before = Vectors(*(jnp.concatenate([row[:1], row[:-1]]) for row in hinges.arm))
    first = place.x[0], place.y[0]
    return jax.lax.scan(lay, first, (place.x, place.y, hinges.joined, hinges.arm, before))[1]
