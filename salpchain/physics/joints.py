"""Forces of the soft joints and torques of the angle constraints (VMAS 1.5.2 `joints.py`).

Arrays have the batch last: vectors are (2, body, batch).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.polynomial import chebyshev

from salpchain.physics.derivatives import root, scaled_expm1

CLOSED = 1e-6  # m, a joint open less than this exerts nothing (VMAS)

# log(1 + x) on [0, 1] to 1e-7, as a polynomial: XLA's own costs more than the rest of a substep.
LOG1P = chebyshev.cheb2poly(
    chebyshev.Chebyshev.interpolate(lambda x: np.log1p((x + 1) / 2), 9).coef
).tolist()


class JointForces(NamedTuple):
    """What the joints of each link exert; `first` is the unit before the link, `second` after."""

    first: Float[Array, "2 link batch"]  # N, on the first unit; the opposite acts on the link
    second: Float[Array, "2 link batch"]  # N, on the second unit
    first_torque: Float[Array, "link batch"]  # N m, on the first unit; the opposite on the link
    second_torque: Float[Array, "link batch"]  # N m, on the second unit


def joint_force(
    opening: Float[Array, "2 link batch"],
    joined: Bool[Array, "link batch"],
    stiffness: Any,
    softness: Any,
) -> Float[Array, "2 link batch"]:
    """Force (N) along the opening (m) of a joint, softplus-shaped; none while it is closed."""
    distance = root(opening[0] * opening[0] + opening[1] * opening[1])
    size = stiffness * softness * softplus(distance * (1 / softness))
    acts = joined & (distance >= CLOSED)
    return jnp.where(acts, size / jnp.maximum(distance, CLOSED), 0.0) * opening


@jax.custom_jvp
def spring_like_force(
    opening: Float[Array, "2 link batch"],
    joined: Bool[Array, "link batch"],
    stiffness: Any,
    softness: Any,
) -> Float[Array, "2 link batch"]:
    """`joint_force`, whose derivative by the opening is that of a spring of the same stiffness.

    The force jumps from nothing to 0.6 N where a joint opens, so a loaded joint chatters there: the
    true derivative grows by a tenth in every substep and tells nothing of the chain's motion.
    """
    return joint_force(opening, joined, stiffness, softness)


@spring_like_force.defjvp
def _(primals: Any, tangents: Any) -> tuple[Array, Array]:
    opening, joined, *constants = primals
    force, by_constants = jax.jvp(
        lambda *some: joint_force(opening, joined, *some), tuple(constants), tuple(tangents[2:])
    )
    return force, by_constants + jnp.where(joined, constants[0], 0.0) * tangents[0]


# By `Physics.joint_derivative`
FORCES = {"spring": spring_like_force, "exact": joint_force}


def angle_torque(
    bend: Float[Array, "link batch"], joined: Bool[Array, "link batch"], stiffness: Any
) -> Float[Array, "link batch"]:
    """Torque (N m) that turns a unit after its link: stiffness (exp|bend| - 1) sign(bend)."""
    return jnp.where(joined, scaled_expm1(stiffness, bend), 0.0)


def softplus(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """log(1 + exp(x)) for x >= 0, to 2e-7."""
    return x + _log1p(jnp.exp(-x))


def _log1p(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    centred = 2 * x - 1
    value = jnp.full_like(x, LOG1P[-1])
    for coefficient in LOG1P[-2::-1]:
        value = value * centred + coefficient
    return value
