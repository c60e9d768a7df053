import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
import scipy.stats

from salpchain.tasks.reach.targets import LINK, Bend, curve, draw, spawn, target_pose

KEYS = jr.split(jr.key(0), 4000)


def many_targets(length):
    return np.asarray(jax.jit(jax.vmap(lambda k: target_pose(draw(k), length, length)))(KEYS))


@pytest.mark.parametrize("length", [2, 5, 8, 64])
def test_neighbouring_target_points_are_one_link_apart(length):
    steps = np.diff(many_targets(length), axis=1)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=-1), LINK, atol=1e-5)


@pytest.mark.parametrize("length", [4, 16])
def test_the_first_target_point_is_uniform_in_the_four_squares(length):
    first = many_targets(length)[:, 0]
    near = length * LINK
    assert (np.abs(first) >= near - 1e-5).all() and (np.abs(first) <= 2 * near + 1e-5).all()
    for column in np.abs(first).T:
        assert scipy.stats.kstest(column, "uniform", (near, near)).pvalue > 1e-3
    quadrant = 2 * (first[:, 0] > 0) + (first[:, 1] > 0)
    assert scipy.stats.chisquare(np.bincount(quadrant, minlength=4)).pvalue > 1e-3


def test_targets_lie_on_one_arc_or_on_two_of_opposite_turn_with_the_stated_radii():
    length = 12
    steps = np.diff(many_targets(length), axis=1)
    angle = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    turns = np.diff(angle, axis=1)
    size = np.abs(turns)
    np.testing.assert_allclose(size, np.broadcast_to(size[:, :1], size.shape), atol=1e-3)
    radius = LINK / (2 * np.sin(size[:, 0] / 2))
    low, high = 0.05 * (length // 3), 0.3 * (length // 3)
    assert scipy.stats.kstest(radius, "uniform", (low, high - low)).pvalue > 1e-3
    changes = (np.diff(np.sign(turns), axis=1) != 0).sum(axis=1)
    assert set(changes) == {0, 1}
    assert abs((changes == 1).mean() - 0.5) < 0.03
    assert abs((turns[:, 0] > 0).mean() - 0.5) < 0.03


@pytest.mark.parametrize(("length", "on_first"), [(8, 4), (9, 5)])
def test_two_arcs_share_the_points_as_evenly_as_possible(length, on_first):
    bend = Bend(jnp.float32(0.2), jnp.float32(1.0), jnp.float32(1.0))
    steps = np.diff(np.asarray(curve(bend, 0.0, length, length)), axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert (turns[: on_first - 1] > 0).all() and (turns[on_first - 1 :] < 0).all()


def test_a_chain_starts_straight_at_rest_near_the_origin_with_every_joint_closed():
    chain = jax.jit(jax.vmap(lambda k: spawn(draw(k), 8, 8)))(KEYS[:500])
    position, angle = np.asarray(chain.units.position), np.asarray(chain.units.angle)
    assert (np.abs(position[:, 0]) <= 0.1).all()
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, :1]
    np.testing.assert_allclose(
        position, position[:, :1] + np.arange(8)[:, None] * LINK * along, atol=1e-5
    )
    links = np.asarray(chain.links.position)
    np.testing.assert_allclose(links, (position[:, 1:] + position[:, :-1]) / 2, atol=1e-6)
    assert scipy.stats.kstest(angle[:, 0], "uniform", (0, 2 * np.pi)).pvalue > 1e-3
    for bodies in (chain.units, chain.links):
        assert (
            not np.asarray(bodies.velocity).any() and not np.asarray(bodies.angular_velocity).any()
        )


def test_a_shorter_chain_in_more_slots_has_the_target_of_its_own_length():
    alone = target_pose(draw(jr.key(3)), 5, 5)
    slotted = target_pose(draw(jr.key(3)), 9, 5)
    np.testing.assert_allclose(slotted[:5], alone, atol=1e-6)
