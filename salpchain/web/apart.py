"""A chain that takes itself apart: what its planner remembers, and its part of a compiled step."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Float

from salpchain.controllers.policy import Controller, Planner
from salpchain.physics.docking import dockable
from salpchain.physics.sizes import LINK_LENGTH
from salpchain.physics.state import Chain, Physics, at_rest, heading
from salpchain.tasks.actions import gripped
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.parting.course import Course, is_whole
from salpchain.tasks.reach.reward import reached
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State

SHARPEST = 0.4  # rad, from link to link, of a pose in which pieces join; sharper is out of reach
SETTLED = 10  # control steps for which a target stays before the way to it is planned (chosen)


class Trip(NamedTuple):
    """One chain on its way through an opening, in as many slots as a program has; NumPy or JAX."""

    linked: Any  # (gap,)
    rest: Any  # (gap, 2) rad
    slack: Any  # (gap,) m, of joints that are closing
    twist: Any  # (gap,) rad
    target: Any  # (slot, 2) m, when the way was planned
    goal: Any  # (slot, 2) m, where the pieces join
    lane: Any  # (1, 2, 2) m, before the opening and behind it
    width: Any  # () m, of the opening
    begins: Any  # () whether nothing is planned yet
    memory: Any  # of the planner
    whole: Any  # () whether it is one chain, every joint shut
    there: Any  # () whether it has taken its goal


def is_planner(controller: Controller) -> bool:
    """Whether it takes chains apart."""
    return isinstance(controller, Planner) and controller.card.action == "grip"


def below(controller: Controller) -> Controller:
    """What steers chains that have no opening to pass: the policy below a planner."""
    return controller.guide if is_planner(controller) else controller  # type: ignore[attr-defined]


def empty(controller: Controller, slots: int) -> Trip:
    """A trip of no chain, in arrays of the right shapes and types."""
    gap, f = slots - 1, np.float32
    trip = Trip(
        linked=np.zeros(gap, bool),
        rest=np.zeros((gap, 2), f),
        slack=np.zeros(gap, f),
        twist=np.zeros(gap, f),
        target=np.zeros((slots, 2), f),
        goal=np.zeros((slots, 2), f),
        lane=np.array([[[-1.0, 0.0], [1.0, 0.0]]], f),
        width=np.ones((), f),
        begins=np.ones((), bool),
        memory=(),
        whole=np.ones((), bool),
        there=np.zeros((), bool),
    )
    chain = at_rest(jnp.zeros((slots, 2)), jnp.zeros(slots))
    memory = jax.eval_shape(
        lambda: _begun(controller, _state(controller, chain, jnp.zeros(slots), trip))
    )
    return trip._replace(memory=jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), memory))


def joinable(target: Float[np.ndarray, "unit 2"]) -> Float[np.ndarray, "unit 2"]:
    """The target pose (m), or a line in its place where it bends too sharply for pieces to join."""
    steps = np.diff(target, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    if np.abs(turns).max(initial=0.0) <= SHARPEST:
        return target
    along = target[-1] - target[0]
    along = along if np.hypot(*along) > LINK_LENGTH else steps[len(steps) // 2]
    place = LINK_LENGTH * (np.arange(len(target)) - (len(target) - 1) / 2)
    return target.mean(axis=0) + place[:, None] * along / np.hypot(*along)


def set_out(
    controller: Controller, slots: int, rest: Any, target: Any, lane: Any, width: Any
) -> Trip:
    """The trip of a chain with these rest angles (rad), to a target by a lane (m)."""
    trip = empty(controller, slots)
    trip.rest[: len(rest)], trip.linked[: len(rest)] = rest, True
    trip.target[: len(target)], trip.goal[: len(target)] = target, joinable(target)
    trip.lane[0], trip.width[()] = lane, width
    return trip


def dressed(chain: Chain, trip: Trip) -> Chain:
    """The chain with its joints as they are on the trip."""
    chain = dockable(chain)
    return eqx.tree_at(
        lambda c: (c.linked, c.rest_angle, c.docking.slack, c.docking.twist),
        chain,
        (trip.linked, trip.rest, trip.slack, trip.twist),
    )


def planned(
    controller: Controller, chain: Chain, told: Chain, before: Array, physics: Physics, trip: Trip
) -> tuple[Float[Array, " slot"], Chain, Any]:
    """Thrusts (N) that the planner asks for of a chain as its sensors tell it, the chain after its
    units let go and took hold, and what the planner remembers; `before` are the last thrusts."""
    state = _state(controller, told, before, trip)
    new = _begun(controller, state)
    memory = jax.tree.map(lambda a, b: jnp.where(trip.begins, a, b), new, trip.memory)
    action, memory = controller.plan(state, memory)  # type: ignore[attr-defined]
    env = _env(controller, len(before))
    chain = gripped(chain, action, env.config, physics)
    return env.thrust(chain, action), chain, memory


def later(trip: Trip, chain: Chain, memory: Any) -> Trip:
    """The trip after a step that has led to this chain."""
    docking: Any = chain.docking
    return trip._replace(
        linked=chain.linked,
        rest=chain.rest_angle,
        slack=docking.slack,
        twist=docking.twist,
        begins=jnp.zeros((), bool),
        memory=memory,
        whole=is_whole(chain),
        there=reached(chain, trip.goal),
    )


def _env(controller: Controller, slots: int) -> SCLD:
    return SCLD(TaskConfig(slots, controller.card.observation, "grip"))


def _state(controller: Controller, told: Chain, before: Array, trip: Trip) -> State:
    """What the planner is shown."""
    state = _env(controller, len(before)).start(told, jnp.asarray(trip.goal), jr.key(0))
    course = Course(jnp.asarray(trip.lane), jnp.asarray(trip.width), jnp.int32(0))
    force = before[:, None] * heading(told.units.angle)
    return eqx.tree_at(
        lambda s: (s.plan, s.force), state, (course, force), is_leaf=lambda x: x is None
    )


def _begun(controller: Controller, state: State) -> Any:
    return controller.begin(state)  # type: ignore[attr-defined]
