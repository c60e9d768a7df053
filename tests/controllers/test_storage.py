import json
import shutil
from pathlib import Path

import jax
import jax.random as jr
import numpy as np
import pytest

import salpchain
from salpchain.cli.main import run
from salpchain.controllers.approach import Approach
from salpchain.controllers.greedy import Greedy
from salpchain.controllers.mpc import MPC
from salpchain.controllers.named import names
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import load, save_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic


@pytest.fixture
def saved(tmp_path):
    card = PolicyCard(length=6, steps=10)
    policy = Policy(actor_critic(jr.key(3), card.control, 22, 1, 6), card)
    save_policy(policy, tmp_path / "policy.safetensors")
    return policy, tmp_path / "policy.safetensors"


def test_a_policy_is_loaded_as_it_was_saved_from_its_file_or_its_folder(saved):
    policy, path = saved
    for source in (path, str(path), path.parent):
        again = load(source)
        assert again.card == policy.card
        for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(policy), strict=True):
            np.testing.assert_array_equal(one, other)


def in_folder(path, folder):
    """A run folder with this policy."""
    folder.mkdir()
    shutil.copy(path, folder)


def test_every_controller_is_loaded_by_its_name_whatever_folder_is_called_so(
    saved, tmp_path, monkeypatch
):
    for name in names():
        in_folder(saved[1], tmp_path / name)
    monkeypatch.chdir(tmp_path)
    for name in names():
        assert salpchain.load(name).card != saved[0].card
        assert salpchain.load(f"./{name}").card == salpchain.load(Path(name)).card == saved[0].card
    for name, kind in (("greedy", Greedy), ("approach", Approach), ("mpc", MPC)):
        assert type(salpchain.load(name)) is kind


def test_what_needs_weights_says_that_a_baseline_has_none(saved, tmp_path, monkeypatch, capsys):
    in_folder(saved[1], tmp_path / "mpc")
    monkeypatch.chdir(tmp_path)
    for name in ("greedy", "mpc"):
        assert run(["export", name]) == 2
        said = capsys.readouterr().err
        assert f"error: {name} has no weights (a learned policy is meant: a path, or any-" in said
        assert said.count("\n") == 1
    assert load("./mpc").card == saved[0].card


def test_half_precision_is_half_the_size_and_nearly_the_same(saved, tmp_path):
    policy, path = saved
    save_policy(policy, tmp_path / "half.safetensors", half=True)
    assert (tmp_path / "half.safetensors").stat().st_size < 0.52 * path.stat().st_size
    again = load(tmp_path / "half.safetensors")
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(policy), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-7)


def test_the_file_is_plain_safetensors_that_others_can_read(saved):
    from safetensors.numpy import load_file

    _, path = saved
    arrays = load_file(path)
    assert arrays["network.trunk.first.linear.weight".removeprefix("network.")].shape == (22, 128)


def change_header(content, old, new):
    assert old in content
    size = int.from_bytes(content[:8], "little")
    header = content[8 : 8 + size].replace(old, new)
    return len(header).to_bytes(8, "little") + header + content[8 + size :]


@pytest.mark.parametrize(
    ("harm", "word"),
    [
        (lambda b: b[:100], "cut short"),
        (lambda b: b[:-40], "cut short"),
        (lambda b: b[:-3] + bytes([b[-3] ^ 4]) + b[-2:], "altered"),
        (lambda b: change_header(b, rb"\"version\": 1", rb"\"version\": 2"), "newer"),
        (lambda b: change_header(b, rb"\"kind\": \"policy\"", rb"\"kind\": \"cheese\""), "not a"),
        (lambda b: change_header(b, rb"\"mixed\"", rb"\"full\""), "altered"),
        (lambda b: change_header(b, rb"\"length\": 6", rb"\"length\": 7"), "altered"),
        (lambda b: change_header(b, rb"\"version\": 1", rb"\"version\": true"), "not a salp"),
        (lambda b: change_header(b, rb"\"version\": 1", rb"[" * 100_000), "not a salpchain"),
        (lambda b: b"PK\x03\x04" + b, "not a salpchain"),
        (lambda b: b"\x80\x04cos\nsystem\n(S'true'\ntR.", "not a salpchain"),
    ],
)
def test_a_harmed_or_foreign_file_is_refused_with_one_line_that_names_it(saved, harm, word):
    _, path = saved
    path.write_bytes(harm(path.read_bytes()))
    with pytest.raises(InputError, match=word) as error:
        load(path)
    assert "\n" not in str(error.value)
    assert path.name in str(error.value)


def test_a_folder_without_a_policy_is_refused(tmp_path):
    with pytest.raises(InputError, match="not a run folder"):
        load(tmp_path)


def test_no_name_at_all_is_refused_for_what_it_is():
    with pytest.raises(InputError, match="no such run folder or policy: ''"):
        load("")


def test_the_card_is_plain_json(saved):
    policy, _ = saved
    assert json.loads(json.dumps(policy.card.as_dict()))["control"]["model"] == "gcn"


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[31mb", "a\u2028b"])
def test_a_policy_cannot_be_called_what_does_not_stand_in_one_line(name):
    with pytest.raises(InputError, match="no line breaks and no control characters") as refused:
        PolicyCard(name=name)
    assert str(refused.value).isprintable()
