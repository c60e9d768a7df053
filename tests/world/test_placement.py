"""Obstacles drawn for each episode: as many as asked, and none in the way of start or target."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.physics.state import Physics, at_rest
from salpchain.ranges import Range
from salpchain.world.config import ObstacleConfig
from salpchain.world.placement import PASSAGE, WIDTH, place_obstacles

SLOTS, LINK = 9, Physics.link_length
LENGTHS = np.tile([2, 5, 9], 20)
PLACES = jnp.stack([LINK * jnp.arange(SLOTS), jnp.zeros(SLOTS)], axis=-1)
CROWDED = ObstacleConfig(
    posts=Range(0, 6), walls=Range(2, 4), room=Range(0.2, 0.5), aside=Range(0.0, 0.9)
)


def placed(key, length, config=CROWDED):
    """The obstacles around a straight start and a target that lies elsewhere, and that target."""
    chain = at_rest(PLACES, jnp.zeros(SLOTS), jnp.arange(SLOTS) < length)
    target = PLACES[:, ::-1] + LINK * length * jr.uniform(key, (2,), minval=-2.0, maxval=2.0)
    return place_obstacles(config, key, chain, target, Physics()), target


@pytest.fixture(scope="module")
def episodes():
    """Of each episode the points of start and target, and its walls and posts as (points, rim)."""
    draw = jax.jit(jax.vmap(placed))
    drawn = jax.device_get(draw(jr.split(jr.key(0), len(LENGTHS)), jnp.array(LENGTHS)))
    one = [jax.tree.map(lambda x, i=i: x[i], drawn) for i in range(len(LENGTHS))]
    return [
        (np.concatenate([PLACES[:length], target[:length]]), shapes(obstacles))
        for (obstacles, target), length in zip(one, LENGTHS, strict=True)
    ]


def shapes(obstacles):
    """Many points of the middle of each obstacle that is there, and its rim (m); walls first."""
    walls, posts, part = obstacles.walls, obstacles.posts, np.linspace(0, 1, 200)[:, None]
    found = [(a + part * (b - a), WIDTH / 2) for a, b in walls.ends[walls.present]]
    there = posts.present
    return found, [
        (c[None], r) for c, r in zip(posts.centre[there], posts.radius[there], strict=True)
    ]


def nearest(one, other):
    return np.linalg.norm(one[:, None] - other[None], axis=-1).min()


def test_no_obstacle_covers_the_start_or_the_target(episodes):
    for points, (walls, posts) in episodes:
        assert all(nearest(points, shape) - rim >= LINK - 1e-4 for shape, rim in walls + posts)


def test_a_chain_fits_between_two_obstacles_and_all_stand_in_the_room(episodes):
    for _, (walls, posts) in episodes:
        room, others = walls[:4], walls[4:] + posts
        for index, (shape, rim) in enumerate(others):
            for other, far in room + others[:index]:
                assert nearest(shape, other) - rim - far >= PASSAGE * LINK - 5e-3
        long, wide = room[0][0], room[2][0]
        for shape, _ in others:
            for side in (long, wide):
                line, away = side[-1] - side[0], shape.mean(axis=0) - side[0]
                assert 0 < line @ away < line @ line


def test_as_many_stand_as_were_asked_for_where_there_is_space(episodes):
    num_walls = [len(walls) - 4 for _, (walls, _) in episodes]
    num_posts = [len(posts) for _, (_, posts) in episodes]
    assert 2 < max(num_walls) <= 4 and len(set(num_posts)) > 2
    few = ObstacleConfig(posts=Range(3, 3), aside=Range(0.5, 3.0))
    draw = jax.jit(jax.vmap(lambda key: placed(key, SLOTS, few)[0].posts))
    posts = draw(jr.split(jr.key(1), 20))
    assert posts.present.all() and len(np.unique(posts.centre[:, 0, 0])) == 20
    assert posts.radius.min() >= 0.03 and posts.radius.max() <= 0.08


def test_settings_without_obstacles_make_none():
    sizes = ObstacleConfig(post_radius=Range(0.1, 0.1))
    assert placed(jr.key(0), SLOTS, sizes)[0] is None
