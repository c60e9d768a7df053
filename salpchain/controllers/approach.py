"""Turn, then approach: the whole chain steered as a unicycle that takes a pose.

The closed loop of Aicardi, Casalino, Bicchi and Balestrino, "Closed loop steering of unicycle-like
vehicles via Lyapunov techniques" (1995), in polar coordinates about the target's centroid. Thrust
acts across a chain, so a straight one has a unicycle's constraint: it cannot go along its own axis,
but has to turn for it. A bent one can go anywhere: near the target it goes straight on.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.controllers.greedy import as_action
from salpchain.controllers.policy import PolicyCard
from salpchain.physics.state import heading, wrap
from salpchain.switches import standard_promotion
from salpchain.tasks.checks import check_state
from salpchain.tasks.reach.targets import LINK
from salpchain.tasks.state import State

TOP_SPEED = 0.2  # m/s, of a chain
HOLD = 5.0  # N for each m/s, against drag
# What follows was chosen by a search over 8, 16 and 32 units.
APPROACH = 0.5  # 1/s, speed for each metre that is left
TURN = 3.0  # top speeds at the chain's ends while it turns towards its course
CROOK = 2.0  # how far out the course swings to arrive in the target's orientation
BEND = 5.0  # 1/s, speed of a unit for each metre that it is off its place in the target's shape
CORRECTION = 2.0  # N for each m/s off the wanted speed
ARRIVED = 0.03  # m, nearer than this the chain turns to the target's orientation where it is
DIRECT = 2.0  # 1/s, speed for each metre where the chain is bent
STRAIGHT, BENT = 0.01, 0.06  # least share of thrust in a direction: none, and enough to go there
WEAK = 0.005  # share of thrust below which a direction is not asked for
BENDING = 0.5  # of half the chain's length: nearer than this it bends to the target's shape,
MARGIN = 0.1  # m, and this much farther out
QUICKEST = 1.5  # top speeds at the chain's ends, in any turn on the way
SHARP = 2.0  # 1/rad, how soon turning is at its full rate
TINY = 1e-8  # m^2, keeps roots of 0 differentiable


class Pose(NamedTuple):
    """A chain, or its target, as one rigid body."""

    centre: Float[Array, "2"]  # m
    course: Float[Array, ""]  # rad, in which a straight chain swims
    arms: Float[Array, "unit 2"]  # m, from the centre


class Approach(eqx.Module):
    """Each unit holds the speed along its heading that the motion of the whole asks of it.

    It reads positions and velocities themselves, so it can stand beside a policy of any
    observation and action.
    """

    observation: str = eqx.field(static=True, default="body")
    action: str = eqx.field(static=True, default="thrust")

    def __check_init__(self) -> None:
        _ = self.card  # is refused with an unknown observation or action

    @property
    def card(self) -> PolicyCard:
        """Works at any length; was never trained."""
        return PolicyCard(name="approach", observation=self.observation, action=self.action)

    @standard_promotion
    def act(self, state: State) -> Float[Array, "unit act"]:
        """Numbers in [-1, 1] for each unit: the thrust, and for `pair` its opposite too.

        Raises:
            InputError: a batch of states.
        """
        check_state(state, "act")
        units, present = state.seen.units, state.seen.present
        ahead = heading(units.angle) * present[:, None]
        chain, target = pose(units.position, present), pose(state.target, present)
        goal = _speeds(chain, target, ahead, present.sum())
        now = jnp.sum(units.velocity * ahead, axis=-1)
        return as_action(HOLD * goal + CORRECTION * (goal - now), self.action)


def pose(points: Float[Array, "unit 2"], present: Bool[Array, " unit"]) -> Pose:
    """Points in chain order as a rigid body; its axis is the line that fits them best in order."""
    number = present.sum()
    share = (present / number)[:, None]
    centre = jnp.sum(share * points, axis=0)
    place = jnp.arange(len(points)) * (2 / jnp.maximum(number - 1, 1)) - 1.0
    axis = jnp.sum(share * place[:, None] * (points - centre), axis=0)
    return Pose(centre, jnp.arctan2(axis[1], axis[0]) + jnp.pi / 2, points - centre)


def _speeds(
    chain: Pose, target: Pose, ahead: Float[Array, "unit 2"], number: Array
) -> Float[Array, " unit"]:
    """What every unit's speed along its heading (m/s) should be."""
    gap = target.centre - chain.centre
    distance = jnp.sqrt(jnp.sum(gap**2) + TINY)
    reach = LINK * (number - 1) / 2 + LINK / 2
    near = jnp.exp(-((distance / (BENDING * reach + MARGIN)) ** 2))
    free = near * _freedom(ahead, number)
    speed, turning = _unicycle(chain.course, target.course, gap, distance, reach)
    settled = _turning(target.course - chain.course, reach)
    straight_on = gap * jnp.minimum(DIRECT, TOP_SPEED / distance)
    course = jnp.stack([jnp.cos(chain.course), jnp.sin(chain.course)])
    drive = (1 - free) * speed * course + free * straight_on
    spin = (1 - free) * turning + free * settled
    bending = near * jnp.sum(_bending(chain, target) * ahead, axis=-1)
    return bending + _shared_out(drive, spin * reach, chain.arms / reach, ahead, bending)


def _shared_out(drive: Array, spin: Array, arms: Array, ahead: Array, bending: Array) -> Array:
    """Speeds along the headings that together move the chain so, whatever the bending adds."""
    across = jnp.stack([-arms[:, 1], arms[:, 0]], axis=-1) * jnp.any(ahead != 0, -1)[:, None]
    does = jnp.concatenate([ahead, jnp.sum(across * ahead, -1, keepdims=True)], axis=-1)
    number = jnp.sum(ahead**2)
    asked = jnp.append(drive, spin * jnp.sum(across**2) / number) - does.T @ bending / number
    return does @ jnp.linalg.solve(does.T @ does / number + WEAK * jnp.eye(3), asked)


def _freedom(ahead: Float[Array, "unit 2"], number: Array) -> Float[Array, ""]:
    """0 for a straight chain; 1 for one so bent that it can swim in any direction."""
    weakest = jnp.linalg.eigvalsh(ahead.T @ ahead / number)[0]  # share of thrust, worst direction
    return jnp.clip((weakest - STRAIGHT) / (BENT - STRAIGHT), 0.0, 1.0)


def _unicycle(
    course: Array, wanted: Array, gap: Array, distance: Array, reach: Array
) -> tuple[Array, Array]:
    """Speed along the course (m/s) and rate of turn (rad/s); backwards if that is nearer."""
    bearing = jnp.arctan2(gap[1], gap[0])
    backwards = jnp.cos(bearing - course) < 0
    flip = jnp.where(backwards, jnp.pi, 0.0)
    off = wrap(bearing - course + flip)
    aside = wrap(bearing - wanted + flip)
    speed = jnp.minimum(APPROACH * distance, TOP_SPEED)
    steer = jnp.cos(off) * jnp.sinc(off / jnp.pi) * (off + CROOK * aside)
    most = QUICKEST * TOP_SPEED / reach
    turning = jnp.clip(_turning(off, reach) + speed / distance * steer, -most, most)
    there = jnp.exp(-((distance / ARRIVED) ** 2))
    turning = (1 - there) * turning + there * _turning(wanted - course, reach)
    return speed * jnp.cos(off) * jnp.where(backwards, -1.0, 1.0), turning


def _turning(off: Array, reach: Array) -> Array:
    """Rate of turn (rad/s) for a course that is off by this angle (rad)."""
    return TURN * TOP_SPEED / reach * jnp.tanh(SHARP * wrap(off))


def _bending(chain: Pose, target: Pose) -> Float[Array, "unit 2"]:
    """Velocities (m/s) towards the target's shape, turned to how the chain lies now."""
    turn = chain.course - target.course
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    x, y = target.arms[:, 0], target.arms[:, 1]
    shape = jnp.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
    wanted = BEND * (shape - chain.arms)
    size = jnp.sqrt(jnp.sum(wanted**2, axis=-1, keepdims=True) + TINY)
    return wanted * jnp.minimum(1.0, TOP_SPEED / size)
