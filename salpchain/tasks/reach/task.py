"""The Salp Chain Locomotion Domain: a chain of thrusting units must take a target pose.

Pure functions in the manner of Brax: `reset(key) -> State`, `step(State, action) -> State`, written
for one chain and batched with `jax.vmap`. Source: paper section 3.1; DESIGN section 4.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.errors import InputError
from salpchain.forks import check_not_forked
from salpchain.given import function, instance
from salpchain.physics.batching import over_the_batch, redo, where
from salpchain.physics.chain import step
from salpchain.physics.state import Chain, Physics, heading
from salpchain.starting import check_can_compute
from salpchain.switches import automatic, standard_promotion
from salpchain.tasks.checks import (
    check_chain,
    check_key,
    check_number,
    check_state,
    checked_action,
    checked_vectors,
)
from salpchain.tasks.observations import observe
from salpchain.tasks.reach.config import (
    ACTION_SIZES,
    FIXED_LIMIT,
    LONGEST,
    OBSERVATION_SIZES,
    STEPS_PER_UNIT,
    TaskConfig,
)
from salpchain.tasks.reach.folds import folded, stalled
from salpchain.tasks.reach.reward import Distances, Terms, distances, reached, reward_terms
from salpchain.tasks.reach.targets import draw, spawn, target_pose
from salpchain.xla import once

FENCE_PER_UNIT = 0.25  # m, half the side of the fenced square for each unit of the chain


class State(eqx.Module):
    """One episode after some step, with what the last step gave."""

    chain: Chain
    target: Float[Array, "unit 2"]  # m, one point for each unit
    thrust: Float[Array, " unit"]  # N, of the last step
    force: Float[Array, "unit 2"]  # N, of the last step, as it acted, in world axes
    distances: Distances
    start_distance: Float[Array, ""]  # m, mean distance at reset
    time: Int[Array, ""]  # control steps since reset
    obs: Float[Array, "unit feature"]
    reward: Float[Array, ""]  # weighted sum of the terms
    terms: Terms
    terminated: Bool[Array, ""]  # goal reached, at the fence, or invalid: nothing follows
    truncated: Bool[Array, ""]  # out of time: the episode would have gone on
    invalid: Bool[Array, ""]  # the last action held NaN or infinity: the chain was stopped
    key: PRNGKeyArray  # of the next episode

    @property
    def done(self) -> Bool[Array, "*batch"]:
        """Whether the episode is over, for either reason."""
        return self.terminated | self.truncated

    @property
    def goal(self) -> Bool[Array, "*batch"]:
        """Whether the target pose is taken."""
        return self.terms.goal > 0

    @property
    def length(self) -> Int[Array, "*batch"]:
        """Number of units present."""
        return self.chain.present.sum(axis=-1)

    @property
    def closed_fraction(self) -> Float[Array, "*batch"]:
        """1 - mean distance now / mean distance at reset."""
        return 1.0 - self.distances.mean / self.start_distance


class SCLD(eqx.Module):
    """The domain with its settings and the constants of its physics."""

    config: TaskConfig = eqx.field(default_factory=TaskConfig, static=True)
    physics: Physics = eqx.field(default_factory=Physics)

    def __check_init__(self) -> None:
        check_not_forked()
        instance("config", self.config, TaskConfig, "a TaskConfig, such as card.task(length)")
        instance("physics", self.physics, Physics, "a Physics")

    @property
    def action_size(self) -> int:
        """Numbers that a unit's action has."""
        return ACTION_SIZES[self.config.action]

    @property
    def observation_size(self) -> int:
        """Numbers that a unit observes."""
        return OBSERVATION_SIZES[self.config.observation]

    @standard_promotion
    def reset(self, key: PRNGKeyArray, length: int | Array | None = None) -> State:
        """A new episode: the chain straight and at rest, every joint closed, a random target.

        A `length` below `config.length` leaves the last slots dead; it may be traced.

        Raises:
            InputError: no random key, or more than one; a length that is no whole number or has no
                room.
        """
        check_can_compute()
        slots = self.config.length
        length = slots if length is None else length
        check_key(key)
        check_number(length, slots)
        draw_key, next_key = jr.split(key)
        chance = draw(draw_key)
        chain = spawn(chance, slots, length)
        target = target_pose(chance, slots, length)
        if self.config.folded + self.config.stalled > 0:
            chain = self._folded(key, chain, target, length)
        return self.start(chain, target, next_key)

    def _folded(self, key: PRNGKeyArray, chain: Chain, target: Array, length: int | Array) -> Chain:
        """The chain, folded or stalled in the shares of episodes that the settings ask for."""
        which, how = jr.split(jr.fold_in(key, 1))
        chance, share = jr.uniform(which), self.config.folded
        chain = where(chance < share, folded(how, chain, length), chain)
        is_stalled = (share <= chance) & (chance < share + self.config.stalled)
        return where(is_stalled, stalled(how, chain, target, length), chain)

    @standard_promotion
    def start(self, chain: Chain, target: Float[Array, "unit 2"], key: PRNGKeyArray) -> State:
        """A new episode from a chain and a target of one's own.

        Raises:
            InputError: a chain or a target with other slots than `config.length`.
        """
        check_can_compute()
        check_chain(chain, self.config.length)
        target = checked_vectors("the target", target, like=chain.units.position)
        check_key(key, "start")
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        thrust, force = jnp.zeros_like(chain.units.angle), jnp.zeros_like(target)
        now = distances(chain, target)
        return State(
            chain=chain,
            target=target,
            thrust=thrust,
            force=force,
            distances=now,
            start_distance=now.mean,
            time=jnp.int32(0),
            obs=self.observe(chain, target, force),
            reward=zero,
            terms=Terms(zero, zero, zero),
            terminated=no,
            truncated=no,
            invalid=no,
            key=key,
        )

    @standard_promotion
    def step(self, state: State, action: Float[Array, "unit act"]) -> State:
        """The episode one control step (0.1 s) later. Goes on after its end: resetting is apart.

        An action that holds NaN or infinity for a unit that is present ends the episode: it is
        terminated and marked `invalid`, is not at the goal, and the chain stops where it was.

        Raises:
            InputError: a batch of states, a state with other slots than `config.length`, or an
                action of another shape than (unit, act).
        """
        check_can_compute()
        check_state(state, "step", self.config.length)
        shape = (self.config.length, self.action_size)
        action = checked_action(action, shape, state.chain.units.angle)
        invalid, moving = _find_invalid(None, action, state.chain.present)
        held = _with_present(state.chain, moving)
        thrust = self.thrust(held, action)
        force = thrust[:, None] * heading(state.chain.units.angle)
        fence = FENCE_PER_UNIT * state.length if self.config.fence else None
        moved = step(held, thrust, self.physics, fence, self.config.contact)
        chain = _with_present(moved, state.chain.present)
        now = distances(chain, state.target)
        goal = reached(chain, state.target, self.config.tolerance) & ~invalid
        terms = reward_terms(state.distances, now, goal)
        time = state.time + 1
        return State(
            chain=chain,
            target=state.target,
            thrust=thrust,
            force=force,
            distances=now,
            start_distance=state.start_distance,
            time=time,
            obs=self.observe(chain, state.target, force),
            reward=terms.approach + terms.goal + self.config.fine_weight * terms.fine,
            terms=terms,
            terminated=goal | invalid | _at_fence(chain, fence),
            truncated=time >= self.step_limit(state.length),
            invalid=invalid,
            key=state.key,
        )

    @standard_promotion
    def observe(self, chain: Chain, target: Array, force: Array) -> Float[Array, "unit feature"]:
        """What the units see.

        Raises:
            InputError: a chain, a target or a force of other slots than `config.length`.
        """
        check_chain(chain, self.config.length)
        like = chain.units.position
        target = checked_vectors("the target", target, like)
        force = checked_vectors("the force", force, like)
        return observe(self.config.observation, chain, target, force)

    def thrust(self, chain: Chain, action: Float[Array, "unit act"]) -> Float[Array, " unit"]:
        """Thrusts (N): `thrust` clips one number to [-1, 1]; `pair` clips two, maps them to [0, 1]
        and takes forward minus backward (paper equation 9).

        Raises:
            InputError: a chain or an action of other slots than `config.length`.
        """
        check_chain(chain, self.config.length)
        shape = (self.config.length, self.action_size)
        action = checked_action(action, shape, chain.units.angle)
        clipped = jnp.clip(action, -1.0, 1.0)
        if self.config.action == "thrust":
            thrust = clipped[:, 0]
        else:
            thrust = (clipped[:, 0] - clipped[:, 1]) / 2
        return jnp.where(chain.present, thrust, 0.0)

    def step_limit(self, length: int | Array) -> Int[Array, ""] | int:
        """Control steps until truncation; traceable twin of `config.step_limit`.

        Raises:
            InputError: no whole number of units.
        """
        check_number(length, LONGEST)
        if self.config.most_steps:
            return self.config.most_steps
        if self.config.time_limit == "fixed":
            return FIXED_LIMIT
        return jnp.maximum(FIXED_LIMIT, STEPS_PER_UNIT * length)


@over_the_batch
def _find_invalid(_: None, action: Array, present: Array) -> tuple[Array, Array]:
    """Whether the action holds NaN or infinity, and the units that move: all present or none.

    To physics, the units of an invalid chain are dead slots: it neither moves them nor lets them be
    NaN. A choice between the chains before and after would make XLA round valid ones otherwise.
    """
    invalid = jnp.any(~jnp.isfinite(action) & present[:, None], axis=(0, 1))
    return once((invalid, present & ~invalid), present.sum() < 0)


def _with_present(chain: Chain, present: Bool[Array, " unit"]) -> Chain:
    return eqx.tree_at(lambda c: c.present, chain, present)


def _at_fence(chain: Chain, fence: Any) -> Bool[Array, ""]:
    if fence is None:
        return jnp.zeros((), bool)
    out = jnp.any(jnp.abs(chain.units.position) >= fence, axis=-1)
    return jnp.any(out & chain.present)


RENEWED_AT_ONCE = 32  # a chunk of finished episodes is at most this part of the batch (chosen)


LENGTH_STREAM = 1  # sets the draw of an episode's length apart from that of its start

DrawLength = Callable[[PRNGKeyArray], Int[Array, ""]]


@standard_promotion
def renew_done(env: SCLD, states: State, draw_length: DrawLength | None = None) -> State:
    """A batch of states (batch first) with every finished episode replaced by a new one.

    The others stay bit-identical. Only as many resets are computed as there are finished
    episodes, in small chunks; each has its own key, so no start comes twice. `draw_length` gives
    the number of units of a new episode; without it a chain keeps its length.

    Raises:
        InputError: no environment, or no batch of its states.
    """
    instance("env", env, SCLD, "a salpchain.SCLD")
    instance("states", states, State, "a batch of states, such as jax.vmap(env.reset)(keys)")
    function("draw_length", draw_length)
    if states.obs.ndim != 3 or states.obs.shape[1] != env.config.length:
        raise InputError(
            f"renew_done takes a batch of states of {env.config.length} slots, batch first, such as"
            f" jax.vmap(env.reset)(keys), got observations of shape {states.obs.shape}"
        )
    return automatic(partial(_renewed, env, draw_length), (states,))


def _renewed(env: SCLD, draw_length: DrawLength | None, states: State) -> State:
    batch = states.time.shape[0]

    def renew(chosen: Int[Array, " some"]) -> State:
        keys = states.key[chosen]
        if draw_length is None:
            return jax.vmap(env.reset)(keys, states.length[chosen])
        apart = jax.vmap(lambda key: jr.fold_in(key, LENGTH_STREAM))(keys)
        return jax.vmap(env.reset)(keys, jax.vmap(draw_length)(apart))

    return redo(states.done, states, renew, min(batch, max(4, batch // RENEWED_AT_ONCE)))
