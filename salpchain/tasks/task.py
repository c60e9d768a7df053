"""What every task is: an episode's state, and how one control step changes it.

Pure functions in the manner of Brax: `reset(key) -> State`, `step(State, action) -> State`, written
for one chain and batched with `jax.vmap`.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.checks import LONGEST
from salpchain.dynamics.robot import scale_of
from salpchain.given import instance
from salpchain.physics.batching import over_the_batch
from salpchain.physics.state import Chain, Physics, heading
from salpchain.starting import check_can_compute
from salpchain.switches import standard_promotion
from salpchain.tasks.actions import gripped, with_grips
from salpchain.tasks.checks import (
    check_chain,
    check_key,
    check_number,
    check_state,
    checked_action,
    checked_clear,
    checked_vectors,
)
from salpchain.tasks.config import ACTION_SIZES, FIXED_LIMIT, STEPS_PER_UNIT, TaskConfig
from salpchain.tasks.contract import checked_judgement, checked_move, checked_start
from salpchain.tasks.features import observation_size
from salpchain.tasks.observations import Around, observe, with_history
from salpchain.tasks.reach.reward import distances
from salpchain.tasks.reach.targets import draw, spawn
from salpchain.tasks.state import Judgement, Moment, Start, State, Terms
from salpchain.world.config import WorldConfig
from salpchain.world.randomise import as_world, draw_world, with_obstacles
from salpchain.world.sensing import Senses
from salpchain.world.world import World, of_episode
from salpchain.xla import materialise

FENCE_PER_UNIT = 0.25  # m, half the side of the fenced square for each unit of the chain
WORLD_STREAM = 2  # makes the world of an episode independent of its start
SENSE_STREAM, WATER_STREAM = 3, 4  # likewise what changes during an episode
OBSTACLE_STREAM = 5  # likewise walls and posts


class Task(eqx.Module):
    """A task: what a chain is asked to do in a world.

    A task of one's own says how an episode begins (`begin`), where the target goes (`move`), what a
    step is worth (`judge`) and how much each term weighs (`weights`).

    `world` is a `World`, the `Physics` of an otherwise still one, a `WorldConfig` from which each
    episode draws its own, or the name of one.
    """

    config: TaskConfig = eqx.field(default_factory=TaskConfig, static=True)
    world: World = eqx.field(default_factory=World, converter=as_world)

    def __check_init__(self) -> None:
        instance("config", self.config, TaskConfig, "a TaskConfig, such as card.task(length)")

    @property
    def weights(self) -> Mapping[str, float]:
        """How much each term of the reward counts; the reward is the weighted sum."""
        raise NotImplementedError

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """The chain, at rest, and its target at the start of an episode.

        `draw_key` is for the start itself, `key` for variants that leave its numbers as they are.
        """
        raise NotImplementedError

    def spawn(self, draw_key: PRNGKeyArray, length: int | Array, physics: Physics) -> Chain:
        """A straight chain at rest near the origin, in a random direction, as in the paper."""
        return spawn(draw(draw_key), self.config.length, length, physics)

    def move(self, state: State) -> tuple[Float[Array, "unit 2"], Any]:
        """The target (m) after the next control step, and what the task remembers then."""
        return state.target, state.plan

    def judge(self, before: State, after: Moment) -> Judgement:
        """What a control step was worth."""
        raise NotImplementedError

    def gauge(self, state: State) -> dict[str, Float[Array, ""]]:
        """What is read off each control step of a trial, for `measure`; nothing by default."""
        del state
        return {}

    def measure(self, series: Mapping[str, np.ndarray]) -> dict[str, float]:
        """The task's own measures of a trial, by name, from what `gauge` gave in each step.

        In NumPy, after the trial; unless overridden, the mean of each over the steps.
        """
        return {name: float(np.mean(values)) for name, values in series.items()}

    @property
    def target_stands(self) -> bool:
        """Whether the target stays where it is, so that one can say what physics allows."""
        return type(self).move is Task.move

    @property
    def physics(self) -> Physics:
        """The constants of the dynamics; those drawn for each episode are None, see `world_of`."""
        return self.world.dynamics

    def credit(self, before: State, after: State) -> Float[Array, " unit"]:
        """What each unit's own part of a step was worth more than the mean unit's, for PPO."""
        return jnp.zeros_like(after.thrust)

    def is_scored(self, state: State) -> Bool[Array, ""]:
        """Whether the episode counts among those whose success is told."""
        return jnp.ones((), bool)

    def world_of(self, state: State) -> World:
        """The world of this episode."""
        return eqx.combine(state.world, self.world)

    @property
    def action_size(self) -> int:
        """Numbers that a unit's action has."""
        return ACTION_SIZES[self.config.action]

    @property
    def _action_shape(self) -> tuple[int, int]:
        return self.config.length, self.action_size

    @property
    def observation_size(self) -> int:
        """Numbers that a unit observes."""
        return observation_size(self.config.observation)

    @standard_promotion
    def reset(self, key: PRNGKeyArray, length: int | Array | None = None) -> State:
        """A new episode: the chain at rest, every joint closed, and its target.

        A `length` below `config.length` leaves the last slots dead; it may be traced.

        Raises:
            InputError: no random key, or more than one; a length that is no whole number or has no
                room; outside `jax.jit`, a wall or a post of the world in the way of the chain.
        """
        check_can_compute()
        slots = self.config.length
        length = slots if length is None else length
        check_key(key)
        check_number(length, slots)
        return checked_clear(_in_one_program(Task._reset, self, key, length), self.world)

    def _reset(self, key: PRNGKeyArray, length: int | Array) -> State:
        draw_key, next_key = jr.split(key)
        world = self._draw_world(key, length)
        begun = self.begin(key, draw_key, length, world.dynamics)
        chain, target, plan = checked_start(self, begun)
        chain = with_grips(chain, self.config)
        return self._start(chain, target, next_key, world, plan)

    def _draw_world(self, key: PRNGKeyArray, length: int | Array) -> World:
        config = self.world.drawn_from
        return self.world if config is None else self.drawn_from(config, key, length)

    def drawn_from(self, world: WorldConfig, key: PRNGKeyArray, length: int | Array) -> World:
        """The world that the episode of this key has, where worlds are drawn from these settings;
        obstacles apart, which need its start."""
        steps, slots = self.step_limit(length), self.config.length
        key = jr.fold_in(key, WORLD_STREAM)
        return draw_world(world, key, slots, length, steps, self.world.ease)

    @standard_promotion
    def start(self, chain: Chain, target: Float[Array, "unit 2"], key: PRNGKeyArray) -> State:
        """A new episode from a chain and a target of one's own.

        Raises:
            InputError: a chain or a target with other slots than `config.length`; as `reset`.
        """
        check_can_compute()
        check_chain(chain, self.config.length)
        target = checked_vectors("the target", target, like=chain.units.position)
        check_key(key, "start")
        return checked_clear(_in_one_program(Task._begun, self, chain, target, key), self.world)

    def _begun(self, chain: Chain, target: Array, key: PRNGKeyArray) -> State:
        chain, world = with_grips(chain, self.config), self._draw_world(key, chain.present.sum())
        return self._start(chain, target, key, world, None)

    def _start(
        self, chain: Chain, target: Array, key: PRNGKeyArray, world: World, plan: Any
    ) -> State:
        world = with_obstacles(world, jr.fold_in(key, OBSTACLE_STREAM), chain, target)
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        thrust, force = jnp.zeros_like(chain.units.angle), jnp.zeros_like(target)
        now, senses = distances(chain, target, scale_of(self.physics)), None
        if world.sensing is not None:
            senses = world.sensing.start(_change_key(key, SENSE_STREAM, 0), chain, self.action_size)
        return State(
            chain=world.ready(chain),
            target=target,
            thrust=thrust,
            force=force,
            distances=now,
            start_distance=now.mean,
            time=jnp.int32(0),
            obs=self._sense(chain, senses, target, force, Around(world, 0)),
            reward=zero,
            terms=dict.fromkeys(self.weights, zero),
            terminated=no,
            truncated=no,
            invalid=no,
            key=key,
            world=of_episode(world),
            senses=senses,
            plan=plan,
        )

    @standard_promotion
    def step(self, state: State, action: Float[Array, "unit act"]) -> State:
        """The episode one control step (0.1 s) later; a finished one simply goes on (`renew_done`).

        An action that holds NaN or infinity for a unit that is present ends the episode: it is
        terminated and marked `invalid`, and the chain stops where it was.

        Raises:
            InputError: a state of many chains or of other slots, or an action of another shape.
        """
        check_state(state, "step", self.config.length)
        action = checked_action(action, self._action_shape, state.chain.units.angle)
        return _in_one_program(Task._step, self, state, action)

    def _step(self, state: State, action: Float[Array, "unit act"]) -> State:
        world, senses, time = self.world_of(state), state.senses, state.time + 1
        invalid, moving = _find_invalid(None, action, state.chain.present)
        action, senses = _given(world, senses, action, moving, state.time)
        chain, thrust, fence = self._swim(world, state, action, moving)
        force = thrust[:, None] * heading(state.chain.units.angle)
        target, plan = checked_move(self, self.move(state), state)
        now = distances(chain, target, scale_of(self.physics))
        judged = self.judge(state, Moment(chain, target, now, ~invalid))
        terms, ended = checked_judgement(self, judged)
        world, senses = _later(world, senses, chain, state.key, time)
        seen = self._sense(chain, senses, target, force, Around(world, time))
        return replace(
            state,
            chain=chain,
            target=target,
            thrust=thrust,
            force=force,
            distances=now,
            time=time,
            obs=with_history(self.config.observation, seen, state.obs),
            reward=self._reward(terms),
            terms=terms,
            terminated=ended | invalid | _at_fence(chain, fence),
            truncated=time >= self.step_limit(state.length),
            invalid=invalid,
            world=of_episode(world),
            senses=senses,
            plan=plan,
        )

    def _swim(
        self, world: World, state: State, action: Array, moving: Bool[Array, " unit"]
    ) -> tuple[Chain, Float[Array, " unit"], Any]:
        """The chain after a control step, the thrusts (N) that acted, and the fence (m)."""
        held = gripped(_with_present(state.chain, moving), action, self.config, world.dynamics)
        thrust = world.thrust(self.thrust(held, action), state.thrust, state.time)
        fence = FENCE_PER_UNIT * state.length if self.config.fence else None
        moved = world.step(held, thrust, fence, self.config.contact)
        return _with_present(moved, state.chain.present), thrust, fence

    def _reward(self, terms: Terms) -> Float[Array, ""]:
        """The weighted sum of the terms, in the order of the weights, less what time costs."""
        total = None
        for name, weight in self.weights.items():
            term = terms[name] if weight == 1.0 else weight * terms[name]
            total = term if total is None else total + term
        total = jnp.zeros(()) if total is None else total
        return total - self.config.time_weight if self.config.time_weight else total

    def _sense(
        self, chain: Chain, senses: Senses | None, target: Array, force: Array, around: Around
    ) -> Float[Array, "unit feature"]:
        sensing = around.world.sensing
        if senses is None or sensing is None:
            return self.observe(chain, target, force, around)
        return sensing.silenced(self.observe(senses.of(chain), target, force, around), senses)

    @standard_promotion
    def observe(
        self, chain: Chain, target: Array, force: Array, around: Around | None = None
    ) -> Float[Array, "unit feature"]:
        """What the units see; in still water without obstacles unless `around` says otherwise, and
        as if the steps before had been as now, where those are observed too.

        Raises:
            InputError: a chain, a target or a force of other slots than `config.length`.
        """
        check_chain(chain, self.config.length)
        like = chain.units.position
        target = checked_vectors("the target", target, like)
        force = checked_vectors("the force", force, like)
        return observe(self.config.observation, chain, target, force, around)

    def thrust(self, chain: Chain, action: Float[Array, "unit act"]) -> Float[Array, " unit"]:
        """Thrusts (N): `thrust` and `grip` clip one number to [-1, 1]; `pair` clips two, maps them
        to [0, 1] and takes forward minus backward (paper equation 9).

        Raises:
            InputError: a chain or an action of other slots than `config.length`.
        """
        check_chain(chain, self.config.length)
        action = checked_action(action, self._action_shape, chain.units.angle)
        clipped = jnp.clip(action, -1.0, 1.0)
        if self.config.action == "pair":
            thrust = (clipped[:, 0] - clipped[:, 1]) / 2
        else:
            thrust = clipped[:, 0]
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


_filter_jit: Any = eqx.filter_jit  # whose types leave out what it passes on to `jax.jit`


@partial(_filter_jit, inline=True)
def _in_one_program(method: Any, *args: Any) -> Any:
    """What the method gives; called outside `jax.jit` it is compiled as a whole, where each of its
    operations would be by itself. Within it is as if it were called."""
    return method(*args)


@over_the_batch
def _find_invalid(_: None, action: Array, present: Array) -> tuple[Array, Array]:
    """Whether the action holds NaN or infinity, and the units that move: all present or none.

    To physics, the units of an invalid chain are dead slots: it neither moves them nor lets them be
    NaN. A choice between the chains before and after would make XLA round valid ones otherwise.
    """
    invalid = jnp.any(~jnp.isfinite(action) & present[:, None], axis=(0, 1))
    return materialise((invalid, present & ~invalid), present.sum() < 0)


def _with_present(chain: Chain, present: Bool[Array, " unit"]) -> Chain:
    return eqx.tree_at(lambda c: c.present, chain, present)


def _given(
    world: World, senses: Senses | None, action: Array, moving: Array, time: Int[Array, ""]
) -> tuple[Array, Senses | None]:
    """The action that acts in a control step, and what the sensors remember of those given."""
    if world.sensing is None or senses is None:
        return action, senses
    return world.sensing.given(senses, jnp.where(moving[:, None], action, 0.0), time)


def _later(
    world: World, senses: Senses | None, chain: Chain, key: PRNGKeyArray, time: Int[Array, ""]
) -> tuple[World, Senses | None]:
    """The world after a control step, and what the sensors tell of the chain then."""
    if world.sensing is not None and senses is not None:
        senses = world.sensing.sense(_change_key(key, SENSE_STREAM, time), chain, senses)
    if world.current is not None:
        world = world.advance(_change_key(key, WATER_STREAM, time))
    return world, senses


def _change_key(key: PRNGKeyArray, stream: int, time: Array | int) -> PRNGKeyArray:
    """The key of what changes in a control step of an episode."""
    return jr.fold_in(jr.fold_in(key, stream), time)


def _at_fence(chain: Chain, fence: Any) -> Bool[Array, ""]:
    if fence is None:
        return jnp.zeros((), bool)
    out = jnp.any(jnp.abs(chain.units.position) >= fence, axis=-1)
    return jnp.any(out & chain.present)
