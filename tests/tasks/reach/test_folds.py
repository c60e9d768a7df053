"""Folded starts: whole chains that overlap nowhere, folded anywhere or on the target."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.physics.chain import step
from salpchain.physics.state import Physics
from salpchain.tasks.reach.folds import folded, stalled
from salpchain.tasks.reach.targets import LINK, draw, spawn, target_pose

KEYS = jr.split(jr.key(0), 2000)


def starts_on_target(length, slots, count=400):
    def one(key):
        chance = draw(key)
        chain, target = spawn(chance, slots, length), target_pose(chance, slots, length)
        return target, stalled(key, chain, target, length)

    return jax.jit(jax.vmap(one))(KEYS[:count])


def many_folded(length, slots, count=400):
    def one(key):
        chain = spawn(draw(key), slots, length)
        return chain, folded(key, chain, length)

    return jax.jit(jax.vmap(one))(KEYS[:count])


@pytest.mark.parametrize("make", [many_folded, starts_on_target])
@pytest.mark.parametrize(("length", "slots"), [(2, 5), (3, 3), (9, 9), (12, 16)])
def test_a_folded_chain_has_closed_joints_and_no_units_that_overlap(make, length, slots):
    _, bent = make(length, slots)
    position = np.asarray(bent.units.position)[:, :length]
    ahead = np.diff(position, axis=1)
    np.testing.assert_allclose(np.linalg.norm(ahead, axis=-1), LINK, atol=1e-5)
    angle = np.asarray(bent.links.angle)[:, : length - 1]
    np.testing.assert_allclose(np.cos(angle) * LINK, ahead[..., 0], atol=1e-5)
    np.testing.assert_allclose(np.sin(angle) * LINK, ahead[..., 1], atol=1e-5)
    assert (np.asarray(bent.present).sum(axis=1) == length).all()
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


def test_a_folded_chain_stays_where_its_first_unit_is():
    straight, bent = many_folded(9, 12)
    np.testing.assert_array_equal(bent.units.position[:, 0], straight.units.position[:, 0])
    turned = np.asarray(bent.links.angle - straight.links.angle)[:, 0]
    np.testing.assert_allclose(np.cos(turned), 1, atol=1e-6)


@pytest.mark.parametrize("slots", [16, 20])
def test_a_stalled_chain_lies_in_part_on_its_target_and_in_part_folded_back(slots):
    target, bent = (jax.tree.map(np.asarray, x) for x in starts_on_target(16, slots, 2000))
    apart = np.linalg.norm(bent.units.position - target, axis=-1)[:, :16]
    assert apart.min(axis=1).max() < 1e-3
    assert set(apart.argmin(axis=1)) == set(range(15))
    in_place = (apart < LINK).mean(axis=1)
    assert 0.3 < in_place.mean() < 0.8
    aim = np.diff(target, axis=1)[:, :15]
    along = bent.links.angle[:, :15] - np.arctan2(aim[..., 1], aim[..., 0])
    back = (np.cos(along) < -0.5).any(axis=1)
    assert 0.1 < back.mean() < 0.6 and (np.cos(along).max(axis=1) > 0.9).all()
