"""Walls and posts as in the real VMAS: boxes and spheres that neither move nor turn.

VMAS exerts nothing where a unit and a wall overlap; there ours has a law of its own, and nothing is
compared. It looks at an obstacle in all its environments as soon as circles meet in one (see
`VmasChains`). At posts that matters, for their circles meet a corner's late: one chain in a world.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.physics.chain import step
from salpchain.physics.obstacles import Solids, _solid_against_unit
from salpchain.physics.state import Physics, at_rest
from salpchain.world.obstacles import check_clear, make_obstacles
from tests.physics import vmas_chain
from tests.physics.poses import bent
from tests.physics.test_against_vmas import distance, held_thrusts
from tests.physics.vmas_chain import VmasChains

# Around chains of 4 that start at the origin: walls of several widths and lengths, askew.
WALLS = [
    ((-0.6, -0.2), (0.6, -0.25), 0.02),
    ((-0.5, 0.22), (0.6, 0.25), 0.1),
    ((0.28, -0.5), (0.22, 0.5), 0.05),
    ((-0.25, -0.1), (-0.3, 0.1), 0.04),
]
POSTS = [
    ((0.15 * i, 0.15 * j), 0.02 + 0.01 * (i > 0))
    for i in (-1.5, -0.5, 0.5, 1.5)
    for j in (-1.5, -0.5, 0.5, 1.5)
]


def inside_a_wall(position, angle):
    """Whether some unit of each chain comes within 0.2 mm of a wall or into it, (batch,)."""
    size = np.array([[0.02, 0.025], [-0.02, 0.025], [-0.02, -0.025], [0.02, -0.025]])
    turn = np.stack([np.cos(angle), np.sin(angle)], -1)
    across = np.stack([-turn[..., 1], turn[..., 0]], -1)
    corners = position[..., None, :] + size[:, :1] * turn[..., None, :]
    corners = corners + size[:, 1:] * across[..., None, :]
    sides = (corners + np.roll(corners, 1, axis=-2)) / 2
    found = np.zeros(len(position), bool)
    for begin, end, width in WALLS:
        begin, along = np.array(begin), np.subtract(end, begin)
        length = np.linalg.norm(along)
        x, y = along / length
        for points in (corners, sides):
            u = (points - begin) @ np.array([x, y])
            v = (points - begin) @ np.array([-y, x])
            near = (u > -2e-4) & (u < length + 2e-4) & (np.abs(v) < width / 2 + 2e-4)
            found |= near.any(axis=(1, 2))
        ends = begin + np.outer([0, 1], along), width / 2 * np.array([-y, x])
        for corner in np.concatenate([ends[0] + ends[1], ends[0] - ends[1]]):
            apart = corner - position
            u, v = np.abs((apart * turn).sum(-1)), np.abs((apart * across).sum(-1))
            found |= ((u < 0.0202) & (v < 0.0252)).any(axis=1)
    return found


def compare(vmas, obstacles, pushes):
    """Position errors (m) of each control step from VMAS's state, (step, batch, body).

    Also those of steps without obstacles, and whether the chain came into no wall, (step, batch).
    """
    around = jax.jit(jax.vmap(lambda c, t: step(c, t, obstacles=obstacles)))
    nowhere = jax.jit(jax.vmap(step))
    errors, effects, valid = [], [], []
    for thrust in pushes:
        before = vmas.chain
        vmas.step(thrust)
        after = vmas.chain
        errors.append(distance(after, around(before, thrust)))
        effects.append(distance(after, nowhere(before, thrust)))
        inside = [
            inside_a_wall(c.units.position, np.asarray(c.units.angle)) for c in (before, after)
        ]
        valid.append(~np.logical_or(*inside))
    return np.array(errors), np.array(effects), np.array(valid)


def clear_starts(rng, batch, num, obstacles):
    """Positions and angles of bent chains around the origin that no obstacle covers."""
    found = []
    while len(found) < batch:
        position, angle = (x[0] for x in bent(rng, 1, num, 0.6))
        try:
            check_clear(at_rest(jnp.asarray(position, float), jnp.asarray(angle, float)), obstacles)
        except InputError:
            continue
        found.append((position, angle))
    return [np.stack(some) for some in zip(*found, strict=True)]


def test_one_control_step_of_chains_at_walls_agrees_with_vmas():
    rng, obstacles = np.random.default_rng(0), make_obstacles(WALLS)
    vmas = VmasChains(*clear_starts(rng, 50, 4, obstacles), walls=WALLS)
    errors, effects, valid = compare(vmas, obstacles, held_thrusts(rng, 50, 4, 40))
    pushed = (effects.max(-1) > 1e-3) & valid
    assert np.count_nonzero(pushed) > 100
    assert np.median(errors[pushed]) <= 5e-6
    assert errors[valid & ~pushed].max() <= 2e-4
    # a contact at the very threshold sets in a substep later in one than in the other
    assert np.mean(errors[pushed].max(-1) > 2e-4) <= 0.02


@pytest.mark.slow
def test_one_control_step_of_chains_at_posts_agrees_with_vmas():
    rng, obstacles = np.random.default_rng(0), make_obstacles(posts=POSTS)
    found = []
    for position, angle in zip(*clear_starts(rng, 8, 4, obstacles), strict=True):
        vmas = VmasChains(position[None], angle[None], posts=POSTS)
        found.append(compare(vmas, obstacles, held_thrusts(rng, 1, 4, 26))[:2])
    errors, effects = (np.concatenate(some)[:, 0] for some in zip(*found, strict=True))
    pushed = effects.max(-1) > 1e-3
    assert np.count_nonzero(pushed) > 30
    assert np.median(errors[pushed]) <= 5e-6
    assert errors[~pushed].max() <= 2e-4
    assert np.mean(errors[pushed].max(-1) > 2e-4) <= 0.08


@pytest.mark.parametrize("radius", [0.01, 0.06])
def test_a_post_presses_on_a_unit_as_in_vmas_inside_it_too(radius):
    rng, count = np.random.default_rng(0), 20_000
    distance, bearing = rng.uniform(0, 0.035 + radius, count), rng.uniform(0, 2 * np.pi, count)
    offset = (distance * np.array([np.cos(bearing), np.sin(bearing)])).astype(np.float32)
    angle = rng.uniform(-7, 7, count).astype(np.float32)
    theirs = vmas_chain.box_on_sphere(offset, angle, radius)

    turn = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    still = jnp.broadcast_to(jnp.array([1.0, 0.0])[:, None], turn.shape)
    post = Solids(jnp.asarray(offset), still, 0 * still, jnp.full(count, radius))
    *force, torque = _solid_against_unit(Physics(), post, 0 * turn, turn)
    pressed = np.abs(theirs[0]).max(0) > 0
    assert 0.5 < pressed.mean() < 0.99
    for their, our, bar in zip(theirs, (np.stack(force), torque), (5e-3, 1e-4), strict=True):
        error = np.abs(their - np.asarray(our)).reshape(-1, count).max(0)  # N, N m
        assert np.median(error[pressed]) <= bar / 10
        assert np.mean(error > bar) <= 1e-3
