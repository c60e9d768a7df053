"""Proximal policy optimisation (paper section 2.2.1; Schulman et al. 2017)."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, Shaped

from salpchain.devices import AXIS, largest_divisor
from salpchain.networks.actor_critic import ActorCritic
from salpchain.training.advantage import advantages, next_values
from salpchain.training.config import PPOConfig
from salpchain.training.rollout import Memory, Outcome, Sample, log_probs, remember
from salpchain.training.widths import CACHED_ROWS, at_width, by_length
from salpchain.xla import flat_products, on_cpu


class TrainingSample(eqx.Module):
    """A sample with its advantage and value target."""

    sample: Sample
    advantage: Float[Array, " part"]  # of the chain, or of each unit; normalised over the rollout
    target: Float[Array, ""]  # of the value


class Losses(eqx.Module):
    """What an update did, averaged over its gradient steps."""

    policy: Float[Array, ""]
    value: Float[Array, ""]
    entropy: Float[Array, ""]
    kl: Float[Array, ""]  # approximate, from old to new policy
    clipped: Float[Array, ""]  # share of ratios outside the clip range
    grad_norm: Float[Array, ""]


def training_samples(
    config: PPOConfig, samples: Sample, outcomes: Outcome, last_value: Float[Array, " env"]
) -> TrainingSample:
    """Samples of a rollout with normalised advantages and value targets, axes (step, env).

    With credit for each unit, what its own progress will differ by from the mean unit's is added to
    the chain's advantage, discounted alike and without a baseline: over a chain, it sums to zero.
    """
    following = next_values(samples.value, last_value, outcomes.final_value, outcomes.truncated)
    gain = advantages(
        outcomes.reward,
        samples.value,
        following,
        outcomes.terminated,
        outcomes.truncated,
        config.gamma,
        config.lam,
    )
    parts = gain[..., None]
    if config.credit == "unit":
        parts = parts + own_returns(config, outcomes.own, outcomes.terminated, outcomes.truncated)
    mean = jax.lax.pmean(parts.mean(), AXIS)
    deviation = jnp.sqrt(jax.lax.pmean(((parts - mean) ** 2).mean(), AXIS))
    normal = (parts - mean) / (deviation + 1e-8)
    return jax.vmap(jax.vmap(TrainingSample))(samples, normal, gain + samples.value)


def own_returns(
    config: PPOConfig,
    own: Float[Array, "step env unit"],
    terminated: Bool[Array, "step env"],
    truncated: Bool[Array, "step env"],
) -> Float[Array, "step env unit"]:
    """Discounted sums of `Outcome.own` to the end of each episode, or of the rollout."""
    none = jnp.zeros(own.shape[:2])

    def of_unit(own: Float[Array, "step env"]) -> Float[Array, "step env"]:
        return advantages(own, none, none, terminated, truncated, config.gamma, config.lam)

    return jax.vmap(of_unit, in_axes=2, out_axes=2)(own)


def improve(
    config: PPOConfig,
    optimiser: optax.GradientTransformation,
    policy: ActorCritic,
    optimiser_state: Any,
    batch: TrainingSample,
    key: PRNGKeyArray,
    done: Float[Array, ""] | float = 0.0,
    widths: Sequence[int] = (),
    memory: Memory = None,
) -> tuple[ActorCritic, Any, Losses]:
    """The policy after all epochs of minibatches over the batch, axes (step, env).

    `memory`: of units that remember, from before the rollout; a minibatch is then the whole
    rollouts of some chains, and what was remembered is learned through time.
    `done` is the share of the run that is over, on which the weight of the entropy depends.
    Every device knows the whole batch and works on its part of each minibatch, so that the
    minibatches are the same however many devices there are. `widths`: as in `widths_of`.
    """
    whole, memory = _of_all_devices(batch, memory)
    samples = config.batch if memory is None else config.envs
    devices, device = jax.lax.axis_size(AXIS), jax.lax.axis_index(AXIS)
    weight = entropy_weight(config, done)

    def epoch(carry: Any, key: PRNGKeyArray) -> tuple[Any, Losses]:
        order = jr.permutation(key, samples).reshape(config.minibatches, devices, -1)
        return jax.lax.scan(learn, carry, order[:, device])

    def learn(carry: Any, chosen: Array) -> tuple[Any, Losses]:
        policy, optimiser_state = carry
        told = _gradient(policy, config, whole, chosen, weight, widths, memory)
        gradient, losses = jax.lax.pmean(told, AXIS)
        norm = optax.tree.norm(gradient)
        updates, optimiser_state = optimiser.update(gradient, optimiser_state, policy)
        policy = optax.apply_updates(policy, updates)
        return (policy, optimiser_state), eqx.tree_at(lambda x: x.grad_norm, losses, norm)

    start = (policy, optimiser_state)
    (policy, optimiser_state), losses = jax.lax.scan(epoch, start, jr.split(key, config.epochs))
    return policy, optimiser_state, jax.tree.map(jnp.mean, losses)


def entropy_weight(config: PPOConfig, done: Float[Array, ""] | float) -> Float[Array, ""] | float:
    """The weight of the entropy in the loss, when this fraction of the run is over."""
    return config.entropy * (1 + done * (config.final_entropy - 1))


def _of_all_devices(batch: TrainingSample, memory: Memory) -> tuple[TrainingSample, Memory]:
    """The samples of all devices: one axis of them, or (step, env) of units that remember."""
    whole = jax.tree.map(partial(jax.lax.all_gather, axis_name=AXIS, axis=1, tiled=True), batch)
    if memory is None:
        return jax.tree.map(_flat, whole), None
    return whole, jax.lax.all_gather(memory, AXIS, tiled=True)


def _flat(x: Shaped[Array, "step env *rest"]) -> Shaped[Array, "sample *rest"]:
    return x.reshape(-1, *x.shape[2:])


def _gradient(
    policy: ActorCritic,
    config: PPOConfig,
    batch: TrainingSample,
    chosen: Int[Array, " minibatch"],
    weight: Float[Array, ""] | float,
    widths: Sequence[int],
    memory: Memory,
) -> tuple[ActorCritic, Losses]:
    """Mean gradient and losses over the chosen chain-steps, in parts that fit a core's cache.

    Of units that remember, over the whole rollouts of the chosen chains.
    """
    present = batch.sample.present
    rows = CACHED_ROWS if on_cpu() else chosen.shape[0] * present.shape[-1]
    size = largest_divisor(chosen.shape[0], max(1, rows // present.shape[-1]))
    parts = chosen.reshape(-1, size)
    if len(widths) > 1 and memory is None:
        parts = chosen[by_length(present[chosen], size)]

    def gradient(width: int, few: TrainingSample) -> Any:
        if width < present.shape[-1]:
            few = jax.vmap(partial(_cut, width))(few)
        return jax.grad(loss, has_aux=True)(policy, config, few, weight)

    def of_part(some: Array) -> Any:
        if memory is not None:
            few = jax.tree.map(lambda x: x[:, some], batch)
            return jax.grad(loss, has_aux=True)(policy, config, few, weight, memory[some])
        few = jax.tree.map(lambda x: x[some], batch)
        return at_width(widths or present.shape[-1:], few.sample.present, gradient, few)

    def add(total: Any, some: Array) -> tuple[Any, None]:
        return jax.tree.map(jnp.add, total, of_part(some)), None

    nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(of_part, parts[0]))
    total, _ = jax.lax.scan(add, nothing, parts)
    return jax.tree.map(lambda x: x / parts.shape[0], total)


def _cut(width: int, one: TrainingSample) -> TrainingSample:
    """The sample without the slots beyond this width, which must be dead."""
    sample, gain = one.sample, one.advantage
    short = Sample(  # of units that remember nothing
        obs=sample.obs[:width],
        present=sample.present[:width],
        joined=sample.joined[: width - 1],
        action=sample.action[:width],
        log_prob=sample.log_prob[:width],
        value=sample.value,
        known=None if sample.known is None else sample.known[:width],
    )
    return TrainingSample(short, gain[:width] if len(gain) > 1 else gain, one.target)


def loss(
    policy: ActorCritic,
    config: PPOConfig,
    batch: TrainingSample,
    weight: Float[Array, ""] | float,
    memory: Memory = None,
) -> tuple[Float[Array, ""], Losses]:
    """The clipped surrogate (paper equation 1), the value error and the entropy, weighted.

    With the memory of each chain before its rollout, the axes of the batch are (step, env).
    """
    sample = batch.sample
    with flat_products():
        if memory is None:
            mean, value = jax.vmap(lambda s: policy(s.obs, s.present, s.joined, known=s.known))(
                sample
            )
        else:
            mean, value = _through_time(policy, sample, memory)
            batch, mean, value = jax.tree.map(_flat, (batch, mean, value))
            sample = batch.sample
    density = jax.vmap(log_probs, (None, 0, 0, 0))(policy, mean, sample.action, sample.present)
    change, share = changes(config.ratio, density - sample.log_prob, sample.present)
    ratio, gain = jnp.exp(change), batch.advantage
    clipped = jnp.clip(ratio, 1 - config.clip, 1 + config.clip)
    surrogate = _mean(share, jnp.minimum(ratio * gain, clipped * gain))
    value_error = jnp.mean((value - batch.target) ** 2)
    spread = entropy(policy, sample.present)
    total = -surrogate + config.value_weight * value_error - weight * spread
    return total, Losses(
        policy=-surrogate,
        value=value_error,
        entropy=spread,
        kl=_mean(share, ratio - 1 - change),
        clipped=_mean(share, jnp.abs(ratio - 1) > config.clip),
        grad_norm=jnp.zeros(()),
    )


def _through_time(
    policy: ActorCritic, sample: Sample, memory: Float[Array, "env unit 128"]
) -> tuple[Float[Array, "step env unit act"], Float[Array, "step env"]]:
    """Mean actions and values of rollouts, what was remembered passed on from step to step."""

    def advance(memory: Array, now: Sample) -> tuple[Array, tuple[Array, Array]]:
        seen = now.obs, now.present, now.joined, memory, now.known, now.begins
        mean, value, memory = jax.vmap(partial(remember, policy))(*seen)
        return memory, (mean, value)

    return jax.lax.scan(advance, memory, sample)[1]


def changes(
    ratio: str, change: Float[Array, "sample unit"], present: Bool[Array, "sample unit"]
) -> tuple[Float[Array, "sample part"], Float[Array, "sample part"]]:
    """The log-ratios that are clipped, and what share of its chain's loss each has.

    `chain`: one for each chain, the sum over its units, which act as one (the paper's). Its
    gradient and its spread grow with the length, so in a mix long chains drown short ones and are
    clipped sooner. `unit`: one for each unit, averaged over its chain, so that chains of all
    lengths count the same and are clipped at the same change.
    """
    if ratio == "chain":
        return change.sum(axis=1, keepdims=True), jnp.ones((change.shape[0], 1))
    return change, present / jnp.maximum(present.sum(axis=1, keepdims=True), 1)


def _mean(share: Float[Array, "sample part"], each: Array) -> Float[Array, ""]:
    """Mean over chains of the sum over their parts."""
    return jnp.mean(jnp.sum(share * each, axis=1))


def entropy(policy: ActorCritic, present: Array) -> Float[Array, ""]:
    """Mean entropy (nat) of a chain's action distribution."""
    each = policy.log_std + 0.5 * jnp.log(2 * jnp.pi * jnp.e)
    return jnp.mean(jnp.sum(each * present[..., None], axis=(1, 2)))


def optimiser(config: PPOConfig, iterations: int) -> optax.GradientTransformation:
    """Adam after gradient clipping, its rate falling linearly to `final_rate` of itself."""
    updates = iterations * config.epochs * config.minibatches
    rate = optax.linear_schedule(
        config.learning_rate, config.learning_rate * config.final_rate, updates
    )
    return optax.chain(optax.clip_by_global_norm(config.max_grad_norm), optax.adam(rate, eps=1e-5))
