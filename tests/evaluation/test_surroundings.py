"""What is recorded around a chain: the water on a grid, obstacles, thrusters; kept in files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.evaluation.survey import MOMENTS, surroundings
from salpchain.evaluation.trajectory import Trajectory
from salpchain.world.current import Uniform, Vortex
from salpchain.world.obstacles import make_obstacles
from salpchain.world.world import World
from tests.report.swims import swim

POINTS = np.array([[0.0, 0.0], [1.2, 0.5]], np.float32)
VORTEX = Vortex(jnp.asarray(0.05), jnp.asarray(0.3), jnp.array([0.4, 0.2]))


def over_time(current, steps=50):
    """The arrays of a current in an episode in which all of them grow threefold."""
    return jax.tree.map(lambda x: np.linspace(x, 3 * x, steps), current)


def test_the_waters_velocity_comes_back_between_the_points_of_the_grid():
    world = World(current=VORTEX)
    steady = jax.tree.map(lambda x: np.stack([x] * 50), VORTEX)
    around = surroundings(world, POINTS, None, steady)
    assert len(around.water) == 1
    places = np.random.default_rng(0).uniform([-0.3, -0.3], [1.5, 0.8], (100, 2))
    true = np.asarray(VORTEX.flow(jnp.asarray(places, jnp.float32)).velocity)
    np.testing.assert_allclose(around.flow(places, 0.7), true, atol=2e-3)


def test_water_that_is_alike_everywhere_takes_one_point_and_changes_in_time():
    current = Uniform((0.02, -0.04))
    around = surroundings(World(current=current), POINTS, None, over_time(current))
    assert around.water.shape == (MOMENTS, 1, 1, 2)
    np.testing.assert_allclose(around.flow(POINTS, 0.5), [[0.04, -0.08]] * 2, atol=1e-6)


def test_only_obstacles_that_are_there_and_thrusters_that_are_broken_are_kept():
    there = make_obstacles([((0, 1), (2, 3), 0.1)], [((4, 5), 0.2)], slots=(3, 2))
    around = surroundings(World(obstacles=there), POINTS, np.ones((9, 2)), None)
    np.testing.assert_allclose(around.walls, [[0, 1, 2, 3, 0.1]])
    np.testing.assert_allclose(around.posts, [[4, 5, 0.2]])
    assert not around.gain.size and not around.dead(3, 2).any()
    gain = np.ones((9, 2))
    gain[4:, 1] = 0.0
    around = surroundings(World(), POINTS, gain, None)
    assert [around.dead(step, 2).tolist() for step in (3, 4, 99)] == [
        [False, False],
        [False, True],
        [False, True],
    ]


def test_a_file_keeps_it_and_an_older_one_has_nothing_around(tmp_path):
    from dataclasses import replace

    around = Surroundings(posts=np.array([[0.1, 0.2, 0.05]]), gain=np.zeros((39, 3)))
    replace(swim(3), around=around).save(tmp_path / "new.npz")
    again = Trajectory.load(tmp_path / "new.npz").around
    np.testing.assert_array_equal(again.posts, around.posts)
    assert again.dead(0, 3).all() and not again.water.size
    named = dict(np.load(tmp_path / "new.npz"))
    old = {name: x for name, x in named.items() if name not in around.named()}
    np.savez(tmp_path / "old.npz", **old)
    assert not Trajectory.load(tmp_path / "old.npz").around.posts.size
    for name, wrong in (
        ("gain", np.ones((3, 3))),
        ("walls", np.ones(5)),
        ("posts", np.ones((1, 3), int)),
    ):
        np.savez(tmp_path / "bad.npz", **{**named, name: wrong})
        with pytest.raises(InputError, match=f"bad.npz: {name} has shape"):
            Trajectory.load(tmp_path / "bad.npz")
