"""A recorded episode, and its file: what was written comes back, and nothing else is believed."""

import zipfile
from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain import InputError, Trajectory, identity, record
from salpchain.controllers.greedy import Greedy
from salpchain.evaluation.starts import start_keys
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from tests.report.swims import swim

LENGTH, SEED = 3, 5


@pytest.fixture(scope="module")
def episode():
    return record(Greedy(), [LENGTH], seed=SEED, trial=1)[0]


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "x.npz"
    swim(4, times=12).save(path)
    return path


def test_a_recording_is_the_episode_stepped_by_hand(episode):
    """The naive reference: reset, act and step, one after the other, without batch or scan."""
    env, greedy = SCLD(TaskConfig(16)), Greedy()
    state = jax.jit(env.reset)(start_keys(SEED, LENGTH, jnp.array([1]))[0], LENGTH)
    step = jax.jit(lambda state: env.step(state, greedy.act(state)))
    for now in range(6):
        for body, kept in (("unit", state.chain.units), ("link", state.chain.links)):
            for part in ("position", "angle", "velocity", "angular_velocity"):
                ours = getattr(episode, f"{body}_{part}")[now]
                np.testing.assert_allclose(ours, getattr(kept, part)[: len(ours)], atol=2e-4)
        state = step(state)
        np.testing.assert_allclose(episode.thrust[now], state.thrust[:LENGTH], atol=2e-3)
        np.testing.assert_allclose(episode.reward[now], state.reward, atol=1e-4)
    np.testing.assert_allclose(episode.target, state.target[:LENGTH])


def test_a_recording_ends_where_its_episode_does(episode):
    assert episode.success or episode.steps == 512
    assert episode.reward.sum() == pytest.approx(
        episode.distance[0] - episode.distance[-1] + episode.success, abs=1e-4
    )
    assert (episode.policy, episode.length, episode.dt) == ("greedy", LENGTH, pytest.approx(0.1))


def test_what_is_saved_comes_back(episode, tmp_path):
    episode.save(tmp_path / "x.npz")
    again = Trajectory.load(tmp_path / "x.npz")
    kept = [{**vars(one), "around": None, **one.around.named()} for one in (episode, again)]
    for name in {field.name for field in fields(Trajectory)} | episode.around.named().keys():
        ours, theirs = (one[name] for one in kept)
        assert type(ours) is type(theirs)
        np.testing.assert_array_equal(ours, theirs)


def altered(path, **changes):
    with np.load(path) as file:
        named = {name: file[name] for name in file.files}
    for name, value in changes.items():
        named.pop(name) if value is None else named.update({name: value})
    np.savez_compressed(path, **named)


BAD = [
    ({"thrust": None}, "the field thrust is missing"),
    ({"policy": None}, "the field policy is missing"),
    ({"format": None}, "does not state its format"),
    ({"format": 99}, "newer salpchain"),
    ({"length": 5}, "unit_position has shape"),
    ({"length": 1}, "2 to 1024"),
    ({"seed": -1}, "seed must be"),
    ({"trial": -1}, "trial must be"),
    ({"time_limit": "never"}, "choose one of fixed, scaled"),
    ({"dt": np.nan}, "dt must be a finite number"),
    ({"dt": 1}, "dt must be one value"),
    ({"success": 1}, "success must be one value"),
    ({"reward": np.zeros(3)}, "reward has shape (3,)"),
    ({"target": np.zeros((4, 2), int)}, "of floats"),
    ({"target": np.full((4, 2), np.inf)}, "not finite"),
    ({"unit_position": np.zeros(())}, "unit_position"),
    ({"unit_position": np.zeros((0, 4, 2))}, "has no time"),
]


@pytest.mark.parametrize(("changes", "says"), BAD, ids=lambda x: "" if isinstance(x, dict) else x)
def test_a_file_with_a_wrong_field_is_refused(saved, changes, says):
    altered(saved, **changes)
    with pytest.raises(InputError) as refused:
        Trajectory.load(saved)
    assert says in str(refused.value) and str(saved) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_of_pickled_objects_is_refused_and_not_unpickled(saved):
    altered(saved, target=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="not a trajectory"):
        Trajectory.load(saved)


def test_a_file_cut_short_anywhere_is_refused(saved):
    whole = saved.read_bytes()
    for size in (0, 1, 10, len(whole) // 2, len(whole) - 1):
        saved.write_bytes(whole[:size])
        with pytest.raises(InputError, match="cut short"):
            Trajectory.load(saved)


def test_a_file_with_a_flipped_byte_is_refused_or_the_same(saved):
    whole, reference = saved.read_bytes(), Trajectory.load(saved)
    for place in range(0, len(whole), 97):
        harmed = bytearray(whole)
        harmed[place] ^= 0xFF
        saved.write_bytes(harmed)
        try:
            again = Trajectory.load(saved)
        except InputError:
            continue
        np.testing.assert_array_equal(again.unit_position, reference.unit_position)


def test_a_file_that_unpacks_to_gigabytes_is_refused_before_it_is_unpacked(saved, monkeypatch):
    monkeypatch.setattr("salpchain.evaluation.trajectory.LARGEST", 1000)
    with pytest.raises(InputError, match="more than any trajectory"):
        Trajectory.load(saved)


def test_no_such_file(tmp_path):
    with pytest.raises(InputError, match="no such trajectory"):
        Trajectory.load(tmp_path / "x.npz")


def test_the_file_is_a_plain_compressed_npz(saved):
    with zipfile.ZipFile(saved) as archive:
        assert all(entry.compress_type == zipfile.ZIP_DEFLATED for entry in archive.infolist())


def test_a_recording_says_whose_it_is_and_files_of_before_are_read(episode, saved):
    assert episode.identity == identity(Greedy())
    altered(saved, identity=None)
    assert Trajectory.load(saved).identity == ""
    altered(saved, identity=np.array(3))
    with pytest.raises(InputError, match="identity must be one value"):
        Trajectory.load(saved)
