"""Building obstacles from lists, and whether they cover the start of a chain."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.physics.obstacles import Obstacles
from salpchain.physics.state import Physics, at_rest
from salpchain.world.obstacles import check_clear, make_obstacles, room


def straight(num, link=0.07):
    ahead = link * jnp.arange(float(num))
    return at_rest(jnp.stack([ahead, 0 * ahead], -1), jnp.zeros(num))


def test_lists_fill_the_first_slots():
    made = make_obstacles([((0, 1), (2, 3), 0.1)], [((4, 5), 0.2)], slots=(3, 2))
    assert isinstance(made, Obstacles)
    np.testing.assert_allclose(made.walls.ends[0], [[0, 1], [2, 3]])
    np.testing.assert_allclose(made.posts.centre[0], [4, 5])
    assert made.walls.present.tolist() == [True, False, False]
    assert made.posts.present.tolist() == [True, False]


WALL, POST = ((0.0, 0.0), (1.0, 0.0), 0.05), ((0.0, 0.0), 0.05)


@pytest.mark.parametrize(("given", "message"), [
    ({"walls": [WALL, ((0, 0), (0, 0), 0.1)]}, "wall 1: its two ends must be apart"),
    ({"walls": [((0, 0), (1, 0), 0.0)]}, "wall 0: its width must be positive"),
    ({"walls": [((0, np.nan), (1, 0), 0.1)]}, "wall 0 must be finite numbers"),
    ({"walls": [(0, 0, 1, 0, 0.1)]}, r"wall 0 must be \(\(x, y\), \(x, y\), width\) in m"),
    ({"walls": [((0, 0), (1, "a"), 0.1)]}, r"wall 0 must be \(\(x, y\), \(x, y\), width\) in m"),
    ({"walls": [3.0]}, r"wall 0 must be \(\(x, y\), \(x, y\), width\) in m"),
    ({"posts": [POST, ((0, 0), -0.1)]}, "post 1: its radius must be positive"),
    ({"posts": [((0, 0), np.inf)]}, "post 0 must be finite numbers"),
    ({"posts": [WALL]}, r"post 0 must be \(\(x, y\), radius\) in m"),
    ({"walls": [WALL, WALL], "slots": (1, 0)}, "2 walls need as many slots or more, got 1"),
    ({"slots": (1, -1)}, "slots must be two whole numbers"),
    ({"slots": (1,)}, "slots must be two whole numbers"),
])  # fmt: skip
def test_what_cannot_be_an_obstacle_is_refused_in_one_line(given, message):
    with pytest.raises(InputError, match=message) as error:
        make_obstacles(**given)
    assert "\n" not in str(error.value)


def test_a_room_needs_a_size():
    with pytest.raises(InputError, match="height must be a positive number"):
        room(1.0, 0.0)


@pytest.mark.parametrize(("walls", "posts", "message"), [
    ([WALL], [], "wall 0 covers unit 0"),
    ([((5, 0), (6, 0), 0.1), ((0.14, 0.02), (0.14, 0.5), 0.01)], [], "wall 1 covers unit 2"),
    ([((0.105, -0.5), (0.105, 0.5), 0.01)], [], "wall 0 lies across the link of units 1 and 2"),
    ([], [((0.21, 0.07), 0.05)], "post 0 covers unit 3"),
    ([((5, 0), (6, 0), 0.1)], [((0.035, 0.0), 0.005)], "post 0 lies across the link of units 0"),
])  # fmt: skip
def test_what_covers_the_start_is_named(walls, posts, message):
    with pytest.raises(InputError, match=message):
        check_clear(straight(4), make_obstacles(walls, posts, (3, 2)))


def test_a_start_that_is_clear_passes_also_one_of_other_constants_and_with_dead_units():
    check_clear(straight(4), make_obstacles(room(0.5, 0.06)))
    check_clear(straight(4), make_obstacles())
    near = make_obstacles(posts=[((0.21, 0.07), 0.05)])
    gone = eqx.tree_at(lambda c: c.present, straight(4), jnp.arange(4) < 3)
    check_clear(gone, near)
    check_clear(straight(4), near, Physics(unit_width=0.03))
    with pytest.raises(InputError, match="post 0 covers unit 3"):
        check_clear(straight(4), near)
