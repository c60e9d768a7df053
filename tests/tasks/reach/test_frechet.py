import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.tasks.reach.frechet import frechet_distance, within_frechet


def naive(one, other):
    """Eiter and Mannila's recursion, as they wrote it."""

    @functools.cache
    def table(i, j):
        here = float(np.linalg.norm(one[i] - other[j]))
        before = [table(a, b) for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if a >= 0 <= b]
        return max(here, min(before)) if before else here

    return table(len(one) - 1, len(other) - 1)


@pytest.mark.parametrize("length", [2, 3, 8, 33])
def test_the_distance_is_that_of_the_naive_recursion(length):
    rng = np.random.default_rng(length)
    for _ in range(10):
        one, other = (np.cumsum(rng.normal(size=(length, 2)), axis=0) for _ in range(2))
        ours = jax.jit(frechet_distance)(one.astype(np.float32), other.astype(np.float32))
        assert float(ours) == pytest.approx(naive(one, other), rel=1e-5)


def test_only_the_first_points_count():
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 9, 2)).astype(np.float32)
    ours = frechet_distance(jnp.asarray(one), jnp.asarray(other), 5)
    assert float(ours) == pytest.approx(naive(one[:5], other[:5]))


def test_a_chain_is_no_distance_from_itself_and_the_shift_from_its_shifted_self():
    line = jnp.stack([jnp.arange(6.0), jnp.zeros(6)], axis=-1)
    assert float(frechet_distance(line, line)) == 0.0
    assert float(frechet_distance(line, line + jnp.array([0.0, 0.25]))) == pytest.approx(0.25)


def test_the_leash_is_longer_for_a_chain_that_lies_the_other_way_round():
    """Every point of the one lies on a point of the other: a Hausdorff distance would be zero."""
    line = jnp.stack([jnp.arange(6.0), jnp.zeros(6)], axis=-1)
    assert float(frechet_distance(line, line[::-1])) == pytest.approx(5.0)


def test_the_quick_verdict_is_that_of_the_distance_alone_and_in_batches():
    rng = np.random.default_rng(1)
    one = np.cumsum(rng.normal(size=(200, 6, 2)) * 0.05, axis=1).astype(np.float32)
    other = one + (rng.normal(size=one.shape) * 0.03).astype(np.float32)
    limit = 0.06
    truth = np.array([naive(a, b) <= limit for a, b in zip(one, other, strict=True)])
    batch = jax.vmap(lambda a, b: within_frechet(a, b, 6, limit))(one, other)
    pairs = zip(jnp.asarray(one[:20]), jnp.asarray(other[:20]), strict=True)
    alone = [bool(within_frechet(a, b, 6, limit)) for a, b in pairs]
    assert 0.1 < truth.mean() < 0.9
    np.testing.assert_array_equal(batch, truth)
    np.testing.assert_array_equal(alone, truth[:20])


def test_a_chain_that_lags_behind_its_target_is_judged_by_the_coupling_not_point_by_point():
    """A leash may wait: units 0 and 1 are both paired with target point 0."""
    target = jnp.array([[0.0, 0.0], [0.07, 0.0], [0.13, 0.0], [0.14, 0.0]])
    chain = jnp.array([[0.0, 0.0], [0.01, 0.0], [0.07, 0.0], [0.14, 0.0]])
    exact = float(frechet_distance(chain, target))
    pointwise = float(jnp.linalg.norm(chain - target, axis=-1).max())
    assert exact < pointwise
    assert bool(within_frechet(chain, target, 4, exact + 1e-5))
    assert not bool(within_frechet(chain, target, 4, exact - 1e-5))
