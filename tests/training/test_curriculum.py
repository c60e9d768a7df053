"""Training on several lengths at once: which length an episode gets, and what each counts for."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.ranges import as_range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import observation_size
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.registry import make_task
from salpchain.tasks.renew import renew_done
from salpchain.training.config import Mix, PPOConfig
from salpchain.training.curriculum import advance, draw_length, eased, new_curriculum
from salpchain.training.learner import new_state
from salpchain.training.ppo import TrainingSample, loss
from salpchain.training.presets import choose
from salpchain.training.rollout import Sample, log_probs, values
from salpchain.training.run_folder import read_config, read_log
from salpchain.training.trainer import resume, train
from salpchain.world.config import SensingConfig, WorldConfig
from salpchain.world.presets import world_config
from tests.training.small import small


def mixed(mix, **changes):
    base = small(4)
    return dataclasses.replace(
        base, task=dataclasses.replace(base.task, length=mix.lengths[-1]), mix=mix, **changes
    )


def drawn(config, curriculum, number=4000):
    keys = jr.split(jr.key(0), number)
    return np.asarray(jax.vmap(lambda key: draw_length(config, curriculum, key))(keys))


def test_lengths_are_drawn_as_often_as_their_weights_say():
    config = mixed(Mix((2, 3, 5), (1.0, 1.0, 2.0)))
    lengths, counts = np.unique(drawn(config, new_curriculum(config)), return_counts=True)
    assert list(lengths) == [2, 3, 5]
    np.testing.assert_allclose(counts / counts.sum(), [0.25, 0.25, 0.5], atol=0.03)


def test_a_curriculum_starts_with_the_shortest_and_grows_when_all_in_play_are_solved():
    config = mixed(Mix((2, 3, 5), grow=0.9))
    curriculum = new_curriculum(config)
    assert set(drawn(config, curriculum)) == {2}
    few = jnp.array([50.0, 0, 0])
    assert int(advance(config, curriculum, few, few).stage) == 0  # too few to judge
    many = jnp.array([150.0, 0, 0])
    assert int(advance(config, curriculum, many, 0.8 * many).stage) == 0
    curriculum = advance(config, curriculum, many, 0.95 * many)
    assert set(drawn(config, curriculum)) == {2, 3}
    both = jnp.array([150.0, 150.0, 0])
    forgot = advance(config, curriculum, both, jnp.array([100.0, 150.0, 0]))
    assert int(forgot.stage) == 1  # the shortest must stay solved
    curriculum = advance(config, curriculum, both, both)
    assert set(drawn(config, curriculum)) == {2, 3, 5}
    assert int(advance(config, curriculum, 9 * both, 9 * both).stage) == 2


def test_what_a_curriculum_judges_are_the_latest_episodes():
    config = mixed(Mix((2, 3), grow=0.9))
    curriculum, lost = new_curriculum(config), jnp.array([1000.0, 0.0])
    curriculum = advance(config, curriculum, lost, 0 * lost)
    for _ in range(12):
        won = jnp.array([100.0, 0.0])
        curriculum = advance(config, curriculum, won, won)
    assert int(curriculum.stage) == 1


def test_renewed_chains_get_the_drawn_length_and_the_others_stay_bit_identical():
    env = SCLD(TaskConfig(length=6))
    reset = jax.jit(jax.vmap(lambda key: env.reset(key, 4)))
    states = reset(jr.split(jr.key(1), 8))
    ended = eqx.tree_at(lambda s: s.truncated, states, jnp.arange(8) % 2 == 0)
    after = jax.jit(lambda s: renew_done(env, s, lambda key: jnp.int32(6)))(ended)
    assert list(np.asarray(after.length)) == [6, 4] * 4
    for one, other in zip(jax.tree.leaves(after.chain), jax.tree.leaves(ended.chain), strict=True):
        np.testing.assert_array_equal(one[1::2], other[1::2])


def samples_of(policy, lengths, slots, inputs=5):
    """Samples of chains whose units all see and do the same at any length."""
    obs = jnp.broadcast_to(jr.normal(jr.key(0), (inputs,)), (len(lengths), slots, inputs))
    present = jnp.arange(slots) < jnp.array(lengths)[:, None]
    joined = present[:, 1:]
    obs = jnp.where(present[..., None], obs, 0.0)
    mean, value = jax.vmap(policy)(obs, present, joined)
    action = mean + 0.4
    density = jax.vmap(log_probs, (None, 0, 0, 0))(policy, mean, action, present)
    sample = jax.vmap(Sample)(obs, present, joined, action, density, value)
    return jax.vmap(TrainingSample)(sample, jnp.ones((len(lengths), 1)), value)


def gradient(policy, ratio, batch):
    config = PPOConfig(ratio=ratio, value_weight=0.0)
    return jax.jit(jax.grad(lambda p: loss(p, config, batch, 0.0)[0]))(policy)


@pytest.mark.parametrize(("ratio", "growth"), [("unit", 1.0), ("chain", 8.0)])
def test_a_long_chain_pulls_no_harder_than_a_short_one_where_each_unit_has_its_ratio(ratio, growth):
    policy = actor_critic(jr.key(0), ControlConfig(), 5, 1, 16)
    pull = [gradient(policy, ratio, samples_of(policy, [n], 16)).log_std for n in (2, 16)]
    np.testing.assert_allclose(pull[1], growth * pull[0], rtol=1e-4)


@pytest.mark.parametrize("ratio", ["unit", "chain"])
def test_dead_slots_change_no_gradient(ratio):
    policy = actor_critic(jr.key(0), ControlConfig(), 5, 1, 8)
    roomy = samples_of(policy, [3, 5], 8)
    dead = ~roomy.sample.present[..., None]
    odd = eqx.tree_at(
        lambda b: (b.sample.obs, b.sample.action),
        roomy,
        (roomy.sample.obs + 7.0 * dead, roomy.sample.action - 9.0 * dead),
    )
    tight = samples_of(policy, [3, 5], 5)
    for other in (odd, tight):
        pairs = zip(
            jax.tree.leaves(gradient(policy, ratio, roomy)),
            jax.tree.leaves(gradient(policy, ratio, other)),
            strict=True,
        )
        for one, two in pairs:
            np.testing.assert_allclose(one, two, atol=1e-6)


@pytest.mark.slow
def test_episodes_that_start_on_their_target_count_for_nothing(tmp_path):
    config = small()
    task = dataclasses.replace(config.task, length=2, stalled=1.0)  # two units have nothing to fold
    train(dataclasses.replace(config, task=task), tmp_path / "run", devices=1)
    episodes = sum(float(row["episodes"]) for row in read_log(tmp_path / "run"))
    assert episodes < 0.05 * config.total_steps  # that many have ended: one in each step


@pytest.mark.slow
def test_a_run_on_several_lengths_logs_each_and_goes_on_where_it_was(tmp_path):
    config = mixed(Mix((2, 3), (2.0, 1.0), grow=0.5), ppo=dataclasses.replace(small().ppo, envs=32))
    config = dataclasses.replace(config, steps=3 * config.ppo.batch)

    def stop(metrics, step):
        if step >= 2 * config.ppo.batch:
            raise KeyboardInterrupt

    train(config, tmp_path / "whole", devices=1)
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "cut", on_iteration=stop, devices=1)
    assert read_config(tmp_path / "cut")[0] == config
    resume(tmp_path / "cut")
    kept = [(tmp_path / name / "checkpoint.safetensors").read_bytes() for name in ("whole", "cut")]
    assert kept[0] == kept[1]
    assert {"success_2", "success_3"} <= read_log(tmp_path / "whole")[0].keys()
    assert load(tmp_path / "whole").card.lengths == (2, 3)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"mix": Mix((4, 8)), "model": "mlp"}, "one length only"),
        ({"mix": Mix((4, 8)), "name": "paper"}, "take preset quick"),
    ],
)
def test_what_serves_one_length_only_refuses_several(settings, word):
    with pytest.raises(InputError, match=word):
        choose(settings.pop("name", "quick"), **settings)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        (((8, 4),), "ascend"),
        (((4, 4),), "ascend"),
        (((1, 4),), "2 to 1024"),
        (((4, 8), (1.0,)), "as many as lengths"),
        (((4, 8), (1.0, 0.0)), "0.000001 to 1000000, got 1.0,0.0"),
        (((4, 8), (1.0, float("nan"))), "finite numbers"),
        (((4, 8), (1.0, float("inf"))), "finite numbers"),
        (((4, 8), (1.0, 1e-320)), "got 1.0,1e-320"),
        (((4, 8), (), 1.5), r"\[0, 1\]"),
        (((), (), 0.5), "several lengths"),
    ],
)
def test_a_mix_that_cannot_be_is_refused_in_one_line(values, word):
    with pytest.raises(InputError, match=word) as error:
        Mix(*values)
    assert "\n" not in str(error.value)


def test_worlds_get_rougher_when_enough_episodes_succeed():
    with pytest.raises(InputError, match=r"needs a world that can get rougher, got 0\.8 in still"):
        mixed(Mix((2, 3), roughen=0.8))
    config = mixed(Mix((2, 3), roughen=0.8), world=world_config("sea"))
    curriculum = new_curriculum(config)
    assert float(curriculum.ease) == 1
    many = jnp.array([150.0, 60.0])
    assert float(advance(config, curriculum, many, 0.7 * many).ease) == 1
    rougher = advance(config, curriculum, many, 0.9 * many)
    assert float(rougher.ease) == pytest.approx(0.95)
    assert float(rougher.episodes.sum()) == 0  # judged anew, in the rougher worlds
    for _ in range(30):
        rougher = advance(config, rougher, many, many)
    assert float(rougher.ease) == 0
    assert new_curriculum(mixed(Mix((2, 3)))).ease is None


@pytest.mark.slow
def test_an_eased_episode_is_spared_that_share_of_its_world():
    config = mixed(Mix((2, 3), roughen=0.8), world=world_config("sea"))
    env = make_task(config.task, config.world)
    reset = jax.jit(lambda keys, ease: jax.vmap(at_ease(config, env, ease).reset)(keys))
    keys = jr.split(jr.key(0), 400)
    drags = [float((reset(keys, ease).world.dynamics.drag == 0.25).mean()) for ease in (1.0, 0.0)]
    assert drags == [1.0, pytest.approx(0.5, abs=0.1)]  # by itself, it is spared any share
    plain = jax.jit(jax.vmap(env.reset))(keys)
    assert float((plain.world.dynamics.drag == 0.25).mean()) == drags[1]


def at_ease(config, env, ease):
    return eased(env, dataclasses.replace(new_curriculum(config), ease=jnp.asarray(ease)))


@pytest.mark.slow
def test_a_run_in_rougher_and_rougher_worlds_says_how_rough_they_are(tmp_path, monkeypatch):
    monkeypatch.setattr("salpchain.training.curriculum.ENOUGH", 4.0)
    config = mixed(Mix((2, 3), roughen=0.01), world=world_config("sea"))
    always = dataclasses.replace(config.task, most_steps=20, tolerance=0.2)  # easy
    config = dataclasses.replace(config, task=always, steps=4 * config.steps)
    train(config, tmp_path / "run")
    ease = [float(row["ease"]) for row in read_log(tmp_path / "run")]
    assert ease[0] == 1 and (np.diff(ease) <= 0).all() and ease[-1] < 1


@pytest.mark.slow
def test_a_run_begins_with_the_weights_of_another_and_what_is_new_counts_for_nothing():
    config = mixed(Mix((2, 3)), start="any-length", control=load("any-length").card.control)
    for observation in ("proximity", "jets"):
        task = dataclasses.replace(config.task, observation=observation)
        env = make_task(task)
        policy = new_state(dataclasses.replace(config, task=task), env).policy
        state = jax.jit(env.reset)(jr.key(0))
        state = jax.jit(env.step)(state, 0.5 + jnp.zeros((3, 1)))  # the own jet is felt
        known = make_task(dataclasses.replace(task, observation="proximity"))
        seen = known.observe(state.chain, state.target, state.force)
        whole = state.obs, state.chain.present, state.chain.joined
        mine = policy.act(*whole)
        theirs = load("any-length").network.act(seen, *whole[1:])
        np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-6)


def test_a_critic_of_its_own_begins_fresh_and_the_actor_as_it_was():
    given = load("any-length").card.control
    own = dataclasses.replace(given, critic="sea")
    config = mixed(Mix((2, 3)), start="any-length", control=own)
    config = dataclasses.replace(config, task=dataclasses.replace(config.task, observation="sea"))
    policy = new_state(config, make_task(config.task)).policy
    old = load("any-length").network
    np.testing.assert_array_equal(policy.actor.layers[0].weight, old.actor.layers[0].weight)
    assert not np.array_equal(policy.critic.layers[0].weight, old.critic.layers[0].weight)
    assert policy.critic_trunk.first.linear.weight.shape[0] == observation_size("sea")


def test_a_critic_of_its_own_judges_by_how_things_are_whatever_is_sensed():
    plain = small(4)
    config = dataclasses.replace(plain, control=ControlConfig(critic="sea"))
    noisy = WorldConfig(sensing=SensingConfig(position=as_range(0.05)))
    tasks = [make_task(config.task, world) for world in ("still", noisy)]
    states = [jax.jit(jax.vmap(env.reset))(jr.split(jr.key(0), 3)) for env in tasks]
    assert np.abs(states[0].obs - states[1].obs).max() > 0.1
    policy = new_state(config, tasks[0]).policy
    told, lied = (values(*both) for both in zip(tasks, [policy] * 2, states, strict=True))
    np.testing.assert_allclose(told, lied, rtol=1e-5)
    shared = new_state(plain, tasks[0]).policy
    told, lied = (values(*both) for both in zip(tasks, [shared] * 2, states, strict=True))
    assert np.abs(told - lied).max() > 1e-3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"start": "nowhere"}, "no such run folder or policy: nowhere"),
        ({"start": "greedy"}, "greedy has no weights"),
        ({"control": ControlConfig()}, "another control"),
        ({"observation": "body"}, "observes proximity, with which what units .* does not begin"),
        ({"action": "pair"}, "another action: thrust, this run pair"),
    ],
)
def test_weights_that_do_not_fit_are_refused_before_anything_is_written(changes, said, tmp_path):
    control = changes.pop("control", load("any-length").card.control)
    start = changes.pop("start", "any-length")
    config = mixed(Mix((2, 3)), start=start, control=control)
    task = dataclasses.replace(config.task, **{"observation": "proximity", **changes})
    with pytest.raises(InputError, match=said):
        train(dataclasses.replace(config, task=task), tmp_path / "run")
    assert not (tmp_path / "run").exists()
