"""Compiled control steps of a live world: few fixed sizes, so that no edit ever compiles."""

import threading
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Float

from salpchain.controllers.policy import Controller
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.physics.state import Bodies, Chain, heading
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.reward import distances, reached
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from salpchain.world.current import Uniform
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World

SLOTS = (64, 128)  # units of all chains together, of a compiled step (chosen)
CHAINS = 6  # that swim at once (chosen)


class Packed(NamedTuple):
    """All chains one after the other in as many slots as a program has; NumPy or JAX."""

    units: Any  # (slot, 6) x, y, angle and their rates
    links: Any  # (gap, 6)
    rest: Any  # (gap, 2)
    linked: Any  # (gap,)
    target: Any  # (slot, 2)
    thrust: Any  # (slot,) of the last step (N)
    works: Any  # (slot,)
    kick: Any  # (slot, 2) m/s, added to a unit's velocity once
    current: Any  # (2,) m/s, of the water
    first: Any  # (chain,) slot of each chain's first unit
    count: Any  # (chain,) its units; 0 where there is no chain


class Moved(NamedTuple):
    """The chains one control step later."""

    units: Any  # (slot, 6)
    links: Any  # (gap, 6)
    thrust: Any  # (slot,)
    distance: Any  # (chain,) m, mean, to the target
    reached: Any  # (chain,)


class Pool:
    """Compiled steps by kind of controller and number of slots; several threads may use it."""

    def __init__(self) -> None:
        """Nothing is compiled yet."""
        self._compiled: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def prepare(self, controller: Controller, slots: int) -> None:
        """Compiles the step of such controllers, unless that was done."""
        key = _key(controller, slots)
        if key in self._compiled:
            return
        with self._lock:
            if key not in self._compiled:
                weights, rest = eqx.partition(controller, eqx.is_array)
                work = jax.jit(partial(_advance, rest)).lower(weights, empty(slots))
                self._compiled[key] = work.compile()

    def advance(self, controller: Controller, packed: Packed) -> Moved:
        """The world one control step later, as NumPy arrays."""
        slots = len(packed.units)
        self.prepare(controller, slots)
        weights, _ = eqx.partition(controller, eqx.is_array)
        return jax.tree.map(np.asarray, self._compiled[_key(controller, slots)](weights, packed))


def _key(controller: Controller, slots: int) -> Any:
    """Controllers of one kind share a program: weights are data."""
    card = controller.card
    shapes = [(x.shape, x.dtype) for x in jax.tree.leaves(controller) if eqx.is_array(x)]
    own = card.length if card.control.model in SINGLE_LENGTH else 0
    kind = type(controller), card.control, card.observation, card.action, own
    return kind, tuple(shapes), slots


def slots_for(units: int) -> int:
    """The smallest program that holds so many units."""
    return next(slots for slots in SLOTS if slots >= units)


def empty(slots: int) -> Packed:
    """No chains, in arrays of the right shapes and types."""
    gap, f = slots - 1, np.float32
    return Packed(
        units=np.zeros((slots, 6), f),
        links=np.zeros((gap, 6), f),
        rest=np.zeros((gap, 2), f),
        linked=np.zeros(gap, bool),
        target=np.zeros((slots, 2), f),
        thrust=np.zeros(slots, f),
        works=np.zeros(slots, bool),
        kick=np.zeros((slots, 2), f),
        current=np.zeros(2, f),
        first=np.zeros(CHAINS, np.int32),
        count=np.zeros(CHAINS, np.int32),
    )


def _advance(rest: Any, weights: Any, packed: Packed) -> Moved:
    """Each chain is steered by itself; then all of them move together and may touch."""
    controller, slots = eqx.combine(weights, rest), len(packed.units)
    card, world = controller.card, _world(packed)
    env = SCLD(TaskConfig(slots, card.observation, card.action))
    chain = _chain(packed)
    force = packed.thrust[:, None] * heading(chain.units.angle)

    def steer(index: Array, thrust: Array) -> Array:
        own, target, past = _alone(packed, chain, force, index)
        wanted = env.thrust(own, _act(controller, env, own, target, past))
        return thrust + jnp.roll(wanted, packed.first[index])

    alive = (packed.count > 0).sum()
    thrust = jax.lax.fori_loop(0, alive, steer, jnp.zeros(slots))
    thrust = world.thrust(thrust, packed.thrust, jnp.int32(0))
    chain = world.step(_kicked(chain, packed), thrust)

    def judge(index: Array, results: tuple[Array, Array]) -> tuple[Array, Array]:
        own, target, _ = _alone(packed, chain, force, index)
        apart, good = results
        mean = distances(own, target).mean
        return apart.at[index].set(mean), good.at[index].set(reached(own, target))

    none = jnp.zeros(CHAINS), jnp.zeros(CHAINS, bool)
    apart, good = jax.lax.fori_loop(0, alive, judge, none)
    return Moved(_columns(chain.units), _columns(chain.links), thrust, apart, good)


def _chain(packed: Packed) -> Chain:
    slot = jnp.arange(len(packed.units))
    return Chain(
        units=_bodies(packed.units),
        links=_bodies(packed.links),
        rest_angle=packed.rest,
        present=slot < packed.count.sum(),
        linked=packed.linked,
        touching=jnp.zeros((), bool),
    )


def _alone(
    packed: Packed, chain: Chain, force: Array, index: Array
) -> tuple[Chain, Float[Array, "slot 2"], Float[Array, "slot 2"]]:
    """One chain in the first slots, with its target and its last forces."""
    first, count = packed.first[index], packed.count[index]
    slot = jnp.arange(len(packed.units))

    def mine(x: Array) -> Array:
        return jnp.roll(x, -first, axis=0)

    present = slot < count
    own = Chain(
        units=jax.tree.map(mine, chain.units),
        links=jax.tree.map(mine, chain.links),
        rest_angle=mine(packed.rest),
        present=present,
        linked=present[1:],
        touching=chain.touching,
    )
    return own, mine(packed.target), jnp.where(present[:, None], mine(force), 0.0)


def _act(
    controller: Controller, env: SCLD, own: Chain, target: Array, force: Array
) -> Float[Array, "slot act"]:
    """What the controller does, as it would in an episode that begins now."""
    if controller.card.control.model in SINGLE_LENGTH:
        return _act_at_one_length(controller, env, own, target, force)
    state = env.start(own, target, jr.key(0))
    return controller.act(_seeing(state, env, own, target, force))


def _seeing(state: State, env: SCLD, own: Chain, target: Array, force: Array) -> State:
    return eqx.tree_at(lambda s: s.obs, state, env.observe(own, target, force))


def _act_at_one_length(
    controller: Controller, env: SCLD, own: Chain, target: Array, force: Array
) -> Float[Array, "slot act"]:
    """The same in just as many slots as the controller has units."""
    length, slots = controller.card.length, len(target)
    env = SCLD(replace(env.config, length=length))
    own = Chain(
        units=jax.tree.map(lambda x: x[:length], own.units),
        links=jax.tree.map(lambda x: x[: length - 1], own.links),
        rest_angle=own.rest_angle[: length - 1],
        present=own.present[:length],
        linked=own.linked[: length - 1],
        touching=own.touching,
    )
    state = env.start(own, target[:length], jr.key(0))
    action = controller.act(_seeing(state, env, own, target[:length], force[:length]))
    return jnp.zeros((slots, action.shape[1])).at[:length].set(action)


def _world(packed: Packed) -> World:
    """The water and the thrusters as they are in this step."""
    working = jnp.asarray(packed.works).astype(float)
    return World(current=Uniform(packed.current), thrusters=Thrusters(gain=working))


def _kicked(chain: Chain, packed: Packed) -> Chain:
    """With the kicks of this step added to the units' velocities."""
    return eqx.tree_at(lambda c: c.units.velocity, chain, chain.units.velocity + packed.kick)


def _bodies(columns: Float[Array, "body 6"]) -> Bodies:
    return Bodies(columns[:, :2], columns[:, 2], columns[:, 3:5], columns[:, 5])


def _columns(bodies: Bodies) -> Float[Array, "body 6"]:
    parts = bodies.angle[:, None], bodies.velocity, bodies.angular_velocity[:, None]
    return jnp.concatenate([bodies.position, *parts], axis=1)
