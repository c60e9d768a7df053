"""One iteration of training as a pure, compiled function of a state."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import optax
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as Spec
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.controllers.policy import Policy, PolicyCard, as_policy
from salpchain.devices import AXIS, largest_divisor, use_devices
from salpchain.networks.actor_critic import ActorCritic, actor_critic
from salpchain.networks.layers import WIDTH
from salpchain.tasks.registry import own_settings
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from salpchain.training.cohorts import Tally, count, no_cohorts
from salpchain.training.config import TrainConfig
from salpchain.training.curriculum import (
    Curriculum,
    advance,
    draw_length,
    eased,
    new_curriculum,
)
from salpchain.training.ppo import Losses, improve, optimiser, training_samples
from salpchain.training.rollout import Outcome, Sample, collect, values
from salpchain.training.start import policy_to_start, with_weights
from salpchain.training.widths import widths_of
from salpchain.world.presets import label


class TrainState(eqx.Module):
    """All that training carries from one iteration to the next: saved and restored bit for bit."""

    policy: ActorCritic
    optimiser_state: Any
    states: State  # batch first, shared out over the devices
    cohorts: Tally  # of episodes, by the rollout in which they began, oldest last
    curriculum: Curriculum
    key: PRNGKeyArray
    iteration: Int[Array, ""]
    memory: Float[Array, "*learner env unit 128"] | None = None  # what the units remember, if so


class Finite(eqx.Module):
    """Whether all numbers of an iteration are finite, in the order in which they arise."""

    observations: Bool[Array, ""]
    rewards: Bool[Array, ""]
    losses: Bool[Array, ""]
    weights: Bool[Array, ""]


class Metrics(eqx.Module):
    """What one iteration saw."""

    losses: Losses
    terms: dict[str, Float[Array, ""]]  # mean of each reward term per step
    cohort: Tally  # of the episodes of the latest start cohort all of whose episodes have ended
    finite: Finite
    ease: Float[Array, ""] | None = None  # share of its world that an episode was spared besides


def new_state(config: TrainConfig, env: Task) -> TrainState:
    """A learner before its first step; all randomness follows from `config.seed`.

    Raises:
        InputError: as `policy_to_start`.
    """
    fresh, start = fresh_state(config, env), policy_to_start(config)
    if start is None:
        return fresh
    begun = with_weights(fresh.policy, start, config.fresh_spread)
    return eqx.tree_at(lambda x: x.policy, fresh, begun)


def fresh_state(config: TrainConfig, env: Task) -> TrainState:
    """`new_state` with fresh weights, whatever it is to start with."""

    @jax.jit  # op by op, each would be compiled for itself
    def new(key: PRNGKeyArray) -> TrainState:
        weights_key, reset_key, key = jr.split(key, 3)
        policy = actor_critic(
            weights_key, config.control, env.observation_size, env.action_size, config.task.length
        )
        curriculum, reset_keys = new_curriculum(config), jr.split(reset_key, config.ppo.envs)
        lengths = jax.vmap(lambda key: draw_length(config, curriculum, jr.fold_in(key, 0)))(
            reset_keys
        )
        states = jax.vmap(eased(env, curriculum).reset)(reset_keys, lengths)
        state = optimiser(config.ppo, config.iterations).init(cast(optax.Params, policy))
        cohorts = no_cohorts(config.task.step_limit, config.ppo.rollout, len(config.lengths))
        memory = None
        if config.control.memory:
            memory = jnp.zeros((config.ppo.envs, config.task.length, WIDTH))
        return TrainState(policy, state, states, cohorts, curriculum, key, jnp.int32(0), memory)

    return new(jr.key(config.seed))


def divided_over(config: TrainConfig, devices: int | None, or_fewer: bool = False) -> int:
    """Over how many of these devices the chains of a run are divided; None: of those there are.

    Raises:
        InputError: fewer devices than asked for.
    """
    return largest_divisor(
        math.gcd(config.ppo.envs, config.ppo.minibatch), use_devices(devices, or_fewer)
    )


def policy_of(config: TrainConfig, network: ActorCritic, steps: int) -> Policy:
    """The policy with a network after so many chain-steps of training, and its card."""
    card = PolicyCard(
        name=config.policy_name,
        control=config.control,
        observation=config.task.observation,
        action=config.task.action,
        length=config.task.length,
        lengths=config.lengths,
        steps=steps,
        world=label(config.world),
        task_name=config.task.name,
        task_settings=tuple(own_settings(config.task).items()),
    )
    return as_policy(network, card)


def place(learner: TrainState, mesh: Mesh) -> TrainState:
    """The learner with its chains shared out over the mesh, all else on every device."""
    return jax.tree.map(
        lambda x, spec: jax.device_put(x, NamedSharding(mesh, spec)), learner, _specs(learner)
    )


def _specs(learner: TrainState) -> TrainState:
    lead = (None,) * learner.iteration.ndim  # of learners side by side
    specs = jax.tree.map(lambda _: Spec(), learner)
    parts = learner.states, learner.memory
    shared = jax.tree.map(lambda _: Spec(*lead, AXIS), parts)
    return eqx.tree_at(lambda x: (x.states, x.memory), specs, shared, is_leaf=lambda x: x is None)


Iterate = Callable[[TrainState], tuple[TrainState, Metrics]]


def compile_iterate(
    config: TrainConfig, env: Task, mesh: Mesh, learner: TrainState, donate: bool = True
) -> Iterate:
    """`iterate` over the mesh, compiled for this learner's shapes.

    The learner may be several side by side, with a leading axis; then so are the metrics. Unless
    `donate` is false, the memory of the one that it is given is used for the one that it returns.
    """
    specs, one = _specs(learner), partial(iterate, config, env)
    sharded = jax.shard_map(
        jax.vmap(one) if learner.iteration.ndim else one,
        mesh=mesh,
        in_specs=(specs,),
        out_specs=(specs, Spec()),
        check_vma=False,
    )
    return jax.jit(sharded, donate_argnums=(0,) if donate else ()).lower(learner).compile()


def iterate(config: TrainConfig, env: Task, learner: TrainState) -> tuple[TrainState, Metrics]:
    """A rollout and the update from it, on one device's share of the chains."""
    ppo, widths = config.ppo, widths_of(config.lengths)
    env = eased(env, learner.curriculum)
    act_key, shuffle_key, key = jr.split(learner.key, 3)
    states, memory, samples, outcomes = collect(
        env, learner.policy, learner.states, act_key, ppo.rollout,
        partial(draw_length, config, learner.curriculum), widths, learner.memory,
    )  # fmt: skip
    last_values = values(env, learner.policy, states, memory)
    batch = training_samples(ppo, samples, outcomes, last_values)
    policy, optimiser_state, losses = improve(
        ppo, optimiser(ppo, config.iterations), learner.policy, learner.optimiser_state, batch,
        shuffle_key, learner.iteration / config.iterations, widths, learner.memory,
    )  # fmt: skip
    cohorts, cohort = count(learner.cohorts, outcomes, config.lengths)
    curriculum = advance(config, learner.curriculum, cohort.episodes, cohort.goals)
    after = TrainState(
        policy, optimiser_state, states, cohorts, curriculum, key, learner.iteration + 1, memory
    )  # fmt: skip
    seen = metrics(policy, losses, samples, outcomes, cohort)
    return after, replace(seen, ease=learner.curriculum.ease)


def metrics(
    policy: ActorCritic, losses: Losses, samples: Sample, outcomes: Outcome, cohort: Tally
) -> Metrics:
    """What an iteration saw on all devices."""
    means = {n: jax.lax.pmean(term.mean(), AXIS) for n, term in outcomes.terms.items()}
    return Metrics(
        losses=losses,
        terms=means,
        cohort=cohort,
        finite=Finite(*map(_finite, (samples.obs, outcomes.reward, losses, policy))),
    )


def _finite(tree: Any) -> Bool[Array, ""]:
    """Whether every number in the tree is finite, on every device."""
    fine = jnp.stack([jnp.isfinite(x).all() for x in jax.tree.leaves(tree)]).all()
    return jax.lax.pmin(fine.astype(jnp.int32), AXIS) > 0
