"""Chains that swim under the sampled policy, and what PPO needs to know of it."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.devices import AXIS, largest_divisor
from salpchain.networks.actor_critic import ActorCritic
from salpchain.tasks.observations import Around, observe
from salpchain.tasks.renew import DrawLength, renew_done
from salpchain.tasks.state import State, Terms
from salpchain.tasks.task import Task
from salpchain.training.widths import CACHED_ROWS, at_width, by_length


class Sample(eqx.Module):
    """What an update learns from: one chain at one step."""

    obs: Float[Array, "unit inputs"]
    present: Bool[Array, " unit"]
    joined: Bool[Array, " link"]
    action: Float[Array, "unit act"]  # as sampled, before clipping
    log_prob: Float[Array, " unit"]
    value: Float[Array, ""]
    known: Float[Array, "unit known"] | None = None  # what the critic observes, if it is its own
    begins: Bool[Array, ""] | None = None  # whether its episode does, where units remember


Memory = Float[Array, "env unit 128"] | None  # what the units remember, if they do


class Outcome(eqx.Module):
    """What a step gave."""

    reward: Float[Array, ""]
    own: Float[Array, " unit"]  # what each unit's own progress differs by from the mean unit's
    terms: Terms
    terminated: Bool[Array, ""]
    truncated: Bool[Array, ""]
    goal: Bool[Array, ""]
    is_scored: Bool[Array, ""]  # false for episodes that start on their target (`stalled` may)
    final_value: Float[Array, ""]  # of the true last observation, where truncated
    closed: Float[Array, ""]  # closed fraction
    metres: Float[Array, ""]  # mean distance closed since reset, m
    time: Array  # control steps since reset
    length: Array  # units


def collect(
    env: Task,
    policy: ActorCritic,
    states: State,
    key: PRNGKeyArray,
    steps: int,
    draw_length: DrawLength | None = None,
    widths: Sequence[int] = (),
    memory: Memory = None,
) -> tuple[State, Memory, Sample, Outcome]:
    """`steps` control steps of every chain (batch first), finished episodes renewed.

    Returns states and memory after them, and samples and outcomes with axes (step, env). What a
    chain does follows from its number among those of all devices, not from the device that it is
    on. `widths`: as in `widths_of`, where lengths are mixed.
    """
    num = states.time.shape[0]
    numbers = jax.lax.axis_index(AXIS) * num + jnp.arange(num)

    def advance(now: tuple[State, Memory], key: PRNGKeyArray) -> tuple[Any, tuple[Sample, Outcome]]:
        states, memory = now
        keys = jax.vmap(jr.fold_in, (None, 0))(key, numbers)
        known = _known(env, policy, states)
        mean, value, memory = _tell(policy, states, widths, known, memory)
        sample = jax.vmap(partial(_sample, policy))(states, mean, value, keys, known)
        after = jax.vmap(env.step)(states, sample.action)
        final = _final_value(env, policy, after, memory)
        outcome = jax.vmap(partial(_outcome, env))(states, after, final)
        return (renew_done(env, after, draw_length), memory), (sample, outcome)

    now, (samples, outcomes) = jax.lax.scan(advance, (states, memory), jr.split(key, steps))
    return *now, samples, outcomes


def _outcome(env: Task, before: State, after: State, final_value: Float[Array, ""]) -> Outcome:
    return Outcome(
        reward=after.reward,
        own=env.credit(before, after),
        terms=after.terms,
        terminated=after.terminated,
        truncated=after.truncated & ~after.terminated,
        goal=after.goal,
        is_scored=env.is_scored(after),
        final_value=final_value,
        closed=after.closed_fraction,
        metres=after.start_distance - after.distances.mean,
        time=after.time,
        length=after.length,
    )


def _known(env: Task, policy: ActorCritic, states: State) -> Float[Array, "env unit known"] | None:
    """What the critic observes, if that is something of its own: how things truly are."""
    if not policy.critic_observes:
        return None

    def of_one(state: State) -> Float[Array, "unit known"]:
        around = Around(env.world_of(state), state.time)
        return observe(policy.critic_observes, state.chain, state.target, state.force, around)

    return jax.vmap(of_one)(states)


def _tell(
    policy: ActorCritic,
    states: State,
    widths: Sequence[int],
    known: Float[Array, "env unit known"] | None = None,
    memory: Memory = None,
) -> tuple[Float[Array, "env unit act"], Float[Array, " env"], Memory]:
    """The mean actions and the value of each chain, and what its units remember after it."""
    if policy.recall is not None:
        assert memory is not None
        return jax.vmap(partial(remember, policy))(*_seen(states), memory, known, states.time == 0)
    return *_react(policy, states, widths, known), None


def _seen(states: State) -> tuple[Array, Array, Array]:
    """What a network is given of each chain."""
    return jax.vmap(lambda s: (s.obs, s.chain.present, s.chain.joined))(states)


def remember(
    policy: Any,
    obs: Float[Array, "unit inputs"],
    present: Bool[Array, " unit"],
    joined: Bool[Array, " link"],
    memory: Float[Array, "unit 128"],
    known: Float[Array, "unit known"] | None,
    begins: Any,
) -> tuple[Float[Array, "unit act"], Float[Array, ""], Float[Array, "unit 128"]]:
    """Mean action, value and memory of a chain, which has none where its episode begins."""
    memory = jnp.where(begins, 0.0, memory)
    return policy.remember(obs, present, joined, memory, known=known)


def _react(
    policy: ActorCritic,
    states: State,
    widths: Sequence[int],
    known: Float[Array, "env unit known"] | None,
) -> tuple[Float[Array, "env unit act"], Float[Array, " env"]]:
    """The mean actions and the value of each chain, whose units remember nothing."""
    seen = *_seen(states), known
    if len(widths) < 2:
        return jax.vmap(partial(_ask, policy))(*seen)
    num, slots = seen[1].shape
    parts = by_length(seen[1], largest_divisor(num, max(1, CACHED_ROWS // slots)))

    def few(width: int, some: Any) -> tuple[Array, Array]:
        obs, present, joined, known = some
        near = None if known is None else known[:, :width]
        short = obs[:, :width], present[:, :width], joined[:, : width - 1], near
        mean, value = jax.vmap(partial(_ask, policy))(*short)
        return jnp.pad(mean, ((0, 0), (0, slots - width), (0, 0))), value

    def of_part(places: Array) -> tuple[Array, Array]:
        some = jax.tree.map(lambda x: x[places], seen)
        return at_width(widths, some[1], few, some)

    told = jax.tree.map(lambda x: x.reshape(num, *x.shape[2:]), jax.lax.map(of_part, parts))
    back = jnp.argsort(parts.ravel())
    return told[0][back], told[1][back]


def _ask(
    policy: ActorCritic, obs: Array, present: Array, joined: Array, known: Array | None
) -> tuple[Float[Array, "unit act"], Float[Array, ""]]:
    return policy(obs, present, joined, known=known)


def _sample(
    policy: ActorCritic,
    state: State,
    mean: Float[Array, "unit act"],
    value: Float[Array, ""],
    key: PRNGKeyArray,
    known: Float[Array, "unit known"] | None = None,
) -> Sample:
    """A sampled action for one chain, with its log-probability and the value of the state."""
    chain = state.chain
    action = mean + jnp.exp(policy.log_std) * jr.normal(key, mean.shape)
    return Sample(
        obs=state.obs,
        present=chain.present,
        joined=chain.joined,
        action=action,
        log_prob=log_probs(policy, mean, action, chain.present),
        value=value,
        known=known,
        begins=None if policy.recall is None else state.time == 0,
    )


def log_probs(
    policy: ActorCritic,
    mean: Float[Array, "unit act"],
    action: Float[Array, "unit act"],
    present: Bool[Array, " unit"],
) -> Float[Array, " unit"]:
    """Log-density of each unit's action; 0 in dead slots. A chain's is their sum."""
    z = (action - mean) * jnp.exp(-policy.log_std)
    each = -0.5 * (z**2 + jnp.log(2 * jnp.pi)) - policy.log_std
    return jnp.sum(each * present[:, None], axis=1)


def values(
    env: Task, policy: ActorCritic, states: State, memory: Memory = None
) -> Float[Array, " env"]:
    """Value of each chain's present observation."""
    return _tell(policy, states, (), _known(env, policy, states), memory)[1]


def _final_value(
    env: Task, policy: ActorCritic, after: State, memory: Memory
) -> Float[Array, " env"]:
    """Values where an episode ran out of time; computed only when one did."""
    return jax.lax.cond(
        after.truncated.any(),
        lambda: values(env, policy, after, memory),
        lambda: jnp.zeros_like(after.reward),
    )
