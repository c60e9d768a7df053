"""Currents: the velocity of the water, which enters the dynamics as drag relative to it.

All velocities are in m/s in world axes; every parameter may be traced.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.physics.state import Bodies, Chain, Physics, Scalar


class Flow(NamedTuple):
    """How the water moves at some points."""

    velocity: Float[Array, "body 2"]  # m/s
    spin: Float[Array, " body"]  # rad/s, half the vorticity: what a floating body turns with


class Current(eqx.Module):
    """The water's motion. A current of one's own overrides `flow`, and `advance` if it changes."""

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """The water's motion at these points (m)."""
        raise NotImplementedError

    def advance(self, key: PRNGKeyArray, dt: Scalar) -> "Current":
        """The current `dt` seconds later; the same unless it changes in time."""
        del key, dt
        return self


def _vector(value: object) -> Float[Array, "2"]:
    return jnp.asarray(value, float)


class Uniform(Current):
    """The same velocity everywhere."""

    velocity: Float[Array, "2"] = eqx.field(converter=_vector, default=(0.0, 0.0))  # m/s

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """The one velocity, without spin."""
        still = jnp.zeros(position.shape[:1], position.dtype)
        return Flow(jnp.broadcast_to(self.velocity, position.shape), still)


class Shear(Current):
    """A current along one direction whose speed grows across it: zero on a line through a point."""

    rate: Scalar = 0.0  # 1/s, growth of the speed with the distance across
    angle: Scalar = 0.0  # rad, of the direction along which the water flows
    centre: Float[Array, "2"] = eqx.field(converter=_vector, default=(0.0, 0.0))  # m

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """Speed proportional to the distance from the line, and its constant spin."""
        along = jnp.stack([jnp.cos(self.angle), jnp.sin(self.angle)])
        across = jnp.stack([-along[1], along[0]])
        speed = self.rate * ((position - self.centre) @ across)
        spin = jnp.full(position.shape[:1], -self.rate / 2, position.dtype)
        return Flow(speed[:, None] * along, spin)


class Vortex(Current):
    """A Lamb-Oseen vortex: turns like a solid at its centre, and as 1 / distance far from it.

    Source: the velocity profile of Devenport et al. (1996), fastest at the core's radius.
    """

    speed: Scalar = 0.0  # m/s, at the core's radius; positive is anticlockwise
    radius: Scalar = 0.3  # m, of the core
    centre: Float[Array, "2"] = eqx.field(converter=_vector, default=(0.0, 0.0))  # m

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """Round the centre; the spin is half the vorticity at each point."""
        away = position - self.centre
        square = jnp.sum(away**2, axis=-1) / self.radius**2
        decay = jnp.exp(-SHAPE * square)
        inside = square < 1e-6  # the limit at the centre
        turns = jnp.where(inside, SHAPE, (1 - decay) / jnp.where(inside, 1.0, square))
        scale = (1 + 1 / (2 * SHAPE)) * self.speed / self.radius
        around = jnp.stack([-away[:, 1], away[:, 0]], axis=-1)
        return Flow(scale * turns[:, None] * around, scale * SHAPE * decay)


SHAPE = 1.25643  # of the Lamb-Oseen profile, so that its fastest ring is the core's radius


class Wandering(Current):
    """A uniform current that changes as a mean-reverting random walk (Ornstein-Uhlenbeck)."""

    deviation: Scalar = 0.0  # m/s, standard deviation of each component in the long run
    relaxation: Scalar = 10.0  # s, in which a deviation falls to 1/e of itself
    mean: Float[Array, "2"] = eqx.field(converter=_vector, default=(0.0, 0.0))  # m/s
    now: Float[Array, "2"] = eqx.field(converter=_vector, default=(0.0, 0.0))  # m/s, from the mean

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """The present velocity, the same everywhere."""
        return Uniform(self.mean + self.now).flow(position)

    def advance(self, key: PRNGKeyArray, dt: Scalar) -> "Wandering":
        """The exact step of the process, of any length."""
        keep = jnp.exp(-dt / self.relaxation)
        drawn = self.deviation * jnp.sqrt(1 - keep**2) * jr.normal(key, (2,), self.now.dtype)
        return eqx.tree_at(lambda c: c.now, self, keep * self.now + drawn)


class Sum(Current):
    """Several currents at once."""

    parts: tuple[Current, ...]

    def flow(self, position: Float[Array, "body 2"]) -> Flow:
        """Velocities and spins added up."""
        flows = [part.flow(position) for part in self.parts]
        return Flow(sum(f.velocity for f in flows), sum(f.spin for f in flows))  # type: ignore[arg-type]

    def advance(self, key: PRNGKeyArray, dt: Scalar) -> "Sum":
        """Each part by itself."""
        keys = jr.split(key, len(self.parts))
        return Sum(tuple(part.advance(k, dt) for part, k in zip(self.parts, keys, strict=True)))


def parts_of(current: Current | None) -> tuple[Current, ...]:
    """The currents that add up to one."""
    if current is None:
        return ()
    return current.parts if isinstance(current, Sum) else (current,)


def carried(chain: Chain, current: Current, physics: Physics) -> Chain:
    """The chain with velocities from which one control step gives drag relative to the water.

    A step multiplies every velocity v by k = 1 - drag once; with water at c it has to become
    c + k (v - c), which is k (v + c drag / k). Turning likewise, relative to the water's spin.
    """
    share = physics.drag / (1 - physics.drag)

    def drifting(bodies: Bodies) -> tuple[Array, Array]:
        flow = current.flow(bodies.position)
        return bodies.velocity + share * flow.velocity, bodies.angular_velocity + share * flow.spin

    moved = (*drifting(chain.units), *drifting(chain.links))
    return eqx.tree_at(
        lambda c: (
            c.units.velocity,
            c.units.angular_velocity,
            c.links.velocity,
            c.links.angular_velocity,
        ),
        chain,
        moved,
    )
