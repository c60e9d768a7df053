"""Models and controllers in a module of a user's own."""

import json

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

import salpchain
from salpchain.cli.main import run
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from tests.own import Spin

SMALL = ["--length=2", "--steps=64", "--set=ppo.envs=4", "--set=ppo.rollout=8"]
SMALL += ["--set=ppo.minibatch=16", "--set=task.most_steps=8"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("own") / "run"
    assert run(["train", *SMALL, "--model=tests.own:Deaf", f"--out={out}"]) == 0
    return out


@pytest.mark.slow
def test_a_model_of_ones_own_is_trained_kept_and_steers_any_length(trained):
    policy = salpchain.load(str(trained))
    assert policy.card.name == "Deaf-mixed-2"
    env = salpchain.SCLD(policy.card.task(5))
    state = env.reset(jr.key(0))
    alone = jnp.zeros(5, bool).at[2].set(True)
    others = jnp.where(alone[:, None], state.obs, 0.0)
    acts = policy.network.act(state.obs, state.chain.present, state.chain.joined)
    deaf = policy.network.act(others, state.chain.present, state.chain.joined)
    np.testing.assert_allclose(acts[2], deaf[2], rtol=1e-6)
    assert np.abs(acts[1] - deaf[1]).max() > 0


def test_a_model_of_ones_own_is_not_exported_and_says_so(trained, tmp_path, capsys):
    out = tmp_path / "policy.onnx"
    assert run(["export", str(trained), f"--out={out}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("gcm", "unknown model 'gcm': choose one of gcn, gatv2, gt, mlp, or one of your own"),
        ("tests.own:minus", "must be a class that is an equinox.Module, got "),
        ("tests.own:Narrow", r"must give features \(unit, 128\), got \(3, 5\) of 3 units"),
        ("tests.own:Hover", "must be made with .key, inputs, config. and called with"),
        ("subprocess:Popen", "must be a class that is an equinox.Module, got the class Popen"),
    ],
)
def test_what_is_no_model_is_one_line(model, said):
    with pytest.raises(InputError, match=said):
        actor_critic(jr.key(0), ControlConfig(model=model), 22, 1, 8)


def test_a_controller_of_ones_own_is_tested_like_ours(tmp_path, capsys):
    out = tmp_path / "results"
    asked = ["--lengths=2", "--trials=2", "--time-limit=fixed", f"--out={out}", "--json"]
    assert run(["evaluate", "tests.own:Spin", *asked]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["policy"] == "spin" and summary["baseline"]["policy"] == "greedy"
    assert json.loads((out / "evaluation.json").read_text())["identity"] == summary["identity"]
    assert isinstance(salpchain.load("tests.own:Spin"), Spin)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere:Spin", "controller nowhere:Spin: there is no module nowhere"),
        ("tests.own:Spun", "tests.own has no Spun, it has"),
        ("tests.own:Demanding", "cannot be made without arguments: .*gain"),
        ("tests.own:Hover", "a controller is .* got Hover"),
    ],
)
def test_what_is_no_controller_is_one_line(name, said):
    with pytest.raises(InputError, match=said):
        salpchain.load(name)


def test_a_task_and_an_observation_of_ones_own_serve_a_bridge():
    import gymnasium

    import salpchain.interop.gymnasium  # noqa: F401 - registers the environment

    own = {"task": "tests.own:Hover", "observation": "tests.own:FASTER", "softness": 0.2}
    env = gymnasium.make("salpchain/SCLD-v0", length=2, most_steps=4, **own)
    obs, _ = env.reset(seed=0)
    _, reward, *_ = env.step(np.zeros(env.action_space.shape, np.float32))
    assert obs.size == 2 * 25 and float(reward) == pytest.approx(1.0, abs=0.05)
    with pytest.raises(InputError, match="unknown setting of the task 'speed'"):
        gymnasium.make("salpchain/SCLD-v0", speed=0.1)
    assert jax.tree.leaves(obs)[0].dtype == np.float32
