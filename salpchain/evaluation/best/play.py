"""Solutions replayed in the engine: where thrusts of one's own lead from one of the starts."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.controllers.policy import PolicyCard
from salpchain.errors import InputError
from salpchain.evaluation.best import starts
from salpchain.evaluation.best.solutions import Offer, Solution
from salpchain.evaluation.recording import record
from salpchain.evaluation.starts import start_keys
from salpchain.evaluation.trajectory import Trajectory
from salpchain.physics.chain import step
from salpchain.physics.state import Chain, at_rest
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig
from salpchain.tasks.reach.reward import reached
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State

MARGIN = 0.001  # m, closer than the goal asks that a solution must come to be added (chosen)
WOBBLE = 1e-5  # m, by which a start is moved to see whether a swim holds (chosen)
WOBBLES = 8  # how many such starts it must hold from (chosen)
ROOM = 64  # control steps by which the room for thrusts grows, so that programs are shared (chosen)
SLOTS = (8, 32)  # of compiled programs, which lengths share
SAME = 1e-5  # m, between the stored starts and those that are drawn here


Place = tuple[int, int]  # a length and the number of one of its starts


class Replay(NamedTuple):
    """What came of swims."""

    steps: Int[np.ndarray, " swim"]  # control steps until the goal; 0 of those that missed it
    nearest: Float[np.ndarray, " swim"]  # m, largest distance of a unit from its point, at best


def replay(
    places: Sequence[Place],
    thrusts: Sequence[Float[np.ndarray, "_ _"]],
    tolerance: float = GOAL_LIMIT,
    moved: float = 0.0,
) -> Replay:
    """Swims of thrusts (N), (step, unit), from these starts, until the goal or their last step.

    `tolerance` (m) is the Frechet distance at which the target counts as taken. `moved` (m): by how
    much each unit is moved at the start, at random (standard deviation along either axis).
    """
    slots = next(slots for slots in SLOTS if slots >= max(length for length, _ in places))
    longest = max(len(one) for one in thrusts)
    room = np.zeros((len(places), -(-longest // ROOM) * ROOM, slots), np.float32)
    for place, one in zip(room, thrusts, strict=True):
        place[: len(one), : one.shape[1]] = one
    lasts = jnp.array([len(one) for one in thrusts])
    chains, targets = poses(places, slots)
    if moved:
        chains = nudged(chains, moved, jax.random.key(len(places)))
    steps, nearest = play(tolerance, chains, targets, jnp.asarray(room), lasts)
    return Replay(np.asarray(steps), np.asarray(nearest))


def holds(
    places: Sequence[Place], thrusts: Sequence[Float[np.ndarray, "_ _"]]
) -> Bool[np.ndarray, " swim"]:
    """Whether the same thrusts take the target from `WOBBLES` starts moved by `WOBBLE` too.

    Joints that chatter and units that touch drive two swims apart that begin a hair apart. What
    does not hold here may miss on another machine, whose last decimals differ.
    """
    every = [one for one in places for _ in range(WOBBLES)]
    pushes = [one for one in thrusts for _ in range(WOBBLES)]
    steps = replay(every, pushes, GOAL_LIMIT, WOBBLE).steps
    return steps.reshape(len(places), WOBBLES).min(axis=1) > 0


def nudged(chains: Chain, size: float, key: PRNGKeyArray) -> Chain:
    """The chains with each unit moved at random by about `size` (m)."""
    position = chains.units.position
    moved = position + size * jax.random.normal(key, position.shape)
    return eqx.tree_at(lambda chain: chain.units.position, chains, moved)


@partial(jax.jit, static_argnums=0)
def play(
    tolerance: float, chains: Chain, target: Array, thrusts: Array, lasts: Array
) -> tuple[Array, Array]:
    """Steps to the goal and nearest distance of each swim; all arrays have the swim first."""

    def going(now: tuple[Any, ...]) -> Bool[Array, ""]:
        _, time, steps, _ = now
        return ((steps == 0) & (time < lasts)).any()

    def advance(now: tuple[Any, ...]) -> tuple[Any, ...]:
        chains, time, steps, nearest = now
        chains = jax.vmap(step)(chains, jax.lax.dynamic_index_in_dim(thrusts, time, 1, False))
        there = jax.vmap(partial(reached, tolerance=tolerance))(chains, target)
        counts = (steps == 0) & (time < lasts)
        off = jnp.linalg.norm(chains.units.position - target, axis=-1)
        farthest = jnp.where(chains.present, off, 0.0).max(axis=-1)
        nearest = jnp.where(counts, jnp.minimum(nearest, farthest), nearest)
        return chains, time + 1, jnp.where(counts & there, time + 1, steps), nearest

    swims = len(lasts)
    first = chains, jnp.int32(0), jnp.zeros(swims, jnp.int32), jnp.full(swims, jnp.inf)
    return jax.lax.while_loop(going, advance, first)[2:]


def poses(places: Sequence[Place], slots: int) -> tuple[Chain, Float[Array, "swim unit 2"]]:
    """Chains at rest at these starts, and their targets (m); slots beyond a length are dead."""
    position, target = np.zeros((2, len(places), slots, 2), np.float32)
    angle = np.zeros(len(places), np.float32)
    for i, (length, start) in enumerate(places):
        some = starts.load(length)
        position[i, :length], target[i, :length] = some.position[start], some.target[start]
        angle[i] = some.angle[start]
    present = jnp.arange(slots) < jnp.array([length for length, _ in places])[:, None]
    angles = jnp.broadcast_to(jnp.asarray(angle)[:, None], present.shape)
    chains = jax.vmap(at_rest)(jnp.asarray(position), angles, present, present[:, 1:])
    return chains, jnp.asarray(target)


def judged(offer: Offer) -> Offer:
    """What is offered, without the steps after the goal.

    Raises:
        InputError: it does not come `MARGIN` closer to the target than the goal asks, or misses
            from starts moved by ten micrometres.
    """
    thrusts = offer.solution.newtons
    found = replay([(offer.length, offer.start)], [thrusts], GOAL_LIMIT - MARGIN)
    steps, nearest = int(found.steps[0]), 100 * float(found.nearest[0])
    if not steps:
        raise InputError(
            f"start {offer.start} of {offer.length} units: the target is not taken within"
            f" {len(thrusts)} steps: at best a unit was {nearest:.2f} cm from its point"
            f" (all must come within {100 * (GOAL_LIMIT - MARGIN):.2f} cm)"
        )
    if not holds([(offer.length, offer.start)], [thrusts[:steps]])[0]:
        raise InputError(
            f"start {offer.start} of {offer.length} units: the target is taken in {steps} steps,"
            f" but not from each of {WOBBLES} starts whose units are moved by ten micrometres, and"
            " so may be missed on another machine"
        )
    return offer.shortened(steps)


def draw() -> dict[int, starts.Starts]:
    """The starts as the task draws them."""
    return {length: _drawn(length) for length in starts.LENGTHS}


def _drawn(length: int) -> starts.Starts:
    keys = start_keys(starts.SEED, length, jnp.arange(starts.STARTS))
    state = jax.jit(jax.vmap(SCLD(TaskConfig(length=length)).reset))(keys)
    units = state.chain.units
    return starts.Starts(*map(np.asarray, (units.position, units.angle[:, 0], state.target)))


class Known(eqx.Module):
    """A controller that does what a solution says, whatever it sees; afterwards nothing."""

    thrusts: Float[Array, "step unit"]  # N

    @property
    def card(self) -> PolicyCard:
        """Speaks the plainest observation, and reads none of it."""
        return PolicyCard(name="best-known", length=self.thrusts.shape[1])

    def act(self, state: State) -> Float[Array, "unit 1"]:
        """The thrusts of this control step."""
        steps, units = self.thrusts.shape
        now = self.thrusts[jnp.minimum(state.time, steps - 1)]
        now = jnp.pad(now, (0, state.thrust.shape[0] - units))
        return jnp.where(state.time < steps, now, 0.0)[:, None]


def swim(length: int, start: int, solution: Solution) -> Trajectory:
    """The swim of a solution, every body at every step, with the task as the judge.

    Raises:
        InputError: the start that is drawn here is not the stored one.
    """
    controller = Known(jnp.asarray(solution.newtons))
    (made,) = record(controller, length, seed=starts.SEED, trial=start)
    stored = starts.load(length)
    apart = np.abs(made.unit_position[0] - stored.position[start]).max()
    if max(apart, np.abs(made.target - stored.target[start]).max()) > SAME:
        raise InputError("this version of JAX draws other starts than those that are stored")
    return made
