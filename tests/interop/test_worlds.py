"""Every bridge swims in the world that it is given, or says what it cannot have."""

import pickle
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch

from salpchain.errors import InputError
from salpchain.interop.batch import Batch
from salpchain.interop.benchmarl import benchmarl_task
from salpchain.interop.brax import SalpBraxEnv
from salpchain.interop.checks import task_of
from salpchain.interop.drawing import Screen
from salpchain.interop.gymnasium import SalpEnv, SalpVectorEnv
from salpchain.interop.pettingzoo import SalpParallelEnv
from salpchain.interop.stable_baselines3 import SalpVecEnv
from salpchain.interop.steer import steering
from salpchain.interop.torchrl import SalpTorchEnv
from salpchain.interop.vmas import Scenario, make_env
from salpchain.physics.state import Physics
from salpchain.ranges import as_range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.world.config import (
    CurrentConfig,
    DynamicsConfig,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)
from salpchain.world.current import Uniform
from salpchain.world.randomise import as_world
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World
from tests.interop.policies import fresh

TASK = {"length": 2, "contact": False}
DEAD = WorldConfig(thrusters=ThrusterConfig(dead=as_range(1)))


BATCHED = [SalpEnv, SalpVectorEnv, SalpVecEnv, SalpParallelEnv, SalpTorchEnv]


@pytest.mark.parametrize("bridge", [*BATCHED, SalpBraxEnv, make_env, benchmarl_task])
def test_every_bridge_hands_on_its_world_or_refuses_it(bridge):
    """That chains then swim in it, `test_chains_in_a_world_swim_as_it_makes_them` shows."""
    envs = {"num_envs": 2} if bridge is make_env else {}
    env = bridge(world=DEAD, **envs, **TASK)
    if bridge in BATCHED:
        assert env._batch.env.world == as_world(DEAD)
    if bridge is SalpBraxEnv:
        assert env.scld.world == as_world(DEAD)
    if bridge is benchmarl_task:
        env = env.get_env_fun(2, True, 0, "cpu")()
        assert (env.rollout(1)["next", "unit", "reward"] == 0).all()
    if bridge is make_env:
        assert (env.step([torch.ones(2, 1)] * 2)[1][0] == 0).all()
    with pytest.raises(InputError, match="unknown world 'ruff': choose one of still, current"):
        bridge(world="ruff", **envs, **TASK)


def test_chains_in_a_world_swim_as_it_makes_them():
    """Each draws its own; without thrusters units keep still, and their velocity comes first."""
    world = replace(DEAD, dynamics=DynamicsConfig(drag=as_range("0.8:1.2")))
    batch = Batch(task_of(TASK), 4, renew=False, world=world)
    batch.reset(seed=3)
    outcome = pickle.loads(pickle.dumps(batch)).step(np.ones((4, 2, 1), np.float32))
    np.testing.assert_array_equal(outcome.obs[..., :2], 0.0)
    drags = [float(batch.one(i).world.dynamics.drag) for i in range(4)]
    assert len(set(drags)) == 4 and all(0.2 < drag < 0.3 for drag in drags)
    assert batch.one(2).world.dynamics.unit_mass == Physics().unit_mass  # what is fixed, too


def _picture(physics):
    env = SCLD(TaskConfig(**TASK), physics)
    return Screen().frame(replace(env.reset(jax.random.key(0)), world=env.world))


def test_worlds_and_physics_of_ones_own_are_taken_and_kept_apart():
    """Programs are shared by equal worlds alone, also by those that hold arrays."""
    drifts = [World(current=Uniform((speed, 0.0))) for speed in (0.05, 0.05, 0.1)]
    worlds = None, Physics(), Physics(unit_mass=2.0), *drifts, DEAD, "still"
    made = [Batch(task_of(TASK), 1, world=world)._programs for world in worlds]
    plain, same, heavy, drift, also, faster, dead, still = made
    assert plain is same is still and drift is also
    assert len({id(each) for each in (plain, heavy, drift, faster, dead)}) == 5
    pictures = [_picture(Physics(unit_width=width)) for width in (0.05, 0.02)]
    assert (pictures[0] != pictures[1]).any()  # of the same start, in its true size
    with pytest.raises(InputError, match=r"thrusters must be those of 2 units, got .*\(3,\)"):
        Batch(task_of(TASK), 1, world=World(thrusters=Thrusters(jnp.ones(3))))


def test_steering_takes_the_settings_of_an_environment_with_its_world():
    settings = {**TASK, "world": "rough"}
    assert callable(steering(fresh("gcn"), **settings))
    with pytest.raises(InputError, match="unknown world 'ruff'"):
        steering(fresh("gcn"), **TASK, world="ruff")


def swim(env, steps, push=0.0):
    for _ in range(steps):
        env.step([torch.full((env.num_envs, 1), push)] * len(env.agents))
    return env.scenario


def test_chains_drift_with_the_water_in_vmas():
    """Without thrust, a chain ends up as fast as the water."""
    speed = as_range(0.06)
    water = WorldConfig(current=CurrentConfig(speed=speed))
    env = make_env(3, seed=0, world=water, length=3, contact=False)
    drift = swim(env, 1).chains().velocity.norm(dim=-1)
    np.testing.assert_allclose(drift, 0.06 * Physics().drag, rtol=1e-3)  # a step from rest
    late = swim(env, 40).chains().velocity
    np.testing.assert_allclose(late.norm(dim=-1), 0.06, rtol=0.01)
    directions = late[:, 0] / 0.06
    assert (directions[0] - directions[1]).norm() > 0.01  # each has its own


def test_water_that_wanders_has_the_deviation_that_was_asked_for_in_vmas():
    wander = CurrentConfig(wander=as_range(0.05), relaxation=as_range(0.5))
    worlds = make_env(400, seed=0, world=WorldConfig(current=wander), length=2).scenario._worlds
    first = worlds.current
    for _ in range(20):
        worlds.advance()
    for water in (first, worlds.current):
        assert 0.045 < water.std() < 0.055
    assert abs(np.corrcoef(first.flatten(), worlds.current.flatten())[0, 1]) < 0.1


def test_thrusters_die_fail_and_lag_in_vmas_as_they_are_asked_to():
    some = ThrusterConfig(dead=as_range(0.25), failing=as_range(0.5), gain=as_range("0.5:0.8"))
    worlds = make_env(20, seed=0, world=WorldConfig(thrusters=some), length=4).scenario._worlds
    ones = torch.ones(20, 4)
    begun = worlds.thrust(ones)
    worlds._time += 10_000
    late = worlds.thrust(ones)
    assert ((late == 0).sum(dim=1) == 3).all() and (worlds._gain == 0).sum() == 20
    assert (begun[worlds._gain > 0] >= 0.5).float().mean() > 0.9 and begun.max() <= 0.8
    slow = ThrusterConfig(lag=as_range(0.2), one_sided=True)
    worlds = make_env(1, seed=0, world=WorldConfig(thrusters=slow), length=2).scenario._worlds
    ones = torch.tensor([[1.0, -1.0]])
    for steps in (1, 2):
        np.testing.assert_allclose(worlds.thrust(ones), [[1 - np.exp(-steps / 2), 0.0]], rtol=1e-5)


def test_readings_are_as_far_off_in_vmas_as_they_are_asked_to_be():
    off = {"position": 0.01, "angle": 0.1, "position_bias": 0.03}
    sensing = SensingConfig(**{name: as_range(value) for name, value in off.items()})
    scenario = make_env(500, seed=0, world=WorldConfig(sensing=sensing), length=2).scenario
    told, true = scenario.chains(), scenario._positions()
    again = swim(make_env(1, length=2), 1)  # another environment changes nothing of this one
    assert again._worlds is None
    np.testing.assert_array_equal(told.position, scenario.chains().position)
    assert 0.028 < (told.position - true).std() < 0.035
    assert 0.009 < told.velocity.std() < 0.011  # at rest
    before = told.position - true
    scenario._worlds.advance()
    after = scenario.chains().position - true
    assert 0.012 < (after - before).std() < 0.016  # the bias stayed


def test_a_reset_draws_a_new_world_for_that_chain_alone_in_vmas():
    water = WorldConfig(current=CurrentConfig(speed=as_range("0.02:0.06")))
    env = make_env(3, seed=0, world=water, length=2)
    before = env.scenario._worlds.current.clone()
    env.reset_at(1)
    changed = (env.scenario._worlds.current != before).any(dim=1)
    assert changed.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("world", "said"),
    [
        ("rough", r"without dynamics.mass, .*sensing.delay, sensing.action_delay: its worlds have"),
        (Physics(), r"in VMAS world must be a WorldConfig or one of still, .*, got "),
    ],
)
def test_what_vmas_cannot_have_is_refused(world, said):
    with pytest.raises(InputError, match=said):
        Scenario().make_world(1, "cpu", world=world, length=2)
