import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
import scipy.stats

from salpchain.domain.pose import LINK, Bend, curve, draw, folded, spawn, target_pose
from salpchain.physics.chain import Physics, step

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


def many_folded(length, slots, count=400):
    def one(key):
        chain = spawn(draw(key), slots, length)
        return chain, folded(key, chain, length)

    return jax.jit(jax.vmap(one))(KEYS[:count])


@pytest.mark.parametrize(("length", "slots"), [(2, 5), (3, 3), (9, 9), (12, 16)])
def test_a_folded_chain_has_closed_joints_and_no_units_that_overlap(length, slots):
    straight, bent = many_folded(length, slots)
    position = np.asarray(bent.units.position)[:, :length]
    ahead = np.diff(position, axis=1)
    np.testing.assert_allclose(np.linalg.norm(ahead, axis=-1), LINK, atol=1e-5)
    angle = np.asarray(bent.links.angle)[:, : length - 1]
    np.testing.assert_allclose(np.cos(angle) * LINK, ahead[..., 0], atol=1e-5)
    np.testing.assert_allclose(np.sin(angle) * LINK, ahead[..., 1], atol=1e-5)
    np.testing.assert_array_equal(bent.units.position[:, 0], straight.units.position[:, 0])
    np.testing.assert_array_equal(bent.present, straight.present)
    assert not np.asarray(bent.rest_angle).any()
    still = jax.jit(jax.vmap(lambda chain: step(chain, jnp.zeros(slots), Physics())))(bent)
    assert not np.asarray(still.touching).any()


def test_folds_turn_by_up_to_half_a_circle_either_way_and_anywhere():
    _, bent = many_folded(16, 16, 2000)
    angle = np.asarray(bent.links.angle)
    total = angle[:, -1] - angle[:, 0]
    assert (np.abs(total) > 2.5).mean() > 0.05 and abs((total > 0).mean() - 0.5) < 0.05
    places = np.abs(np.diff(angle, axis=1)).argmax(axis=1)
    assert set(places) == set(range(14))


def test_a_straightened_fold_is_what_rests():
    """The springs of the joints push a folded chain back to straight."""
    _, bent = many_folded(4, 4, 20)
    run = jax.jit(jax.vmap(lambda chain: step(chain, jnp.zeros(4), Physics())))
    later = bent
    for _ in range(200):
        later = run(later)
    bend = lambda chain: np.abs(np.diff(np.asarray(chain.links.angle), axis=1)).sum(axis=1)  # noqa: E731
    assert (bend(later) < 0.9 * bend(bent) + 1e-3).all()
