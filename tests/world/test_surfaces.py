"""What units sense of walls and posts, against points laid out on their surfaces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.physics.state import Chain
from salpchain.world.obstacles import make_obstacles
from salpchain.world.surfaces import nearest_surface, rays
from tests.physics.poses import lively

WALLS = [((-0.2, 0.25), (0.5, 0.15), 0.1), ((0.3, -0.4), (0.35, -0.05), 0.03)]
POSTS = [((-0.2, -0.05), 0.08), ((0.1, -0.2), 0.02)]
AROUND = make_obstacles(WALLS, POSTS, slots=(4, 3))


def outline():
    """Many points (m) on all surfaces."""
    share = np.linspace(0, 1, 40_001)[:, None]
    points = []
    for begin, end, width in WALLS:
        along = np.subtract(end, begin)
        side = width / 2 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        loop = [begin + side, end + side, end - side, begin - side]
        points += [a + share * (b - a) for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    turn = 2 * np.pi * share
    points += [np.add(c, r * np.hstack([np.cos(turn), np.sin(turn)])) for c, r in POSTS]
    return np.concatenate(points)


def units(chain: Chain):
    """Positions, and the axes of each unit, of those that are outside of everything."""
    angle = np.asarray(chain.units.angle)
    axes = (
        np.stack([np.cos(angle), np.sin(angle)], -1),
        np.stack([-np.sin(angle), np.cos(angle)], -1),
    )
    return zip(np.asarray(chain.units.position), *axes, strict=True)


@pytest.fixture(scope="module")
def chain():
    return lively(np.random.default_rng(5), 6)


def test_the_nearest_surface_is_felt_in_the_units_own_axes_and_fades_with_distance(chain):
    felt, surface = np.asarray(nearest_surface(chain, AROUND, 0.15)), outline()
    near = 0
    for ours, (place, along, across) in zip(felt, units(chain), strict=True):
        apart = surface - place
        distance = np.linalg.norm(apart, axis=-1)
        least = distance.argmin()
        size = max(0.0, 1 - distance[least] / 0.15) / distance[least]
        expected = size * apart[least] @ np.stack([along, across], 1)
        np.testing.assert_allclose(ours, expected, atol=3e-3)
        near += size > 0
    assert near >= 3


def test_rays_end_at_the_first_surface_in_their_way(chain):
    seen, surface = np.asarray(rays(chain, AROUND, 12, 0.4)), outline()
    hits = 0
    for ours, (place, along, across) in zip(seen, units(chain), strict=True):
        for k, fraction in enumerate(ours):
            turn = 2 * np.pi * k / 12
            ray = np.cos(turn) * along + np.sin(turn) * across
            ahead, aside = (surface - place) @ ray, np.abs((surface - place) @ [-ray[1], ray[0]])
            met = ahead[(aside < 3e-5) & (ahead > 0)]
            expected = min(1.0, met.min() / 0.4) if met.size else 1.0
            assert fraction == pytest.approx(expected, abs=0.008)
            hits += fraction < 1
    assert 10 < hits < 60


def test_units_that_are_not_there_and_obstacles_that_are_not_there_give_nothing(chain):
    nowhere = make_obstacles(slots=(2, 1))
    assert (nearest_surface(chain, nowhere) == 0).all()
    assert (nearest_surface(chain, make_obstacles()) == 0).all()
    assert (rays(chain, nowhere) == 1).all()
    assert (rays(chain, make_obstacles()) == 1).all()


def test_batches_sense_what_each_chain_senses_and_slopes_are_finite():
    chains = lively(np.random.default_rng(6), 5, batch=4)

    def sensed(chain: Chain):
        return jnp.concatenate([nearest_surface(chain, AROUND), rays(chain, AROUND, 5)], 1)

    together = jax.jit(jax.vmap(sensed))(chains)
    for k in range(4):
        alone = sensed(jax.tree.map(lambda x, k=k: x[k], chains))
        np.testing.assert_allclose(together[k], alone, atol=1e-5)
    slopes = jax.grad(lambda c: sensed(c).sum(), allow_int=True)(
        jax.tree.map(lambda x: x[0], chains)
    )
    assert np.isfinite(slopes.units.position).all()
    assert np.abs(slopes.units.position).max() > 0
