import warnings

import equinox as eqx
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FlattenObservation, RescaleAction, TransformReward, vector

import salpchain.interop.gymnasium as bridge
from salpchain.errors import InputError

TASK = {"length": 2, "contact": False}
ENVS = 4  # as in `test_batch`: the same compiled program
ROUNDED = 1e-3  # programs for other numbers of chains round otherwise; joints are stiff


@pytest.fixture(autouse=True, scope="module")
def no_window():
    import matplotlib as mpl

    mpl.use("agg")


@pytest.mark.parametrize("settings", [{}, {"observation": "table1", "action": "pair"}])
def test_gymnasiums_own_checker_has_nothing_to_say(settings):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        env = gymnasium.make(bridge.ID, **TASK, **settings, disable_env_checker=True)
        check_env(env.unwrapped, skip_render_check=bool(settings))
    ours = [str(w.message) for w in said if issubclass(w.category, UserWarning)]
    assert all("maximum and minimum of the observation" in w or "infinity" in w for w in ours), ours


def last_step(env, which):
    """The env one control step before the time limit of some chains."""
    batch = env.unwrapped._batch
    time = np.where(np.arange(batch.num_envs) == which, 511, 3).astype(np.int32)
    batch.states = eqx.tree_at(lambda states: states.time, batch.states, time)


def test_the_vector_env_gives_what_gymnasiums_own_one_of_single_envs_gives():
    """Also the layout of `info` where an episode ends, which Gymnasium's own one defines."""
    mode = AutoresetMode.SAME_STEP
    ours = gymnasium.make_vec(bridge.ID, num_envs=ENVS, autoreset_mode=mode, **TASK)
    assert isinstance(ours.unwrapped, bridge.SalpVectorEnv)
    singles = [lambda: gymnasium.make(bridge.ID, **TASK, disable_env_checker=True)] * ENVS
    theirs = SyncVectorEnv(singles, autoreset_mode=AutoresetMode.SAME_STEP)
    np.testing.assert_array_equal(ours.reset(seed=7)[0], theirs.reset(seed=7)[0])
    last_step(ours, 1)
    last_step(theirs.envs[1], 0)
    assert ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    for actions in np.random.default_rng(0).uniform(-1, 1, (2, ENVS, 2, 1)):
        for one, other in zip(ours.step(actions)[:4], theirs.step(actions)[:4], strict=True):
            np.testing.assert_allclose(one, other, atol=ROUNDED)


def test_infos_have_the_layout_of_gymnasium():
    mode = AutoresetMode.SAME_STEP
    ours = gymnasium.make_vec(bridge.ID, num_envs=ENVS, autoreset_mode=mode, **TASK)
    singles = [lambda: gymnasium.make(bridge.ID, **TASK, disable_env_checker=True)] * ENVS
    theirs = SyncVectorEnv(singles, autoreset_mode=AutoresetMode.SAME_STEP)
    for env in (ours, theirs):
        env.reset(seed=3)
    last_step(ours, 1)
    last_step(theirs.envs[1], 0)
    actions = np.full((ENVS, 2, 1), 0.5, np.float32)
    one, other = ours.step(actions)[4], theirs.step(actions)[4]
    assert one["final_obs"][0] is None and other["final_obs"][0] is None
    np.testing.assert_allclose(one.pop("final_obs")[1], other.pop("final_obs")[1], atol=ROUNDED)
    same(one, other)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_the_other_modes_of_autoreset_are_those_of_gymnasium(mode):
    ours = gymnasium.make_vec(bridge.ID, num_envs=ENVS, autoreset_mode=mode, **TASK)
    singles = [lambda: gymnasium.make(bridge.ID, **TASK, disable_env_checker=True)] * ENVS
    theirs = SyncVectorEnv(singles, autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is mode
    for env in (ours, theirs):
        env.reset(seed=3)
    last_step(ours, 1)
    last_step(theirs.envs[1], 0)
    actions = np.full((ENVS, 2, 1), 0.5, np.float32)
    for turn in range(3):
        pair = ours.step(actions), theirs.step(actions)
        for one, other in zip(*(given[:4] for given in pair), strict=True):
            np.testing.assert_allclose(one, other, atol=ROUNDED)
        for name in bridge.MEASURES:
            np.testing.assert_array_equal(*(given[4]["_" + name] for given in pair))
        assert pair[0][3][1] == (turn == 0)
        if mode is AutoresetMode.DISABLED and turn == 0:
            with pytest.raises(InputError, match="episode of environment 1 is over"):
                ours.step(actions)
            mask = np.arange(ENVS) == 1
            pair = [env.reset(options={"reset_mask": mask})[0] for env in (ours, theirs)]
            np.testing.assert_allclose(*pair, atol=ROUNDED)
            listed = ours.reset(options={"reset_mask": mask.tolist()})[0]
            again = theirs.reset(options={"reset_mask": mask})[0]
            np.testing.assert_allclose(listed, again, atol=ROUNDED)


def test_a_time_limit_and_seeds_are_given_as_gymnasium_has_them():
    env = gymnasium.make_vec(bridge.ID, num_envs=ENVS, max_episode_steps=2, **TASK)
    env.reset(seed=3)
    assert env.np_random_seed == 3
    first, _ = env.reset(seed=(3, 4, 5, 6))
    np.testing.assert_array_equal(env.reset(seed=[3, 4, None, 6])[0][[0, 1, 3]], first[[0, 1, 3]])
    actions = np.zeros((ENVS, 2, 1), np.float32)
    assert [env.step(actions)[3].all() for _ in range(6)] == [False, True, False] * 2


WRAPPERS = {
    "ArrayConversion": None,  # needs array_api_compat
    "ClipAction": vector.ClipAction,
    "ClipReward": lambda env: vector.ClipReward(env, -1, 1),
    "DictInfoToList": vector.DictInfoToList,
    "DtypeObservation": lambda env: vector.DtypeObservation(env, np.float64),
    "FilterObservation": None,  # of dictionaries
    "FlattenObservation": vector.FlattenObservation,
    "GrayscaleObservation": None,  # of pictures
    "HumanRendering": None,  # needs a screen and pygame
    "JaxToNumpy": None,  # for what gives JAX's arrays
    "JaxToTorch": None,
    "NormalizeObservation": vector.NormalizeObservation,
    "NormalizeReward": vector.NormalizeReward,
    "NumpyToTorch": None,
    "RecordEpisodeStatistics": vector.RecordEpisodeStatistics,
    "RecordVideo": None,  # needs moviepy
    "RescaleAction": lambda env: vector.RescaleAction(env, -2, 2),
    "RescaleObservation": None,  # of bounded spaces
    "ReshapeObservation": lambda env: vector.ReshapeObservation(env, (44,)),
    "ResizeObservation": None,
    "TransformAction": lambda env: vector.TransformAction(env, lambda action: action / 2),
    "TransformObservation": lambda env: vector.TransformObservation(env, lambda obs: obs * 2),
    "TransformReward": lambda env: vector.TransformReward(env, lambda reward: 2 * reward),
    "VectorizeTransformAction": lambda env: vector.VectorizeTransformAction(
        env, RescaleAction, min_action=-2, max_action=2
    ),
    "VectorizeTransformObservation": lambda env: vector.VectorizeTransformObservation(
        env, FlattenObservation
    ),
    "VectorizeTransformReward": lambda env: vector.VectorizeTransformReward(
        env, TransformReward, func=lambda reward: 2 * reward
    ),
}


def test_every_vector_wrapper_of_gymnasium_is_known_here():
    assert set(WRAPPERS) == set(vector.__all__)


@pytest.mark.parametrize("name", [name for name, wrap in WRAPPERS.items() if wrap])
def test_gymnasiums_vector_wrappers_take_the_default(name):
    """Over the end of an episode, and without a warning about the environment."""
    env = gymnasium.make_vec(bridge.ID, num_envs=ENVS, max_episode_steps=2, **TASK)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = WRAPPERS[name](env)
        obs, _ = env.reset(seed=0)
        steps = [env.step(env.action_space.sample()) for _ in range(4)]
    assert [bool(step[3].all()) for step in steps] == [False, True, False, False]
    assert len(steps[-1][0]) == len(obs) == ENVS


def same(one, other):
    assert one.keys() == other.keys()
    for name, value in one.items():
        if isinstance(value, dict):
            same(value, other[name])
        else:
            np.testing.assert_allclose(value, other[name], atol=ROUNDED, err_msg=name)


def test_pictures_show_the_chain_in_its_colours():
    env = gymnasium.make(bridge.ID, render_mode="rgb_array", **TASK)
    env.reset(seed=0)
    frame = env.render()
    assert frame.shape == (480, 480, 3) and frame.dtype == np.uint8
    assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 10
    vector = gymnasium.make_vec(bridge.ID, num_envs=ENVS, render_mode="rgb_array", **TASK)
    vector.reset(seed=0)
    np.testing.assert_array_equal(vector.render()[0], frame)


def test_a_window_shows_each_step_and_closes():
    from matplotlib import pyplot

    env = bridge.SalpEnv(render_mode="human", **TASK)
    env.reset(seed=0)
    image = pyplot.gcf().images[0]
    before = np.array(image.get_array())
    for _ in range(10):
        env.step(np.ones((2, 1), np.float32))
    assert not np.array_equal(before, image.get_array())
    assert env.render() is None
    env.close()
    assert not pyplot.get_fignums()


def test_bad_input_is_named():
    env = gymnasium.make_vec(bridge.ID, num_envs=ENVS, **TASK)
    with pytest.raises(InputError, match="never reset"):
        env.step(np.zeros((ENVS, 2, 1), np.float32))
    env.reset(seed=0)
    with pytest.raises(InputError, match="environment 1, unit 0, holds nan"):
        env.step(np.where(np.arange(ENVS)[:, None, None] == 1, np.nan, np.zeros((ENVS, 2, 1))))
    with pytest.raises(InputError, match="unknown setting of the task 'lenght'"):
        gymnasium.make(bridge.ID, lenght=8)
    with pytest.raises(InputError, match="unknown option 'mask' of reset: reset_mask"):
        env.reset(options={"mask": np.ones(ENVS, bool)})
    with pytest.raises(InputError, match="4 booleans"):
        env.reset(options={"reset_mask": [True] * 3})
    with pytest.raises(InputError, match="unknown autoreset mode 'never'"):
        gymnasium.make_vec(bridge.ID, num_envs=ENVS, autoreset_mode="never", **TASK)
    single = bridge.SalpEnv(render_mode="rgb_array", **TASK)
    with pytest.raises(InputError, match=r"call reset\(\) first"):
        single.render()
    single.reset()
    with pytest.raises(InputError, match=r"shape \(2, 1\), got \(1, 2, 1\)"):
        single.step(np.zeros((1, 2, 1)))
    with pytest.raises(InputError, match="the action of unit 1 holds inf"):
        single.step([[0.0], [np.inf]])
    with pytest.raises(InputError, match="unknown render mode"):
        gymnasium.make_vec(bridge.ID, num_envs=ENVS, render_mode="human", **TASK)
