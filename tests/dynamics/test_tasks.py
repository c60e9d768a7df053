"""Tasks with chains of robots that exist: lengths, times and settings."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.evaluation.difficulty import start_of
from salpchain.physics.state import Physics
from salpchain.ranges import as_range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.follow.task import Follow
from salpchain.tasks.reach.task import SCLD
from salpchain.training.settings import preset, typed
from salpchain.world.config import CurrentConfig, DynamicsConfig, ObstacleConfig, WorldConfig
from salpchain.world.world import World

KINDS = ("landsalp", "water")


def world(kind, **others):
    return WorldConfig(dynamics=DynamicsConfig(kind=kind, **others))


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_is_that_of_the_paper_in_lengths_of_a_link(kind):
    config = TaskConfig(length=6, time_limit="scaled")
    env, paper = SCLD(config, world(kind)), SCLD(config)
    state, known = env.reset(jr.key(1), 5), paper.reset(jr.key(1), 5)
    links = float(state.distances.mean) / 0.272, float(known.distances.mean) / 0.07
    assert links[0] == pytest.approx(links[1], rel=0.1)
    assert env.step_limit(5) == paper.step_limit(5)
    assert float(state.distances.log) == pytest.approx(float(known.distances.log), rel=0.05)
    for _ in range(2):
        state = env.step(state, jnp.ones((6, 1)))
    assert np.all(np.isfinite(state.obs)) and np.abs(state.obs).max() < 4
    assert np.abs(state.obs[:5, :2]).max() > 0.1  # velocities of the size that policies know
    assert float(start_of(env, state).reachable) > 0.5


def test_its_target_is_a_pose_that_it_can_take():
    env = SCLD(TaskConfig(length=5), world("landsalp"))
    target = np.asarray(jax.jit(env.reset)(jr.key(3)).target)
    chords = np.linalg.norm(np.diff(target, axis=0), axis=1)
    assert np.all(chords <= 0.272 + 1e-5) and np.all(chords > 0.15)


def test_the_goal_is_as_near_as_the_papers_in_lengths_of_a_link():
    env = SCLD(TaskConfig(length=3), world("landsalp"))
    state = env.reset(jr.key(3))
    for aside, reached in ((0.19, True), (0.21, False)):
        target = state.chain.units.position + jnp.array([aside, 0.0])
        judged = env.step(env.start(state.chain, target, jr.key(0)), jnp.zeros((3, 1)))
        assert bool(judged.goal) == reached


def test_a_target_to_follow_moves_as_fast_as_the_papers_in_links_of_a_step():
    moved = []
    for where in (world("landsalp"), None):
        env = Follow(world=where) if where else Follow()
        state = env.reset(jr.key(0))
        after = env.step(state, jnp.zeros((8, 1)))
        link = float(env.physics.link_length)
        moved.append(float(jnp.linalg.norm((after.target - state.target).mean(axis=0))) / link)
    assert moved[0] == pytest.approx(moved[1], rel=1e-3)


def test_a_kind_is_set_in_short_or_in_full():
    assert typed(["world.dynamics=landsalp"]) == {"world.dynamics.kind": "landsalp"}
    assert preset(settings={"world.dynamics": "water"}).world.dynamics.kind == "water"
    assert WorldConfig().dynamics.kind == "vmas" and isinstance(World().dynamics, Physics)


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_kind_does_not_know_is_refused(kind):
    with pytest.raises(InputError, match=rf"kind={kind} knows no world\.obstacles"):
        WorldConfig(
            dynamics=DynamicsConfig(kind=kind), obstacles=ObstacleConfig(posts=as_range(2.0))
        )
    with pytest.raises(InputError, match=r"unknown world\.dynamics\.kind 'land'"):
        DynamicsConfig(kind="land")
    config = TaskConfig(length=2, fence=True)
    with pytest.raises(InputError, match="the fence holds the paper's chains only"):
        env = SCLD(config, world(kind))
        env.step(env.reset(jr.key(0)), jnp.zeros((2, 1)))


def test_chains_of_links_that_never_open_neither_part_nor_join():
    config = TaskConfig(length=2, action="grip")
    with pytest.raises(InputError, match="only the paper's chains part and join"):
        jax.eval_shape(SCLD(config, world("landsalp")).reset, jr.key(0))


def test_the_ground_knows_no_current_and_no_mass():
    with pytest.raises(InputError, match=r"knows no world\.current"):
        WorldConfig(
            dynamics=DynamicsConfig(kind="landsalp"), current=CurrentConfig(speed=as_range(0.1))
        )
    with pytest.raises(InputError, match=r"knows no world\.dynamics\.mass"):
        world("landsalp", mass=as_range(2.0))
