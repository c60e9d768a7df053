"""What a chain is told of itself: noise, bias, delay, readings that are stuck or dropped.

The poses and velocities of units go through here before they are observed; the target and the
forces that units sense stay exact. Units: m, rad, m/s, rad/s; durations in control steps.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.physics.batching import over_the_batch
from salpchain.physics.state import Bodies, Chain, Scalar
from salpchain.xla import materialise

Count = int | Int[Array, ""]


class Senses(eqx.Module):
    """What the sensors of one episode remember, and what they tell now."""

    told: Bodies  # of units, what the controller gets
    bias: Bodies  # of units, constant during the episode
    past: Bodies  # of units, with a first axis of steps: readings before now, the newest first
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
        first = Bodies(*_read(*self._parts, _words(key), units, bias))
        past = jax.tree.map(lambda x: jnp.repeat(x[None], self.most_delay, axis=0), first)
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
        words = _words(key)
        reading = Bodies(*_read(*self._parts, words, chain.units, before.bias))
        readings = jax.tree.map(
            lambda new, old: jnp.concatenate([new[None], old]), reading, before.past
        )
        past = jax.tree.map(lambda x: x[:-1], readings)
        told = jax.tree.map(lambda x: _ago(x, self.delay), readings)
        stuck, dropped = before.stuck, before.dropped
        if not (_is_zero(self.stuck) and _is_zero(self.dropped)):
            stick, drop = _fate(None, words, chain.units.angle)
            stuck = _lasting(stick, stuck, self.stuck, self.stuck_steps)
            dropped = _lasting(drop, dropped, self.dropped, self.dropped_steps)
            held = (stuck > 0) | (dropped > 0)
            told = jax.tree.map(lambda old, new: _held(held, old, new), before.told, told)
        return Senses(told, before.bias, past, stuck, dropped, before.actions)

    def silenced(
        self, obs: Float[Array, "unit feature"], senses: Senses
    ) -> Float[Array, "unit feature"]:
        """The observation with zeros for units whose readings are dropped."""
        if _is_zero(self.dropped):
            return obs
        return jnp.where(senses.dropped[:, None] > 0, 0.0, obs)

    @property
    def _parts(self) -> tuple["Sensing", "Sensing"]:
        """What is fixed when a program is compiled, and what each episode has of its own."""
        return eqx.partition(self, lambda leaf: isinstance(leaf, float | int))


@over_the_batch
def _read(fixed: Sensing, own: Sensing, words: Array, units: Any, bias: Any) -> list[Array]:
    """The fields of units as their sensors read them, with bias and noise."""
    sensing: Sensing = eqx.combine(fixed, own)
    noises = sensing.position, sensing.angle, sensing.velocity, sensing.turning
    biases = sensing.position_bias, sensing.angle_bias, 0.0, 0.0
    firsts, read = (0, 2, 3, 5), []  # numbers that are drawn for a unit
    fields = jax.tree.leaves(units), jax.tree.leaves(bias)
    for x, offset, noise, deviation, first in zip(*fields, noises, biases, firsts, strict=True):
        reading = x if _is_zero(deviation) else x + offset
        if not _is_zero(noise):
            drawn = jax.scipy.special.erfinv(2 * _uniform(words, first, x) - 1)
            reading = reading + noise * math.sqrt(2) * drawn
        read.append(reading)
    return materialise(read, jnp.isinf(units.angle).all())


@over_the_batch
def _fate(_: None, words: Array, like: Array) -> tuple[Array, Array]:
    """Random numbers that decide for each unit whether a fault begins."""
    return _uniform(words, 6, like), _uniform(words, 7, like)


def _words(key: PRNGKeyArray) -> Array:
    """Random bits from which those of a control step are made."""
    return jr.key_data(key)[:2]


def _uniform(words: Array, first: int, like: Array) -> Array:
    """Random numbers between 0 and 1, neither of which comes, in the shape of (unit, ..., batch).

    Each is the hash of its place (the unit, and the number that is drawn for it, from `first` on)
    and of the chain's words, twice through the mixing function lowbias32 (Wellons 2018). With
    all of them from JAX's own generator, which makes the words, a step took half as long again.
    """
    unit = jnp.arange(like.shape[0], dtype=jnp.uint32)[:, None]
    number = first + jnp.arange(math.prod(like.shape[1:-1]), dtype=jnp.uint32)
    place = ((8 * unit + number) * jnp.uint32(0x9E3779B9)).reshape(*like.shape[:-1], 1)
    bits = _mixed(_mixed(words[0] ^ place) ^ words[1])
    dtype = jnp.result_type(like, jnp.float32)
    return ((bits >> 9).astype(dtype) + 0.5) * 2.0**-23


def _mixed(bits: Array) -> Array:
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        bits = (bits ^ (bits >> shift)) * jnp.uint32(factor)
    return bits ^ (bits >> 16)


def _is_zero(number: Any) -> bool:
    """Whether it is known to be 0 when the program is compiled."""
    return isinstance(number, float | int) and number == 0


def _ago(readings: Array, delay: Any) -> Array:
    """The reading of so many steps before, of those that are there."""
    told = readings[0]
    for steps in range(1, len(readings)):
        told = jnp.where(delay >= steps, readings[steps], told)
    return told


def _lasting(drawn: Array, left: Array, probability: Any, steps: Any) -> Array:
    """Steps for which a fault still lasts; one that is over may begin anew."""
    anew = jnp.where(drawn < probability, jnp.asarray(steps, left.dtype), 0)
    return jnp.where(left > 1, left - 1, anew)


def _held(flag: Bool[Array, " unit"], one: Array, other: Array) -> Array:
    return jnp.where(flag if one.ndim == flag.ndim else flag[:, None], one, other)
