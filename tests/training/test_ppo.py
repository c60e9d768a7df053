from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
import scipy.stats

from salpchain.controllers.policy import PolicyCard, RecurrentPolicy, as_policy
from salpchain.controllers.steering import steering
from salpchain.controllers.storage import load, save_policy
from salpchain.devices import AXIS
from salpchain.errors import InputError
from salpchain.interop.export import export
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig
from salpchain.tasks.reach.reward import own_progress
from salpchain.tasks.reach.task import SCLD
from salpchain.training.config import Mix, PPOConfig
from salpchain.training.metrics import NotFiniteError
from salpchain.training.ppo import (
    TrainingSample,
    entropy,
    entropy_weight,
    loss,
    optimiser,
    own_returns,
)
from salpchain.training.presets import choose
from salpchain.training.rollout import Sample, collect, log_probs
from salpchain.training.start import policy_to_start, with_weights
from salpchain.training.trainer import resume, train
from tests.training.small import small


def batch_of(policy, size=6, units=4, inputs=5):
    keys = jr.split(jr.key(1), 3)
    obs = jr.normal(keys[0], (size, units, inputs))
    present, joined = jnp.ones((size, units), bool), jnp.ones((size, units - 1), bool)
    mean, value = jax.vmap(policy)(obs, present, joined)
    action = mean + 0.3 * jr.normal(keys[1], mean.shape)
    density = jax.vmap(log_probs, (None, 0, 0, 0))(policy, mean, action, present)
    sample = jax.vmap(Sample)(obs, present, joined, action, density, value)
    return jax.vmap(TrainingSample)(sample, jr.normal(keys[2], (size, 1)), value + 1.0)


@pytest.fixture
def policy():
    return actor_critic(jr.key(0), ControlConfig(), 5, 2, 4)


def test_the_density_is_that_of_a_gaussian_over_all_present_units(policy):
    mean, action = jr.normal(jr.key(0), (2, 4, 2))
    present = jnp.array([True, True, True, False])
    std = np.exp(np.asarray(policy.log_std))
    expected = scipy.stats.norm.logpdf(action[:3], mean[:3], std).sum()
    each = log_probs(policy, mean, action, present)
    assert float(each.sum()) == pytest.approx(expected, rel=1e-5)
    assert float(each[3]) == 0


def test_the_entropy_is_that_of_the_gaussians_of_a_chain(policy):
    present = jnp.ones((3, 4), bool)
    expected = 4 * scipy.stats.norm(scale=np.exp(np.asarray(policy.log_std))).entropy().sum()
    assert float(entropy(policy, present)) == pytest.approx(expected, rel=1e-5)


def test_at_the_old_policy_the_gradient_is_the_plain_policy_gradient(policy):
    batch = batch_of(policy)
    config = PPOConfig(value_weight=0.0, entropy=0.0)

    def plain(policy):
        sample = batch.sample
        mean, _ = jax.vmap(policy)(sample.obs, sample.present, sample.joined)
        density = jax.vmap(log_probs, (None, 0, 0, 0))(policy, mean, sample.action, sample.present)
        return -(density.sum(axis=1) * batch.advantage[:, 0]).mean()

    ours = jax.grad(lambda p: loss(p, config, batch, 0.0)[0])(policy)
    for one, other in zip(
        jax.tree.leaves(ours), jax.tree.leaves(jax.grad(plain)(policy)), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_ratio_far_outside_the_clip_range_has_no_gradient(policy):
    batch = batch_of(policy)
    old = batch.sample.log_prob - jnp.sign(batch.advantage)
    far = eqx.tree_at(lambda b: b.sample.log_prob, batch, old)
    config = PPOConfig(value_weight=0.0, entropy=0.0)
    gradient = jax.grad(lambda p: loss(p, config, far, 0.0)[0])(policy)
    assert all(not np.asarray(x).any() for x in jax.tree.leaves(gradient))


def test_the_weight_of_the_entropy_falls_linearly_to_its_final_share(policy):
    config = PPOConfig(entropy=0.01, final_entropy=0.5)
    weights = [float(entropy_weight(config, done)) for done in (0.0, 0.5, 1.0)]
    assert weights == pytest.approx([0.01, 0.0075, 0.005])
    batch = batch_of(policy)
    slope = lambda weight: jax.grad(lambda p: loss(p, config, batch, weight)[0])(policy).log_std  # noqa: E731
    present = float(batch.sample.present.sum(axis=1).mean())
    np.testing.assert_allclose(slope(0.5) - slope(0.0), -0.5 * present, rtol=1e-4)


def test_own_returns_are_discounted_sums_to_the_end_of_the_episode():
    config = PPOConfig(ratio="unit", credit="unit", gamma=0.9, lam=0.5)
    own = jnp.array([[[1.0, -1.0]], [[2.0, -2.0]], [[4.0, -4.0]]])  # (step, env, unit)
    no = jnp.zeros((3, 1), bool)
    ended = no.at[1].set(True)
    for ends in ((ended, no), (no, ended)):
        gained = np.asarray(own_returns(config, own, *ends))[:, 0]
        fall = 0.9 * 0.5
        np.testing.assert_allclose(gained[:, 0], [1 + fall * 2, 2, 4], rtol=1e-6)
        np.testing.assert_allclose(gained.sum(axis=1), 0, atol=1e-6)


def test_own_progress_is_that_beyond_the_mean_units_and_of_present_units_alone():
    state = SCLD(TaskConfig(length=5)).reset(jr.key(0), 4)
    moved = state.target.at[0].add(jnp.array([1.0, 0.0]))
    units = eqx.tree_at(lambda c: c.units.position, state.chain, moved)
    nearer = eqx.tree_at(lambda c: c.units.position, units, moved.at[0].add(jnp.array([-0.6, 0.0])))
    plain = np.asarray(own_progress(units, nearer, state.target, 0.0))
    np.testing.assert_allclose(plain, [0.6 - 0.15, -0.15, -0.15, -0.15, 0], atol=1e-5)
    fine = np.asarray(own_progress(units, nearer, state.target, 2.0)) - plain
    gained = np.log(1 + 1 / 0.05) - np.log(1 + 0.4 / 0.05)
    np.testing.assert_allclose(fine, gained * np.array([0.75, -0.25, -0.25, -0.25, 0]), atol=1e-5)


def test_credit_for_each_unit_needs_a_ratio_for_each():
    with pytest.raises(InputError, match="credit unit needs ratio unit, got ratio chain"):
        PPOConfig(credit="unit")


def test_a_unit_with_credit_of_its_own_is_taught_by_its_own_advantage(policy):
    batch = batch_of(policy)
    config = PPOConfig(ratio="unit", credit="unit", value_weight=0.0)
    mine = jnp.zeros((6, 4)).at[:, 1].set(1.0)
    taught = eqx.tree_at(lambda b: b.advantage, batch, mine)

    def taught_by(log_prob):
        return loss(policy, config, eqx.tree_at(lambda b: b.sample.log_prob, taught, log_prob), 0.0)

    slope = jax.grad(lambda x: taught_by(x)[0])(batch.sample.log_prob)
    assert np.asarray(slope[:, 1]).all() and not np.asarray(slope[:, [0, 2, 3]]).any()


def test_the_learning_rate_falls_linearly_to_its_final_share():
    config = PPOConfig(learning_rate=1e-3, final_rate=0.1, max_grad_norm=1e9)
    steps = 10 * config.epochs * config.minibatches
    rule = optimiser(config, 10)
    state, sizes = rule.init(jnp.ones(())), []
    for _ in range(steps + 1):
        update, state = rule.update(jnp.ones(()), state)
        sizes.append(-float(update))
    assert sizes[0] == pytest.approx(1e-3, rel=1e-3)
    assert sizes[steps // 2] == pytest.approx(0.55e-3, rel=1e-3)
    assert sizes[-1] == pytest.approx(1e-4, rel=1e-3)


def test_a_run_that_blows_up_stops_names_the_place_and_keeps_the_last_good_checkpoint(tmp_path):
    with pytest.raises(NotFiniteError, match=r"iteration \d+: not a finite number in the"):
        train(small(learning_rate=1e30, max_grad_norm=1e30), tmp_path / "run")
    from salpchain.files import read_arrays
    from salpchain.training.checkpoint import VERSION

    _, arrays = read_arrays(tmp_path / "run" / "checkpoint.safetensors", "checkpoint", VERSION)
    assert all(np.isfinite(x).all() for x in arrays.values() if x.dtype.kind == "f")
    assert not (tmp_path / "run" / "summary.json").exists()


def test_the_paper_preset_is_table_2():
    config = choose("paper")
    ppo = config.ppo
    assert (ppo.epochs, ppo.batch, ppo.minibatch) == (10, 5120, 256)
    assert (ppo.clip, ppo.max_grad_norm, ppo.gamma, ppo.lam) == (0.2, 0.5, 0.99, 0.95)
    assert (ppo.entropy, ppo.learning_rate, ppo.final_rate) == (0.001, 5e-5, 1.0)
    assert (ppo.ratio, ppo.final_entropy) == ("chain", 1.0)
    assert config.steps == 60_000 * 512
    assert config.task.observation == "table1" and config.task.action == "pair"
    assert config.task.fine_weight == 0 and config.task.fence


def test_several_lengths_have_settings_of_their_own_unless_others_are_asked_for():
    several = Mix((4, 8))
    config = choose("quick", mix=several)
    assert (config.task.observation, config.control.graph) == ("proximity", "mixed")
    assert config.control.improved and config.task.tolerance < GOAL_LIMIT
    assert config.task.folded > 0 and config.task.stalled > 0
    asked = choose("quick", mix=several, model="gatv2", graph="hub", observation="body")
    assert (asked.task.observation, asked.control.graph) == ("body", "hub")
    assert asked.control.model == "gatv2" and not asked.control.improved
    one = choose("quick", mix=Mix((8,)))
    assert (one.task.folded, one.task.tolerance, one.control.improved) == (0, GOAL_LIMIT, False)
    assert one.ppo == config.ppo and config.steps == 2 * one.steps == 2 * choose("quick").steps


@pytest.mark.parametrize(
    "settings", [{"minibatch": 1000}, {"envs": 0}, {"gamma": 1.5}, {"learning_rate": 0.0}]
)
def test_settings_that_cannot_be_are_refused_with_one_line(settings):
    with pytest.raises(InputError) as error:
        PPOConfig(**settings)
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def remembering():
    """A network whose units recall something, and a rollout in which one episode ends halfway."""
    env = SCLD(TaskConfig(3, contact=False))
    config = ControlConfig(memory=True)
    network = actor_critic(jr.key(0), config, env.observation_size, env.action_size, 3)
    weight = 0.1 * jr.normal(jr.key(1), (128, 128))
    network = eqx.tree_at(lambda n: n.recall.recalled.weight, network, weight)
    states = jax.jit(jax.vmap(env.reset))(jr.split(jr.key(2), 2))
    last = env.step_limit(3) - 3
    states = eqx.tree_at(lambda s: s.time, states, jnp.array([7, last], states.time.dtype))
    memory = jr.normal(jr.key(3), (2, 3, 128))
    roll = eqx.filter_jit(lambda: collect(env, network, states, jr.key(4), 8, memory=memory))
    samples = jax.vmap(lambda _: roll()[2], axis_name=AXIS)(jnp.zeros(1))
    return network, jax.tree.map(lambda x: x[0], samples), memory


def test_units_that_remember_are_judged_by_what_they_remembered_then(remembering):
    network, sample, memory = remembering
    assert sample.begins[:, 1].tolist() == [False] * 3 + [True] + [False] * 4
    assert not sample.begins[:, 0].any()
    for env in range(2):
        known = memory[env]
        for step in range(8):
            one = jax.tree.map(lambda x: x[step, env], sample)  # noqa: B023
            known = jnp.zeros_like(known) if one.begins else known
            mean, known = network.plan(one.obs, one.present, one.joined, known)
            density = log_probs(network, mean, one.action, one.present)
            np.testing.assert_allclose(density, one.log_prob, rtol=2e-4, atol=2e-4)
    batch = jax.vmap(jax.vmap(TrainingSample))(sample, jnp.ones((8, 2, 1)), sample.value)
    _, losses = loss(network, PPOConfig(ratio="unit"), batch, 0.0, memory)
    assert float(losses.kl) == pytest.approx(0, abs=1e-6) and float(losses.clipped) == 0
    assert float(losses.value) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("begins", [False, True])
def test_what_is_remembered_is_learned_as_far_back_as_the_episode_reaches(remembering, begins):
    network, sample, memory = remembering
    sample = eqx.tree_at(lambda s: s.begins, sample, jnp.zeros((8, 2), bool).at[4].set(begins))
    gain = jnp.zeros((8, 2, 1)).at[7].set(1.0)
    batch = jax.vmap(jax.vmap(TrainingSample))(sample, gain, sample.value)
    config = PPOConfig(ratio="unit", value_weight=0.0)

    def lost(obs):
        seen = eqx.tree_at(lambda b: b.sample.obs, batch, obs)
        return loss(network, config, seen, 0.0, memory)[0]

    slopes = np.abs(jax.grad(lost)(sample.obs)).max(axis=(1, 2, 3))
    assert (slopes[4:] > 0).all()
    assert (slopes[:4] == 0).all() if begins else (slopes[:4] > 0).all()


@pytest.mark.slow
def test_a_policy_that_remembers_is_trained_kept_resumed_and_played(tmp_path):
    config = replace(small(4), control=ControlConfig(memory=True))
    train(config, tmp_path / "whole")
    policy = load(tmp_path / "whole")
    assert isinstance(policy, RecurrentPolicy)
    env = SCLD(policy.card.task(5))
    state = jax.jit(env.reset)(jr.key(0))
    first, memory = policy.plan(state, policy.begin(state))
    np.testing.assert_array_equal(first, policy.act(state))
    assert np.abs(policy.plan(state, memory)[0] - first).max() > 0
    for refused, said in (
        (lambda: export(policy, tmp_path / "policy.onnx", "onnx"), "memory"),
        (lambda: steering(policy, 5), "remembers"),
    ):
        with pytest.raises(InputError, match=said):
            refused()

    def stop(_, step):
        if step >= config.total_steps // 2:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        train(config, tmp_path / "stopped", on_iteration=stop)
    resume(tmp_path / "stopped")
    weights = jax.tree.leaves(load(tmp_path / "stopped").network)
    for one, other in zip(weights, jax.tree.leaves(policy.network), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_run_with_memory_begins_as_the_policy_without_that_it_starts_from(tmp_path):
    plain = as_policy(actor_critic(jr.key(0), ControlConfig(), 22, 1, 3), PolicyCard(length=3))
    save_policy(plain, tmp_path / "plain.safetensors")
    begin = str(tmp_path / "plain.safetensors")
    config = replace(small(1), control=ControlConfig(memory=True), start=begin)
    fresh = actor_critic(jr.key(5), config.control, 22, 1, 3)
    begun = with_weights(fresh, policy_to_start(config))
    state = jax.jit(SCLD(plain.card.task(3)).reset)(jr.key(0))
    chain = state.chain
    memory = jr.normal(jr.key(1), (3, 128))
    action, after = begun.plan(state.obs, chain.present, chain.joined, memory)
    np.testing.assert_allclose(action, plain.act(state), atol=1e-7)
    assert np.abs(after - memory).max() > 0


@pytest.mark.parametrize("given, begun", [(-2.0, -0.5), (3.0, 3.0)])
def test_a_run_begins_with_the_larger_spread_of_the_fresh_network_and_the_policy(given, begun):
    fresh, other = (actor_critic(jr.key(k), ControlConfig(), 22, 1, 3) for k in (0, 1))
    other = eqx.tree_at(lambda network: network.log_std, other, jnp.array([given]))
    start = with_weights(fresh, as_policy(other, PolicyCard(length=3)))
    assert start.log_std == begun
    again = with_weights(fresh, as_policy(other, PolicyCard(length=3)), fresh_spread=True)
    assert again.log_std == -0.5
    assert (start.actor.layers[0].weight == other.actor.layers[0].weight).all()


def test_a_run_begins_with_a_fresh_spread_for_each_unit_where_it_has_another_length():
    each = ControlConfig(shared_log_std=False)
    fresh, other = (actor_critic(jr.key(0), each, 22, 1, length) for length in (5, 3))
    other = eqx.tree_at(lambda network: network.log_std, other, other.log_std + 2.0)
    assert (with_weights(fresh, as_policy(other, PolicyCard(length=3))).log_std == -0.5).all()


def test_memory_needs_units_on_a_graph_and_minibatches_of_whole_rollouts():
    with pytest.raises(InputError, match="an mlp has none"):
        ControlConfig("mlp", memory=True)
    with pytest.raises(InputError, match=r"ppo.envs must be a multiple .* 16 minibatches, got 8"):
        replace(small(minibatch=8), control=ControlConfig(memory=True))
