"""The task `follow`: how its target moves, and what it measures."""

import functools

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.tasks.follow.config import FollowConfig
from salpchain.tasks.follow.task import Follow
from salpchain.tasks.reach.task import SCLD

SPEED, LENGTH, SLOTS = 0.08, 5, 7


@functools.cache
def swum(steps=40):
    """The targets of an episode (time, unit, 2), its last state, and the task."""
    env = Follow(FollowConfig(SLOTS, speed=SPEED, turning=2.0, contact=False))
    state = jax.jit(lambda key: env.reset(key, LENGTH))(jr.key(3))
    action = jnp.zeros((SLOTS, 1))
    last, targets = jax.lax.scan(
        lambda state, _: (env.step(state, action), state.target), state, None, length=steps
    )
    return np.asarray(targets)[:, :LENGTH], last, env


def test_the_target_starts_where_that_of_reach_does():
    targets, _, env = swum()
    reach = SCLD(env.config).reset(jr.key(3), LENGTH)
    np.testing.assert_allclose(targets[0], reach.target[:LENGTH], atol=1e-6)


def test_its_centroid_moves_at_the_given_speed_on_a_path_that_turns_smoothly():
    targets, _, env = swum()
    way = np.diff(targets.mean(axis=1), axis=0)
    dt = float(env.physics.control_step)
    np.testing.assert_allclose(np.linalg.norm(way, axis=-1), SPEED * dt, rtol=1e-3)
    turned = np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
    most = 2.0 * SPEED * dt / (LENGTH * float(env.physics.link_length))
    assert 0.01 * most < np.abs(turned).max() <= 1.01 * most


def test_it_turns_with_its_path_as_a_rigid_body():
    targets, _, _ = swum()
    apart = np.linalg.norm(targets[:, :, None] - targets[:, None], axis=-1)
    np.testing.assert_allclose(apart, apart[:1].repeat(len(apart), 0), atol=1e-5)
    way = np.diff(targets.mean(axis=1), axis=0)
    pose = targets[1:, -1] - targets[1:, 0]
    between = np.arctan2(pose[:, 1], pose[:, 0]) - np.arctan2(way[:, 1], way[:, 0])
    np.testing.assert_allclose(np.exp(1j * between), np.exp(1j * between[0]), atol=2e-3)


def test_the_reward_is_for_drawing_nearer_and_for_being_close():
    _, last, env = swum()
    before = float(last.distances.mean)
    after = env.step(last, jnp.zeros((SLOTS, 1)))
    near = np.exp(-float(after.distances.mean) / 0.05)
    assert float(after.terms["close"]) == pytest.approx(near, rel=1e-4)
    gained = before - float(after.distances.mean)
    assert float(after.reward) == pytest.approx(gained + 0.1 * near, abs=1e-6)
    assert not bool(after.terminated)


def test_measures_count_from_the_first_approach_on():
    distance = np.array([0.5, 0.3, 0.09, 0.04, 0.12, 0.03])
    found = Follow().measure({"distance": distance})
    assert found["steps_to_approach"] == 3
    assert found["tracking_distance"] == pytest.approx(np.mean(distance[2:]))
    assert found["tracking_distance_p95"] == pytest.approx(np.percentile(distance[2:], 95))
    assert (found["within_5cm"], found["within_10cm"]) == (0.5, 0.75)
    never = Follow().measure({"distance": np.array([0.5, 0.4])})
    assert np.isnan(never["tracking_distance"]) and never["within_10cm"] == 0.0


@pytest.mark.parametrize("setting", [{"speed": -0.1}, {"speed": 0.6}, {"turning": np.nan}])
def test_a_speed_or_a_turning_that_cannot_be_is_refused(setting):
    with pytest.raises(InputError, match="must be a number, 0 to"):
        FollowConfig(**setting)
