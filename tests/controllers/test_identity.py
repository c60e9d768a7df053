"""Who a controller is: told from what makes it act, and the same wherever and whenever asked."""

import json
import subprocess
import sys
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain import MPC, Approach, Greedy, identity, load, save_policy
from salpchain.controllers.named import names
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import KIND, VERSION
from salpchain.files import read_arrays, write_arrays
from tests.interop.policies import fresh
from tests.own import Late

ASK = "import salpchain; print(salpchain.identity(salpchain.load('any-length')), end=' ')\n"
ASK += "print(salpchain.identity(salpchain.MPC()))"


def changed(policy, **card):
    """The policy with other fields of its card."""
    return Policy(policy.network, replace(policy.card, **card))


def test_names_and_training_do_not_make_a_policy_another_but_what_makes_it_act_does():
    policy = fresh()
    same = changed(policy, name="other", steps=7, lengths=(2, 3))
    assert identity(same) == identity(policy) and len(identity(policy)) == 16
    nudged = eqx.tree_at(lambda n: n.log_std, policy.network, policy.network.log_std + 1e-3)
    others = [
        Policy(nudged, policy.card),
        changed(policy, observation="proximity"),
        changed(policy, action="pair"),
        changed(policy, control=replace(policy.card.control, graph="full")),
        fresh("gatv2"),
    ]
    assert len({identity(one) for one in [policy, *others]}) == 6


def test_every_controller_that_comes_along_is_another():
    assert len({identity(load(name)) for name in names()}) == len(names())


class Mine:
    """A controller as a user writes one."""

    def __init__(self, gain, inner=None):
        self.gain, self.inner, self.me = gain, inner, self

    card = PolicyCard(name="mine")

    def act(self, state):
        return self.gain * state.obs[:, :1]


def test_controllers_that_are_no_policies_differ_by_all_that_they_hold():
    one = fresh()
    crew = [
        Mine(0.5), Mine(0.6), Mine(0.5, Greedy()), Mine(0.5, Approach()), Mine(jnp.ones(2)),
        Mine(0.5, one), Mine(0.5, fresh("gatv2")), Late(one), Late(fresh("gatv2")),
        MPC(), MPC(samples=8), MPC.guided(one),
    ]  # fmt: skip
    assert len({identity(each) for each in crew}) == len(crew)
    assert identity(Mine(0.5)) == identity(Mine(0.5)) == identity(Mine(np.array(0.5)[()].item()))
    stated = Mine(0.5)
    setattr(stated, "identity", "my own")  # noqa: B010
    assert identity(stated) == "my own"


def test_a_file_states_the_identity_of_what_is_loaded_from_it(tmp_path):
    for half in (False, True):
        path = tmp_path / f"{half}.safetensors"
        save_policy(fresh(), path, half=half)
        header, _ = read_arrays(path, KIND, VERSION)
        assert header["identity"] == identity(load(path))
    assert identity(load(path)) != identity(fresh())  # rounded: it acts differently


def test_a_file_of_before_is_read_and_gets_its_identity(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(fresh(), path)
    header, arrays = read_arrays(path, KIND, VERSION)
    del header["identity"]
    write_arrays(path, KIND, VERSION, header, arrays)
    assert identity(load(path)) == identity(fresh())


def test_an_identity_is_the_same_in_every_process_and_precision():
    here = f"{identity(load('any-length'))} {identity(MPC())}\n"
    for more in ({}, {"JAX_ENABLE_X64": "1", "PYTHONHASHSEED": "7"}):
        code = f"import os; os.environ.update({json.dumps(more)})\n{ASK}"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        if more and "float64" in done.stderr:
            pytest.skip("policies do not load in double precision yet")
        assert done.stdout == here, done.stderr
    double = jax.tree.map(lambda x: np.asarray(x, np.float64), fresh().network)
    assert identity(Policy(double, fresh().card)) == identity(fresh())
