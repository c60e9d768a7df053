"""Observations of one's own, and features of what is around a chain."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import RAYS, layout, observation_size
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.registry import make_task
from salpchain.world.current import Uniform
from salpchain.world.obstacles import make_obstacles
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World
from tests.own import FASTER

AROUND = 5  # the last numbers of `around` are of the world


def after_steps(env, steps=3):
    state = env.reset(jr.key(0))
    step = jax.jit(lambda state, action: env.step(state, action))
    for _ in range(steps):
        state = step(state, jnp.ones((env.config.length, 1)))
    return state


def test_an_observation_of_ones_own_is_seen_beside_those_of_the_package():
    own = after_steps(SCLD(TaskConfig(4, "tests.own:FASTER")))
    plain = after_steps(SCLD(TaskConfig(4, "proximity")))
    np.testing.assert_array_equal(own.obs[:, :-1], plain.obs)
    speed = np.linalg.norm(own.chain.units.velocity, axis=-1)
    np.testing.assert_allclose(own.obs[:, -1], speed, rtol=1e-5)
    assert observation_size("tests.own:FASTER") == sum(len(f.fields) for f in FASTER) == 25


def test_around_tells_the_water_the_nearest_surface_and_the_own_thruster():
    plain = after_steps(SCLD(TaskConfig(4, "around")))
    assert not np.any(plain.obs[:, -3:-1]) and np.all(plain.obs[:, -1] == 1)
    gain = jnp.array([1.0, 0.0, 0.5, 1.0])
    at = plain.chain.units.position[0] + jnp.array([0.0, 0.1])
    world = World(
        current=Uniform((0.05, -0.02)),
        thrusters=Thrusters(gain=gain),
        obstacles=make_obstacles(posts=[(at, 0.01)]),
    )
    env = SCLD(TaskConfig(4, "around"), world)  # the post touches the chain, which jit lets pass
    state = jax.jit(lambda key: env.start(plain.chain, plain.target, key))(jr.key(1))
    angle = np.asarray(plain.chain.units.angle)
    through = np.asarray(plain.chain.units.velocity) - [0.05, -0.02]
    along = np.cos(angle) * through[:, 0] + np.sin(angle) * through[:, 1]
    np.testing.assert_allclose(state.obs[:, -AROUND], 5 * along, rtol=1e-4, atol=1e-6)
    assert np.linalg.norm(state.obs[0, -3:-1]) == pytest.approx(1 - 0.09 / 0.2, rel=1e-3)
    np.testing.assert_array_equal(state.obs[:, -1], gain)


def test_jets_tell_what_the_own_thruster_can_do_forwards_and_backwards_and_what_it_did():
    gain, one_way = jnp.array([1.0, 0.0, 0.5, 1.0]), jnp.array([False, True])
    proximity = SCLD(TaskConfig(4, "proximity"))

    def after(one_sided):
        task = SCLD(TaskConfig(4, "jets"), World(thrusters=Thrusters(gain, one_sided=one_sided)))
        return task.step(task.reset(jr.key(0)), jnp.array([[0.8], [0.8], [0.8], [-0.8]]))

    for one_sided, states in ((False, after(False)), (True, after(True))):
        able = np.asarray(states.obs[:, -3:])
        np.testing.assert_array_equal(able[:, 0], gain)
        np.testing.assert_array_equal(able[:, 1], 0 * gain if one_sided else gain)
        last = 0.0 if one_sided else -0.8
        np.testing.assert_allclose(able[:, 2], [0.8, 0.0, 0.4, last], atol=1e-3)
        known = proximity.observe(states.chain, states.target, states.force)
        np.testing.assert_allclose(states.obs[:, :-3], known, atol=1e-6)
    traced = jax.vmap(after)(one_way)  # some jets of a batch may push one way
    np.testing.assert_array_equal(traced.obs[:, 3, -2], [1.0, 0.0])


@pytest.mark.parametrize("world", ["still", "noisy"])
def test_an_observation_of_several_steps_is_what_was_seen_in_each_the_newest_first(world):
    late, now = (make_task(TaskConfig(4, name), world) for name in ("jets*3", "jets"))
    actions = jr.uniform(jr.key(5), (6, 4, 1), minval=-1.0)
    state, plain = late.reset(jr.key(1)), now.reset(jr.key(1))
    seen = [plain.obs] * 3
    np.testing.assert_allclose(state.obs, np.concatenate(seen, axis=1), atol=1e-6)
    for action in actions:
        state, plain = late.step(state, action), now.step(plain, action)
        seen = [plain.obs, *seen[:2]]
        np.testing.assert_allclose(state.obs, np.concatenate(seen, axis=1), atol=1e-5)
    assert observation_size("jets*3") == late.observation_size == 3 * observation_size("jets")
    names = [field.name for field in layout("jets*3")]
    assert names[0] == "velocity along" and len(set(names)) == len(names)
    assert names[-1] == "own thrust in the last step, as it acted, 2 control steps before"


@pytest.mark.parametrize("name", ["jets*1", "jets*", "jets*two", "jets*65", "jets*-3", "jets*2*2"])
def test_a_number_of_steps_that_cannot_be_is_refused(name):
    with pytest.raises(InputError, match=r"after \* comes how many control steps .* jets\*4"):
        TaskConfig(4, name)


def test_rays_are_clear_without_obstacles_and_named_one_by_one():
    assert [field.name for field in RAYS.fields][::4] == [
        "clear way at 0 degrees",
        "clear way at 180 degrees",
    ]
    assert layout("around")[-1].name == "gain of the own thruster"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("bodies", "unknown observation 'bodies': choose one of body, table1, .* or one of your"),
        ("nowhere:FASTER", "observation nowhere:FASTER: there is no module nowhere"),
        ("tests.own:SLOWER", "tests.own has no SLOWER, it has .*FASTER"),
        ("tests.own:NOT_FEATURES", "must be a tuple of features, .* got \\('speed', 'place'\\)"),
        ("tests.own:AHEAD", "must be a tuple of features"),
        ("", "unknown observation ''"),
    ],
)
def test_no_such_observation_is_one_line(name, said):
    with pytest.raises(InputError, match=said):
        TaskConfig(observation=name)
