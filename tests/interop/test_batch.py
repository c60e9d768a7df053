import pickle
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.interop.batch import Batch
from salpchain.interop.checks import task_of
from salpchain.tasks.config import TaskConfig

CONFIG = TaskConfig(length=2, contact=False)
ENVS = 4


@pytest.fixture
def batch():
    batch = Batch(CONFIG, ENVS)
    batch.reset(seed=0)
    return batch


def zeros():
    return np.zeros((ENVS, 2, 1), np.float32)


def end_of(batch, which):
    """The batch one step before the time limit of some chains."""
    time = jnp.where(jnp.arange(ENVS) == which, 511, 3)
    batch.states = eqx.tree_at(lambda states: states.time, batch.states, time)
    return batch


def test_a_finished_episode_is_followed_by_a_new_one_and_its_last_observation_is_kept(batch):
    before = batch.states
    outcome = end_of(batch, 2).step(zeros())
    np.testing.assert_array_equal(outcome.truncated, [False, False, True, False])
    changed = np.any(np.asarray(outcome.obs != outcome.final_obs), axis=(1, 2))
    np.testing.assert_array_equal(changed, [False, False, True, False])
    assert batch.states.time.tolist() == [4, 4, 0, 4]
    assert not np.array_equal(batch.states.target[2], before.target[2])


def test_without_renewal_an_episode_goes_on_after_its_end():
    batch = Batch(CONFIG, ENVS, renew=False)
    batch.reset(seed=0)
    outcome = end_of(batch, 1).step(zeros())
    assert outcome.truncated[1]
    np.testing.assert_array_equal(outcome.obs, outcome.final_obs)


def test_resetting_some_chains_leaves_the_others_as_they_were(batch):
    batch.step(zeros() + 0.5)
    before = batch.states
    batch.reset_some(np.array([False, True, False, True]))
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(batch.states), strict=True):
        if not jnp.issubdtype(old.dtype, jax.dtypes.prng_key):
            np.testing.assert_array_equal(old[::2], new[::2])
    assert batch.states.time.tolist() == [1, 0, 1, 0]


def test_the_same_seed_gives_the_same_episodes_and_none_goes_on_from_the_last(batch):
    first = np.asarray(batch.reset(seed=5))
    second = np.asarray(batch.reset())
    np.testing.assert_array_equal(batch.reset(seed=5), first)
    np.testing.assert_array_equal(batch.reset(), second)
    np.testing.assert_array_equal(batch.reset(seed=[6, 7, 8, 9])[:3], first[1:])
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("action", "word"),
    [
        (np.zeros((ENVS, 3, 1)), r"shape \(4, 2, 1\), got \(4, 3, 1\)"),
        (np.zeros((ENVS, 2, 1), int), "int64"),
        ([[[0.0], [0.0]], [[0.0]]] * 2, "rows of unlike lengths"),
        (None, "floating point numbers, got object"),
        (
            np.where(np.arange(ENVS)[:, None, None] == 3, np.nan, zeros()),
            "environment 3, unit 0, holds nan",
        ),
        (jnp.where(jnp.arange(ENVS)[:, None, None] == 2, jnp.inf, 0) + zeros(), "environment 2"),
    ],
)
def test_a_bad_action_is_named_and_touches_nothing(batch, action, word):
    before = batch.states
    with pytest.raises(InputError, match=word):
        batch.step(action)
    assert batch.states is before


def test_a_step_before_the_first_reset_and_odd_numbers_are_refused():
    with pytest.raises(InputError, match="never reset"):
        Batch(CONFIG, ENVS).step(zeros())
    with pytest.raises(InputError, match="num_envs must be"):
        Batch(CONFIG, 0)
    with pytest.raises(InputError, match="seed must be"):
        Batch(CONFIG, ENVS).reset(seed=-1)
    with pytest.raises(InputError, match="unknown setting of the task 'lenght'"):
        task_of({"lenght": 8})
    batch = Batch(CONFIG, ENVS)
    for seeds, word in (
        ([0, 1], "must be 4, one for each, got"),
        ([], "must be 4, one for each, got"),
    ):
        with pytest.raises(InputError, match=word):
            batch.reset(seeds)
    with pytest.raises(InputError, match="max_steps must be a whole number"):
        Batch(CONFIG, ENVS, max_steps=0)
    batch.reset(0)
    with pytest.raises(InputError, match="4 booleans"):
        batch.reset_some(np.ones(3, bool))


def test_numbers_of_numpy_are_settings_too():
    assert task_of({"length": np.int64(8), "fence": np.bool_(True)}) == TaskConfig(
        8, fence=True, time_limit="scaled"
    )


def test_seeds_may_be_any_sequence_and_none_is_chance(batch):
    first = np.asarray(batch.reset((5, 6, 7, 8)))
    np.testing.assert_array_equal(batch.reset(np.array([5, 6, 7, 8])), first)
    some = np.asarray(batch.reset([5, None, 7, None]))
    same = (some == first).all(axis=(1, 2))
    np.testing.assert_array_equal(same, [True, False, True, False])


def test_some_chains_can_be_reset_to_seeds_of_their_own(batch):
    before = np.asarray(batch.states.obs)
    obs = np.asarray(batch.reset_some(np.array([True, False, False, True]), [7, 7, 7, 8]))
    np.testing.assert_array_equal(obs[1:3], before[1:3])
    assert not np.array_equal(obs[0], before[0])
    again = batch.reset_some(np.array([True, False, False, True]), [7, 7, 7, 8])
    np.testing.assert_array_equal(again, obs)


def test_a_time_limit_of_ones_own_truncates_earlier_and_never_later():
    batch = Batch(CONFIG, ENVS, max_steps=2)
    batch.reset(0)
    ends = [batch.step(zeros()).truncated.tolist() for _ in range(4)]
    assert ends == [[False] * 4, [True] * 4] * 2
    assert Batch(CONFIG, ENVS, max_steps=10_000).limit == 512


def test_a_batch_can_be_pickled_in_the_middle_of_its_episodes(batch):
    batch.step(zeros() + 0.5)
    other = pickle.loads(pickle.dumps(batch))
    for _ in range(3):
        for one, same in zip(
            *map(jax.tree.leaves, (batch.step(zeros()), other.step(zeros()))), strict=True
        ):
            np.testing.assert_array_equal(one, same)
    np.testing.assert_array_equal(batch.reset(), other.reset())


def test_it_steps_in_double_precision_too():
    """In a process of its own: the precision belongs to all of JAX."""
    code = (
        "import jax, numpy as np; jax.config.update('jax_enable_x64', True)\n"
        "from salpchain.tasks.config import TaskConfig\n"
        "from salpchain.interop.batch import Batch\n"
        "batch = Batch(TaskConfig(length=2, contact=False), 2); batch.reset(0)\n"
        "outcome = batch.step(np.ones((2, 2, 1), np.float32))\n"
        "print(outcome.obs.dtype, batch.states.chain.units.position.dtype)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["float32", "float64"]
