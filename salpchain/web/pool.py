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
from jaxtyping import Array, Bool, Float

from salpchain.controllers.policy import Controller
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.physics.state import Bodies, Chain, heading
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import remembered_size
from salpchain.tasks.observations import Around, with_history
from salpchain.tasks.reach.reward import distances, reached
from salpchain.tasks.reach.task import SCLD
from salpchain.web import apart
from salpchain.web.memory import kept, remembered, width
from salpchain.web.tank import MOST_UNITS
from salpchain.world.current import Sum, Uniform
from salpchain.world.sensing import Senses
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World, of_episode

SLOTS = (64, MOST_UNITS)  # units of all chains together, of a compiled step (chosen)
CHAINS = 6  # that swim at once (chosen)


class Packed(NamedTuple):
    """All chains one after the other in as many slots as a program has; NumPy or JAX."""

    units: Any  # (slot, 6) x, y, angle and their rates
    links: Any  # (gap, 6)
    rest: Any  # (gap, 2)
    linked: Any  # (gap,)
    target: Any  # (slot, 2)
    thrust: Any  # (slot,) of the last step (N)
    gain: Any  # (slot,) of the thruster; 0 where it is off
    kick: Any  # (slot, 2) m/s, added to a unit's velocity once
    current: Any  # (2,) m/s, of the water besides the world's
    memory: Any  # (slot, number) of faulty sensors
    begins: Any  # (slot,) whether a unit's sensors begin
    seen: Any  # (slot, feature) what the controller was shown in the step before
    starts: Any  # (slot,) whether it was shown nothing yet
    time: Any  # control steps since the reset
    seed: Any  # (2,) data of the key of what changes in time
    first: Any  # (chain,) slot of each chain's first unit
    count: Any  # (chain,) its units; 0 where there is no chain
    trip: Any = None  # of the one chain, where a planner takes it apart


class Moved(NamedTuple):
    """The chains one control step later."""

    units: Any  # (slot, 6)
    links: Any  # (gap, 6)
    thrust: Any  # (slot,)
    memory: Any  # (slot, number)
    seen: Any  # (slot, feature)
    water: Any  # arrays of the world's own current
    distance: Any  # (chain,) m, mean, to the target
    reached: Any  # (chain,)
    trip: Any = None


class Pool:
    """Compiled steps by kind of controller and number of slots; several threads may use it."""

    def __init__(self) -> None:
        """Nothing is compiled yet."""
        self._compiled: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def prepare(self, controller: Controller, slots: int, world: World | None = None) -> None:
        """Compiles the step of such controllers in such a world, unless that was done."""
        world = world or World()
        key = _key(controller, slots, world)
        if key in self._compiled:
            return
        with self._lock:
            if key not in self._compiled:
                weights, rest = eqx.partition(controller, eqx.is_array)
                fixed = eqx.filter(world, eqx.is_array, inverse=True)
                packed = empty(slots, world, controller.card.observation)
                if apart.is_planner(controller):
                    packed = packed._replace(trip=apart.empty(controller, slots))
                work = jax.jit(partial(_advance, rest, fixed)).lower(
                    weights, _arrays(world), packed
                )
                self._compiled[key] = work.compile()

    def advance(self, controller: Controller, packed: Packed, world: World | None = None) -> Moved:
        """The chains in this world one control step later, as NumPy arrays."""
        world, slots = world or World(), len(packed.units)
        self.prepare(controller, slots, world)
        weights, _ = eqx.partition(controller, eqx.is_array)
        step = self._compiled[_key(controller, slots, world)]
        return jax.tree.map(np.asarray, step(weights, _arrays(world), packed))


def _arrays(world: World) -> World:
    """What is drawn for each world, as data of the compiled step."""
    return jax.tree.map(np.asarray, of_episode(world))


def _key(controller: Controller, slots: int, world: World) -> Any:
    """Controllers of one kind, and worlds of one, share a program: weights are data."""
    card = controller.card
    shapes = [(x.shape, x.dtype) for x in jax.tree.leaves(controller) if eqx.is_array(x)]
    own = card.length if card.control.model in SINGLE_LENGTH else 0
    kind = type(controller), card.control, card.observation, card.action, own
    fixed, tree = jax.tree.flatten(eqx.filter(world, eqx.is_array, inverse=True))
    return kind, tuple(shapes), slots, tuple(fixed), tree


def slots_for(units: int) -> int:
    """The smallest program that holds so many units."""
    return next(slots for slots in SLOTS if slots >= units)


def empty(slots: int, world: World, observation: str) -> Packed:
    """No chains, in arrays of the right shapes and types for a world and an observation."""
    gap, f = slots - 1, np.float32
    return Packed(
        units=np.zeros((slots, 6), f),
        links=np.zeros((gap, 6), f),
        rest=np.zeros((gap, 2), f),
        linked=np.zeros(gap, bool),
        target=np.zeros((slots, 2), f),
        thrust=np.zeros(slots, f),
        gain=np.zeros(slots, f),
        kick=np.zeros((slots, 2), f),
        current=np.zeros(2, f),
        memory=np.zeros((slots, width(world.sensing)), f),
        begins=np.ones(slots, bool),
        seen=np.zeros((slots, remembered_size(observation)), f),
        starts=np.ones(slots, bool),
        time=np.zeros((), np.int32),
        seed=np.zeros(2, np.uint32),
        first=np.zeros(CHAINS, np.int32),
        count=np.zeros(CHAINS, np.int32),
    )


def _advance(rest: Any, fixed: Any, weights: Any, arrays: Any, packed: Packed) -> Moved:
    """Each chain is steered by itself; then all of them move together and may touch."""
    controller, drawn = eqx.combine(weights, rest), eqx.combine(arrays, fixed)
    world, chain = _world(packed, drawn), _chain(packed)
    keys = jr.split(jr.fold_in(jr.wrap_key_data(packed.seed), packed.time), 3)
    senses = remembered(world.sensing, keys[0], chain, packed.memory, packed.begins)
    told = chain if senses is None else senses.of(chain)
    memory, trip, seen = None, packed.trip, packed.seen
    if trip is None:
        thrust, seen = _asked(controller, world, packed, told, senses)
    else:
        thrust, chain, memory = apart.planned(
            controller, chain, told, packed.thrust, world.dynamics, trip
        )
    if world.sensing is not None and senses is not None:
        asked, senses = world.sensing.given(senses, thrust[:, None], packed.time)
        thrust = asked[:, 0]
    thrust = world.thrust(thrust, packed.thrust, packed.time)
    chain = world.step(_kicked(chain, packed), thrust)
    if world.sensing is not None and senses is not None:
        senses = world.sensing.sense(keys[1], chain, senses)
    away, good = _judged(packed, chain)
    trip = None if trip is None else apart.later(trip, chain, memory)
    return Moved(
        units=_columns(chain.units),
        links=_columns(chain.links),
        thrust=thrust,
        memory=kept(senses, len(packed.units)),
        seen=seen,
        water=of_episode(drawn.advance(keys[2])).current,
        distance=away,
        reached=good if trip is None else good & trip.whole,
        trip=trip,
    )


def _asked(
    controller: Controller, world: World, packed: Packed, told: Chain, senses: Senses | None
) -> tuple[Float[Array, " slot"], Float[Array, "slot feature"]]:
    """The thrusts (N) that the controller asks for, of each chain as its sensors tell it, and what
    of that it is shown again in the next step."""
    card, slots = controller.card, len(packed.units)
    env = SCLD(TaskConfig(slots, card.observation, card.action))
    force = packed.thrust[:, None] * heading(_bodies(packed.units).angle)
    silent = jnp.zeros(slots, bool) if senses is None else senses.dropped > 0

    def steer(index: Array, asked: tuple[Array, Array]) -> tuple[Array, Array]:
        first, (thrust, shown) = packed.first[index], asked
        own = View(
            *_alone(packed, told, force, index),
            *(jnp.roll(x, -first, 0) for x in (packed.gain, silent, packed.seen, packed.starts)),
        )
        action, seen = _act(controller, env, own, world, packed.time)
        wanted = env.thrust(own.chain, action)
        mine = jnp.roll(own.chain.present, first)[:, None]
        return thrust + jnp.roll(wanted, first), jnp.where(mine, jnp.roll(seen, first, 0), shown)

    nothing = jnp.zeros(slots), jnp.zeros_like(packed.seen)
    return jax.lax.fori_loop(0, (packed.count > 0).sum(), steer, nothing)


def _judged(packed: Packed, chain: Chain) -> tuple[Array, Array]:
    """How far each chain is from its target (m, mean), and whether it has taken it."""
    force = jnp.zeros_like(packed.target)

    def judge(index: Array, results: tuple[Array, Array]) -> tuple[Array, Array]:
        own, target, _ = _alone(packed, chain, force, index)
        away, good = results
        mean = distances(own, target).mean
        return away.at[index].set(mean), good.at[index].set(reached(own, target))

    none = jnp.zeros(CHAINS), jnp.zeros(CHAINS, bool)
    return jax.lax.fori_loop(0, (packed.count > 0).sum(), judge, none)


def _chain(packed: Packed) -> Chain:
    slot = jnp.arange(len(packed.units))
    chain = Chain(
        units=_bodies(packed.units),
        links=_bodies(packed.links),
        rest_angle=packed.rest,
        present=slot < packed.count.sum(),
        linked=packed.linked,
        touching=jnp.zeros((), bool),
    )
    return chain if packed.trip is None else apart.dressed(chain, packed.trip)


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


class View(NamedTuple):
    """One chain in the first slots, as its sensors tell it."""

    chain: Chain
    target: Float[Array, "slot 2"]  # m
    force: Float[Array, "slot 2"]  # N, of the last step
    gain: Float[Array, " slot"]  # of each thruster
    silent: Bool[Array, " slot"]  # whether a unit's readings are dropped
    seen: Float[Array, "slot feature"]  # what the controller was shown before
    starts: Bool[Array, " slot"]  # whether it was shown nothing yet


def _act(
    controller: Controller, env: SCLD, own: View, world: World, time: Array
) -> tuple[Float[Array, "slot act"], Float[Array, "slot feature"]]:
    """What the controller does, as it would in an episode that begins now but for what it was shown
    before; and what it is shown, if that is shown again."""
    slots, name = env.config.length, env.config.observation
    if controller.card.control.model in SINGLE_LENGTH:
        env = SCLD(replace(env.config, length=controller.card.length))
        own = _shortened(own, env.config.length)
    state = env.start(own.chain, own.target, jr.key(0))
    thrusters = replace(world.thrusters or Thrusters(), gain=own.gain)
    around = Around(replace(world, thrusters=thrusters), time)
    obs = env.observe(own.chain, own.target, own.force, around)
    now = jnp.where(own.silent[:, None], 0.0, obs)
    obs = now
    if own.seen.shape[1]:
        obs = jnp.where(own.starts[:, None], now, with_history(name, now, own.seen))
    action = controller.act(eqx.tree_at(lambda s: s.obs, state, obs))
    seen = jnp.zeros((slots, own.seen.shape[1]))
    if own.seen.shape[1]:
        seen = seen.at[: len(obs)].set(obs)
    return jnp.zeros((slots, action.shape[1])).at[: len(action)].set(action), seen


def _shortened(own: View, length: int) -> View:
    """The same in just as many slots as the controller has units."""
    chain = own.chain
    short = Chain(
        units=jax.tree.map(lambda x: x[:length], chain.units),
        links=jax.tree.map(lambda x: x[: length - 1], chain.links),
        rest_angle=chain.rest_angle[: length - 1],
        present=chain.present[:length],
        linked=chain.linked[: length - 1],
        touching=chain.touching,
    )
    return View(short, *(x[:length] for x in own[1:]))


def _world(packed: Packed, drawn: World) -> World:
    """The drawn world with the water and the thrusters as they are in this step."""
    current = Uniform(packed.current)
    thrusters = replace(drawn.thrusters or Thrusters(), gain=jnp.asarray(packed.gain))
    flow = current if drawn.current is None else Sum((current, drawn.current))
    return replace(drawn, current=flow, thrusters=thrusters)


def _kicked(chain: Chain, packed: Packed) -> Chain:
    """With the kicks of this step added to the units' velocities."""
    return eqx.tree_at(lambda c: c.units.velocity, chain, chain.units.velocity + packed.kick)


def _bodies(columns: Float[Array, "body 6"]) -> Bodies:
    return Bodies(columns[:, :2], columns[:, 2], columns[:, 3:5], columns[:, 5])


def _columns(bodies: Bodies) -> Float[Array, "body 6"]:
    parts = bodies.angle[:, None], bodies.velocity, bodies.angular_velocity[:, None]
    return jnp.concatenate([bodies.position, *parts], axis=1)
