"""What a chain is told of itself: noise, bias, delay, readings that are stuck or dropped.

The poses and velocities of units go through here before they are observed; the target and the
forces that units sense stay exact. Units: m, rad, m/s, rad/s; durations in control steps.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.physics.state import Bodies, Chain, Scalar

Count = int | Int[Array, ""]


class Senses(eqx.Module):
    """What the sensors of one episode remember, and what they tell now."""

    told: Bodies  # of units, what the controller gets
    bias: Bodies  # of units, constant during the episode
    past: Bodies  # of units, with a first axis of steps: the newest readings first
    stuck: Int[Array, " unit"]  # steps for which a unit's reading still repeats
    dropped: Int[Array, " unit"]  # steps for which a unit still tells nothing
    actions: Float[Array, "step unit act"]  # the newest first

    def of(self, chain: Chain) -> Chain:
        """The chain as it is told."""
        return eqx.tree_at(lambda c: c.units, chain, self.told)


class Sensing(eqx.Module):
    """Faults of the sensors. Standard deviations are of Gaussians, drawn for each unit."""

    position: Scalar = 0.0  # m, noise of each coordinate at each step
    angle: Scalar = 0.0  # rad, noise at each step
    velocity: Scalar = 0.0  # m/s
    turning: Scalar = 0.0  # rad/s
    position_bias: Scalar = 0.0  # m, standard deviation of an offset that lasts the episode
    angle_bias: Scalar = 0.0  # rad
    stuck: Scalar = 0.0  # probability, in each step, that a unit's reading begins to repeat
    stuck_steps: Count = 1  # control steps for which it does
    dropped: Scalar = 0.0  # probability, in each step, that a unit begins to tell nothing
    dropped_steps: Count = 1  # control steps for which it does not
    delay: Count = 0  # control steps by which readings are late
    most_delay: int = eqx.field(default=0, static=True)  # that `delay` may be: what is kept
    action_delay: Count = 0  # control steps by which actions are late; at first there is no thrust
    most_action_delay: int = eqx.field(default=0, static=True)  # likewise
    repeat: Count = 1  # control steps for which an action is held
    repeats: bool = eqx.field(default=False, static=True)  # whether `repeat` may be more than 1

    def start(self, key: PRNGKeyArray, chain: Chain, act: int) -> Senses:
        """The sensors at the first step of an episode: all earlier readings are the first one.

        `act` is how many numbers a unit's action has.
        """
        bias_key, key = jr.split(key)
        units, size = chain.units, chain.units.angle.shape
        place, turn = jr.split(bias_key)
        bias = Bodies(
            self.position_bias * jr.normal(place, units.position.shape, units.position.dtype),
            self.angle_bias * jr.normal(turn, size, units.angle.dtype),
            jnp.zeros_like(units.velocity),
            jnp.zeros_like(units.angular_velocity),
        )
        first = self._read(key, units, bias)
        past = jax.tree.map(lambda x: jnp.repeat(x[None], self.most_delay + 1, axis=0), first)
        none = jnp.zeros(size, jnp.int32)
        actions = jnp.zeros((self.most_action_delay + 1, *size, act), units.angle.dtype)
        return Senses(first, bias, past, none, none, actions)

    def given(
        self, senses: Senses, action: Float[Array, "unit act"], time: Int[Array, ""]
    ) -> tuple[Float[Array, "unit act"], Senses]:
        """The action that acts in this control step, where this one was given, and the memory."""
        if self.repeats:
            action = jnp.where(time % self.repeat == 0, action, senses.actions[0])
        if not self.repeats and self.most_action_delay == 0:
            return action, senses
        actions = jnp.concatenate([action[None], senses.actions[:-1]])
        kept = eqx.tree_at(lambda s: s.actions, senses, actions)
        return actions[self.action_delay], kept

    def sense(self, key: PRNGKeyArray, chain: Chain, before: Senses) -> Senses:
        """What the sensors tell of the chain, after what they told in the step before."""
        noise, stick, drop = jr.split(key, 3)
        reading = self._read(noise, chain.units, before.bias)
        past = jax.tree.map(
            lambda new, old: jnp.concatenate([new[None], old[:-1]]), reading, before.past
        )
        late = jax.tree.map(lambda x: x[self.delay], past)
        stuck = _lasting(stick, before.stuck, self.stuck, self.stuck_steps)
        dropped = _lasting(drop, before.dropped, self.dropped, self.dropped_steps)
        held = (stuck > 0) | (dropped > 0)
        told = jax.tree.map(lambda old, new: _where(held, old, new), before.told, late)
        return Senses(told, before.bias, past, stuck, dropped, before.actions)

    def _read(self, key: PRNGKeyArray, units: Bodies, bias: Bodies) -> Bodies:
        scales = self.position, self.angle, self.velocity, self.turning

        def read(x: Array, offset: Array, scale: Any, key: PRNGKeyArray) -> Array:
            return x + offset + scale * jr.normal(key, x.shape, x.dtype)

        true, offsets = jax.tree.leaves(units), jax.tree.leaves(bias)
        return Bodies(*map(read, true, offsets, scales, jr.split(key, len(scales))))


def _lasting(
    key: PRNGKeyArray, left: Int[Array, " unit"], probability: Scalar, steps: Count
) -> Int[Array, " unit"]:
    """Steps for which a fault still lasts; one that is over may begin anew."""
    begins = jr.uniform(key, left.shape) < probability
    anew = jnp.where(begins, jnp.asarray(steps, left.dtype), 0)
    return jnp.where(left > 1, left - 1, anew)


def _where(flag: Bool[Array, " unit"], one: Array, other: Array) -> Array:
    return jnp.where(flag.reshape(flag.shape + (1,) * (one.ndim - 1)), one, other)


def silenced(
    obs: Float[Array, "unit feature"], senses: Senses | None
) -> Float[Array, "unit feature"]:
    """The observation with zeros for units whose readings are dropped."""
    return obs if senses is None else jnp.where(senses.dropped[:, None] > 0, 0.0, obs)
