"""The policies that a live page offers, and that no others can be loaded."""

from pathlib import Path

import jax.random as jr
import pytest

from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.released import released
from salpchain.controllers.storage import save_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.web.fleet import Fleet


def save_runs(runs):
    """A run with a fresh policy, and one whose policy is broken."""
    card = PolicyCard(name="fresh")
    policy = Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card)
    (runs / "one").mkdir()
    save_policy(policy, runs / "one" / "policy.safetensors")
    (runs / "broken").mkdir()
    (runs / "broken" / "policy.safetensors").write_bytes(b"not a policy")


@pytest.fixture
def runs(tmp_path):
    (tmp_path / "runs").mkdir()
    save_runs(tmp_path / "runs")
    return tmp_path / "runs"


def test_a_fleet_lists_runs_and_loads_nothing_else(runs, tmp_path):
    fleet = Fleet(runs=runs)
    shown = set(released("vmas"))
    assert "any-length" in shown and "any-length-landsalp" in set(released()) - shown
    assert set(fleet.names) == {"broken", "one", "greedy", "approach", "caravan", *shown}
    chosen = Fleet(str(runs / "one"), runs)
    own = [name for name in chosen.names if name not in released()]
    assert own == ["one", "broken", "greedy", "approach", "caravan"]
    twin = tmp_path / "one.safetensors"
    twin.write_bytes((runs / "one" / "policy.safetensors").read_bytes())
    assert Fleet(str(twin), runs).first == str(twin)  # another one of that name
    assert chosen.load(chosen.first).card.name == "fresh"
    with pytest.raises(InputError, match="there is no policy"):
        fleet.load(str(runs / "one" / "policy.safetensors"))
    with pytest.raises(InputError, match="no such run folder"):
        Fleet(str(tmp_path / "missing"))
    with pytest.raises(InputError, match="mpc is too slow to steer live"):
        Fleet("mpc")


def test_a_controller_of_ones_own_steers_and_is_listed():
    fleet = Fleet("tests.own:Spin")
    assert fleet.first == fleet.names[0] == "tests.own:Spin"
    assert fleet.load("tests.own:Spin").card.name == "spin"
    with pytest.raises(InputError, match=r"no policy 'tests\.own:Hover'"):
        fleet.load("tests.own:Hover")
    with pytest.raises(InputError, match=r"there is no module tests\.gone"):
        Fleet("tests.gone:Spin")


def test_a_name_steers_whatever_folder_is_called_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    card = PolicyCard(name="own")
    policy = Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card)
    for folder in ("greedy", "runs/greedy", "eight", "runs/eight"):
        Path(folder).mkdir(parents=True)
        save_policy(policy, Path(folder) / "policy.safetensors")
    named = Fleet("greedy", Path("runs"))
    assert named.first == "greedy" and named.load("greedy").card.name == "greedy"
    assert named.load("runs/greedy").card.name == "own"
    for folder in ("./greedy", "eight"):
        own = Fleet(folder, Path("runs"))
        assert own.first == str(Path(folder).resolve()) and own.load(own.first).card.name == "own"
        assert own.load("greedy").card.name == "greedy"
