"""The VMAS scenario against our own engine, in the real VMAS."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
import vmas
from torchrl.envs import check_env_specs

from salpchain.errors import InputError
from salpchain.interop import torch_task
from salpchain.interop.vmas import Scenario, make_env, make_torchrl_env
from salpchain.physics.state import Bodies, Chain
from salpchain.tasks.features import OBSERVATIONS, senses
from salpchain.tasks.observations import observe
from salpchain.tasks.reach.frechet import frechet_distance
from salpchain.tasks.reach.reward import distances, reached, reward_terms
from salpchain.tasks.reach.task import SCLD

torch.set_num_threads(1)  # the arrays are tiny: more threads only wait for each other

ENVS = 6


def environment(length=5, envs=ENVS, **settings):
    return vmas.make_env(
        scenario=Scenario(), num_envs=envs, seed=0, length=length,
        terminated_truncated=True, max_steps=40, **settings,
    )  # fmt: skip


def fields(entities):
    """Position, angle, velocity and angular velocity of VMAS's entities, (env, body, ...)."""
    names = ("pos", "rot", "vel", "ang_vel")
    position, angle, velocity, spin = (
        jnp.asarray(np.stack([getattr(e.state, n).numpy() for e in entities], 1)) for n in names
    )
    return position, angle[..., 0], velocity, spin[..., 0]


@jax.jit
@jax.vmap
def chain_of(units, links):
    present = jnp.ones(units[1].shape, bool)
    rest = jnp.zeros((*links[1].shape, 2))
    none = jnp.zeros((), bool)
    return Chain(Bodies(*units), Bodies(*links), rest, present, present[1:], none)


def ours(env):
    """VMAS's chains as ours, (env,)."""
    return chain_of(
        fields(env.world.agents), fields([joint.landmark for joint in env.scenario._joints])
    )


def compared(domain):
    """What ours makes of chains, targets, forces, actions and the potentials before."""

    def judge(chain, target, force, before):
        now, goal = distances(chain, target), reached(chain, target)
        terms = reward_terms(before, now, goal)
        config = domain.config
        reward = terms["approach"] + terms["goal"] + config.fine_weight * terms["fine"]
        reward -= config.time_weight
        return domain.observe(chain, target, force), reward, goal, now

    return jax.jit(jax.vmap(judge))


def pushes(rng, env, steps):
    size = env.get_agent_action_size(env.agents[0])
    every = rng.uniform(-1, 1, (steps, len(env.agents), env.num_envs, size))
    return every.astype(np.float32)


@pytest.mark.parametrize(
    ("observation", "action", "fence"), [("body", "pair", False), ("table1", "thrust", True)]
)
def test_observations_rewards_and_dones_are_ours_on_the_same_states(observation, action, fence):
    weights = {"fine_weight": 0.5, "time_weight": 0.02}
    env = environment(observation=observation, action=action, fence=fence, **weights)
    scenario, domain = env.scenario, SCLD(env.scenario.config)
    if fence:  # a chain about to touch it
        shift = scenario._fence - 1e-4 - scenario.chains().position[1, :, 0].max()
        for entity in env.world.entities:
            entity.state.pos[1, 0] += shift
    scenario._target[2] = scenario.chains().position[2] + 0.01  # a chain that has arrived
    there = torch_task.potentials(scenario.chains().position, scenario._target)
    for old, new in zip((scenario._approach, scenario._fine), there, strict=True):
        old[1:3] = new[1:3]  # of the chains that were moved
    target, judge = jnp.asarray(scenario._target.numpy()), compared(domain)
    before = jax.jit(jax.vmap(distances))(ours(env), target)
    step = jax.jit(jax.vmap(domain.step))
    states = jax.vmap(domain.start)(ours(env), target, jax.random.split(jax.random.key(0), ENVS))
    dones = np.zeros(ENVS, bool)
    for push in pushes(np.random.default_rng(0), env, 10):
        states = eqx.tree_at(lambda s: s.chain, states, ours(env))
        states = step(states, jnp.asarray(push.swapaxes(0, 1)))
        obs, rewards, terminated, truncated, _ = env.step([torch.tensor(p) for p in push])
        np.testing.assert_allclose(ours(env).units.position, states.chain.units.position, atol=2e-4)
        force = jnp.asarray(scenario.chains().force.numpy())
        np.testing.assert_allclose(force, states.force, atol=1e-5)
        seen, reward, goal, before = judge(ours(env), target, force, before)
        np.testing.assert_allclose(np.stack(obs, 1), seen, atol=1e-4)
        for unit in rewards:
            np.testing.assert_allclose(unit, reward, atol=1e-5)
        at_fence = (np.abs(ours(env).units.position) >= (scenario._fence or np.inf)).any((1, 2))
        np.testing.assert_array_equal(terminated, goal | at_fence)
        assert not truncated.any()
        dones |= terminated.numpy()
    assert dones[2] and not dones.all() and dones[1] == fence


def test_every_observation_is_ours_on_the_same_states():
    env = environment(envs=3)
    for push in pushes(np.random.default_rng(1), env, 30):
        env.step([torch.tensor(p) for p in push])
    chains = env.scenario.chains()
    target, force = jnp.asarray(chains.target.numpy()), jnp.asarray(chains.force.numpy())
    for name in (name for name in OBSERVATIONS if not senses(name)):
        expected = jax.vmap(partial(observe, name))(ours(env), target, force)
        np.testing.assert_allclose(torch_task.observe(name, chains), expected, atol=1e-4)
    assert np.abs(expected).max() > 0.1
    with pytest.raises(InputError, match=r"body\*2 is of several control steps .* choose body"):
        torch_task.observe("body*2", chains)
    with pytest.raises(InputError, match="around senses water, surface, thruster, which"):
        torch_task.observe("around", chains)


def test_the_frechet_distance_is_ours():
    rng = np.random.default_rng(0)
    for points in (2, 7):
        one, other = rng.normal(size=(2, 20, points, 2)).astype(np.float32)
        expected = jax.vmap(frechet_distance)(jnp.asarray(one), jnp.asarray(other))
        found = torch_task.frechet_distance(torch.tensor(one), torch.tensor(other))
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_targets_and_starts_are_those_of_our_task():
    """Chords of one link, first points within the paper's bounds, both kinds of target."""
    torch.manual_seed(0)
    target = torch_task.target_pose(500, 9, "cpu")
    chords = target.diff(dim=1)
    np.testing.assert_allclose(chords.norm(dim=-1), 0.07, atol=1e-5)
    first = target[:, 0].abs() / (9 * 0.07)
    assert 1 <= first.min() < 1.05 and 1.95 < first.max() <= 2
    turn = chords[:, 1:, 0] * chords[:, :-1, 1] - chords[:, 1:, 1] * chords[:, :-1, 0]
    double = (turn[:, :1].sign() != turn[:, -1:].sign()).float().mean()
    assert 0.4 < double < 0.6
    position, angle = torch_task.spawn(500, 9, "cpu")
    assert 0.09 < position[:, 0].abs().max() <= 0.1
    along = (position[:, 1] - position[:, 0]) / 0.07
    np.testing.assert_allclose(along, torch.stack([angle.cos(), angle.sin()], 1), atol=1e-5)


def test_a_chain_starts_at_rest_and_stays_so_without_thrust():
    """The original study's links started half a link outside and jolted the chain."""
    env = environment(length=8)
    start = env.scenario.chains().position.clone()
    for _ in range(5):
        env.step([torch.zeros(ENVS, 1)] * 8)
    np.testing.assert_allclose(env.scenario.chains().position, start, atol=1e-6)


def test_resetting_one_environment_leaves_the_others_bit_identical():
    env = environment()
    for push in pushes(np.random.default_rng(0), env, 3):
        env.step([torch.tensor(p) for p in push])
    before = [x.copy() for x in map(np.asarray, jax.tree.leaves(ours(env)))]
    target = env.scenario._target.clone()
    obs = env.reset_at(3)
    others = np.arange(ENVS) != 3
    for old, new in zip(before, map(np.asarray, jax.tree.leaves(ours(env))), strict=True):
        np.testing.assert_array_equal(old[others], new[others])
    np.testing.assert_array_equal(target[others], env.scenario._target[others])
    assert not (target[3] == env.scenario._target[3]).any()
    assert not ours(env).units.velocity[3].any() and obs is not None


def test_it_is_truncated_at_vmas_s_own_limit():
    env = environment(length=2, envs=2)
    ends = [env.step([torch.zeros(2, 1)] * 2)[3].all().item() for _ in range(40)]
    assert ends == [False] * 39 + [True]


def test_a_nan_is_named_with_its_environment_and_moves_nothing():
    env = make_env(4, length=3, action="pair")
    before = env.scenario.chains().position.clone()
    action = [torch.zeros(4, 2) for _ in range(3)]
    action[1][2, 0] = torch.nan
    with pytest.raises(InputError, match=r"environment 2, unit_1, holds \[nan, 0.0\]"):
        env.step(action)
    np.testing.assert_array_equal(env.scenario.chains().position, before)
    assert (env.steps == 0).all()
    through_torchrl = make_torchrl_env(num_envs=2, length=2)
    start = through_torchrl.reset()
    start["unit", "action"] = torch.full((2, 2, 1), torch.nan)
    with pytest.raises(InputError, match="environment 0, unit_0, holds"):
        through_torchrl.step(start)


@pytest.mark.parametrize(
    ("actions", "word"),
    [
        ([torch.zeros(2, 1)], "each of 2 units, got 1"),
        ({"unit_0": torch.zeros(2, 1), "unit_7": torch.zeros(2, 1)}, "each of 2 units"),
        ([torch.zeros(3, 1)] * 2, r"unit_0 must have shape \(2, 1\), got \(3, 1\)"),
        ([torch.zeros(2, 1), torch.zeros(2, 2)], r"unit_1 must have shape \(2, 1\), got \(2, 2\)"),
        ([torch.zeros(2, 1, dtype=torch.int64)] * 2, "unit_0 must be floating point"),
        ([torch.full((2, 1), torch.inf)] * 2, r"environment 0, unit_0, holds \[inf\]"),
        (["go", "stop"], "unit_0 must be numbers, got 'go'"),
    ],
)
def test_a_bad_action_is_named_and_moves_nothing(actions, word):
    env = make_env(2, length=2)
    before = env.scenario.chains().position.clone()
    with pytest.raises(InputError, match=word):
        env.step(actions)
    np.testing.assert_array_equal(env.scenario.chains().position, before)


def test_a_number_of_environments_that_cannot_be_is_refused():
    for make in (make_env, make_torchrl_env):
        with pytest.raises(InputError, match="num_envs must be 1 to"):
            make(num_envs=0, length=2)


def test_a_unit_that_was_put_elsewhere_is_seen_there():
    env = make_env(1, length=2)
    before = env.reset()
    env.agents[1].set_pos(torch.tensor([[5.0, 5.0]]), batch_index=None)
    after = env.get_from_scenario(True, False, False, False)[0]
    assert not torch.equal(after[1], before[1])


@pytest.mark.parametrize("length", [2, 8, 64])
def test_the_picture_holds_every_target(length):
    env = make_env(200, length=length, seed=0)
    assert env.scenario._target.abs().max() < env.scenario.viewer_zoom


@pytest.mark.parametrize("steps", [0, -1])
def test_a_time_limit_that_cannot_be_is_refused(steps):
    with pytest.raises(InputError, match="max_steps must be a whole number, 1 or more"):
        make_torchrl_env(num_envs=1, length=2, max_steps=steps)


def test_everything_moves_to_another_device():
    env = environment(length=2, envs=2)
    env.scenario.to("meta")
    held = jax.tree.leaves(list(vars(env.scenario).values()))
    tensors = [value for value in held if isinstance(value, torch.Tensor)]
    assert len(tensors) >= 6 and all(value.device.type == "meta" for value in tensors)


def test_an_unknown_setting_is_refused():
    with pytest.raises(InputError, match="unknown setting of the task 'lenght'"):
        vmas.make_env(scenario=Scenario(), num_envs=1, lenght=8)


def test_torchrl_truncates_at_the_time_limit():
    env = make_torchrl_env(num_envs=3, length=2, max_steps=5)
    check_env_specs(env)
    steps = env.rollout(8, break_when_any_done=False)["next"]
    ends = [0, 0, 0, 0, 1, 0, 0, 0]
    np.testing.assert_array_equal(steps["truncated"][0, :, 0], ends)
    np.testing.assert_array_equal(steps["done"][0, :, 0], ends)
    assert not steps["terminated"].any()


def test_torchrl_is_told_of_a_goal():
    env = make_torchrl_env(num_envs=3, length=2)
    start = env.reset()
    scenario = env.base_env.scenario
    scenario._target[1] = scenario.chains().position[1]
    start["unit", "action"] = torch.zeros(3, 2, 1)
    end = env.step(start)["next"]
    np.testing.assert_array_equal(end["terminated"][:, 0], [0, 1, 0])
    assert not end["truncated"].any()


def test_it_is_drawn_by_vmas_s_own_renderer():
    import pyglet

    pyglet.options["headless"] = True
    env = environment(length=3, envs=1)
    try:
        picture = env.render(mode="rgb_array", env_index=0)
    except Exception as error:  # what pyglet raises where no OpenGL is depends on the machine
        pytest.skip(f"VMAS's renderer needs OpenGL (EGL) here: {error!r}")
    assert picture.ndim == 3 and len(np.unique(picture.reshape(-1, 3), axis=0)) >= 3
