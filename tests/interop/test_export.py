import re
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import onnxruntime
import pytest
import torch

from examples.robot import OBSERVATIONS, opened, swim, thrusts
from salpchain.cli.main import run
from salpchain.controllers.greedy import Greedy
from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import save_policy
from salpchain.errors import InputError
from salpchain.interop import FORMATS
from salpchain.interop.export import export
from salpchain.interop.network import load_torch
from salpchain.networks.graph import GRAPHS, of_adjacency
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS as LAYOUTS
from salpchain.tasks.features import layout
from salpchain.tasks.observations import observe
from salpchain.tasks.reach.task import SCLD
from tests.interop.policies import fresh
from tests.interop.test_onnx import KINDS, actions, observed

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("policies")
    save_policy(fresh(), folder / "policy.safetensors")
    return folder


@pytest.mark.parametrize(("model", "graph", "settings"), [*KINDS, ("mlp", "mixed", {})])
def test_the_torch_module_acts_as_jax_does(model, graph, settings, tmp_path):
    policy = fresh(model, graph, action="pair", length=5, **settings)
    save_policy(policy, tmp_path / "policy.safetensors")
    out = tmp_path / "out.safetensors"
    assert run(["export", str(tmp_path), "--format", "torch", "--out", str(out)]) == 0
    module, obs = load_torch(out), observed(2, 5)
    expected = actions(policy, obs)
    np.testing.assert_allclose(module(torch.from_numpy(obs)), expected, atol=1e-5)
    pushed = module.thrust(torch.from_numpy(obs))
    np.testing.assert_allclose(pushed, (expected[..., 0] - expected[..., 1]) / 2, atol=1e-5)


def test_the_torch_module_needs_no_jax(folder):
    out = folder / "torch.safetensors"
    assert run(["export", str(folder), "--format", "torch", "--out", str(out)]) == 0
    code = (
        "import sys; from salpchain.interop.network import load_torch; import torch\n"
        f"print(load_torch({str(out)!r})(torch.zeros(64, 22)).shape, 'jax' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "torch.Size([64, 1]) False"


@pytest.fixture(scope="module")
def swum():
    """Chains that swam under random thrusts, bent and moving."""
    env = SCLD(TaskConfig(length=6, contact=False))

    def swim(key):
        def turn(index, state):
            return env.step(state, jr.uniform(jr.fold_in(key, index), (6, 1), minval=-1.0))

        return jax.lax.fori_loop(0, 30, turn, env.reset(key))

    return jax.jit(jax.vmap(swim))(jr.split(jr.key(0), 5))


def poses(states, index):
    units = states.chain.units
    rows = units.position, units.angle, units.velocity, units.angular_velocity, states.target
    return [np.asarray(row[index], np.float64) for row in rows]


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_the_robot_sees_and_does_what_the_policy_does_in_jax(swum, name, tmp_path):
    policy, out = fresh(observation=name), tmp_path / "robot.onnx"
    export(policy, out, "onnx")
    session = onnxruntime.InferenceSession(out)
    seen = jax.vmap(partial(observe, name))(swum.chain, swum.target, swum.force)
    expected = actions(policy, seen)
    for index in range(5):
        obs = OBSERVATIONS[name](*poses(swum, index))
        np.testing.assert_allclose(obs, seen[index], atol=1e-5)
        np.testing.assert_allclose(
            thrusts(session, *poses(swum, index)), expected[index, :, 0], atol=1e-4
        )


@pytest.mark.parametrize(("which", "bad"), [(0, np.nan), (4, np.inf)])
def test_a_robot_that_lost_a_marker_sends_no_thrust(swum, which, bad):
    given = poses(swum, 0)
    given[which][2, 1] = bad
    with pytest.raises(ValueError, match=("position" if which == 0 else "target") + " must be"):
        thrusts(None, *given)


def test_a_robot_takes_no_pose_that_only_broadcasts(swum):
    *rest, target = poses(swum, 0)
    with pytest.raises(ValueError, match=r"target must be \(6, 2\) finite numbers"):
        thrusts(None, *rest, target[:1])


def test_an_unknown_format_or_a_controller_without_weights_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="unknown format 'ONNX': choose one of onnx, torch"):
        export(fresh(), tmp_path / "x.ONNX", "ONNX")
    for other in ("gatv2", "mlp"):  # a network that is not the one the card names
        odd = Policy(fresh(other).network, fresh("gcn").card)
        for kind in FORMATS:
            with pytest.raises(InputError, match="the card of gcn-mixed names gcn, its network is"):
                export(odd, tmp_path / f"x{FORMATS[kind]}", kind)
    monkeypatch.setitem(GRAPHS, "alone", lambda present, joined: of_adjacency(jnp.diag(present)))
    with pytest.raises(InputError, match="only the graphs mixed, full, near, hub can be exported"):
        export(fresh(graph="alone"), tmp_path / "x.onnx", "onnx")
    with pytest.raises(InputError, match="only a learned policy can be exported"):
        export(Greedy(), str(tmp_path / "x.onnx"), "onnx")
    assert not list(tmp_path.iterdir())


def test_the_robots_program_runs_without_jax(folder):
    out = folder / "program.onnx"
    assert run(["export", str(folder), "--out", str(out)]) == 0
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); sys.argv = ['robot', {str(out)!r}]\n"
        "from examples import robot; robot.main(); assert 'jax' not in sys.modules"
    )
    start = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.count("[") == 10, done.stderr
    assert time.monotonic() - start > 1  # ten control steps of 0.1 s


def test_the_robots_loop_sends_no_thrust_without_a_pose_and_goes_on(swum, folder, capsys):
    out = folder / "loop.onnx"
    assert run(["export", str(folder), "--out", str(out)]) == 0
    lost = poses(swum, 0)
    lost[0] = lost[0] * np.nan
    given, sent = iter([poses(swum, 0), lost, poses(swum, 1)]), []
    swim(opened(str(out), 6), lambda: next(given), sent.append, 3)
    assert sent[0].any() and not sent[1].any() and sent[2].any()
    assert "no thrust: position must be (6, 2) finite" in capsys.readouterr().err


def test_a_robot_refuses_a_policy_that_is_not_for_it(tmp_path):
    for policy, word in (
        (fresh(observation="table1"), "must be of a policy that sees body or proximity"),
        (fresh("mlp", length=5), "steers 5 units, the robot has 8"),
    ):
        export(policy, tmp_path / "policy.onnx", "onnx")
        with pytest.raises(ValueError, match=word):
            opened(str(tmp_path / "policy.onnx"), 8)


@pytest.mark.parametrize(
    ("given", "word"), [([], "usage: python"), (["none.onnx"], "robot: .*none.onnx")]
)
def test_the_robots_program_says_what_it_needs(given, word):
    command = [sys.executable, str(ROOT / "examples" / "robot.py"), *given]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and re.match(word, done.stderr) and done.stderr.count("\n") == 1


def test_a_torch_module_refuses_observations_of_another_shape_and_what_is_no_file(tmp_path):
    export(fresh("mlp", length=5), tmp_path / "policy", "torch")
    module = load_torch(tmp_path / "policy")
    with pytest.raises(InputError, match=r"must have shape \(\.\.\., 5, 22\), got \(4, 22\)"):
        module(torch.zeros(4, 22))
    with pytest.raises(InputError, match="is a folder"):
        load_torch(tmp_path)


def test_the_layouts_name_the_numbers_in_their_order(swum):
    """By what each number is known to be in states that swam."""
    env = SCLD(TaskConfig(length=6, observation="table1"))
    names = {kind: [field.name for field in layout(kind)] for kind in LAYOUTS}
    assert len(names["table1"]) == 24 and len(names["body"]) == 22
    table1 = jax.jit(jax.vmap(env.observe))(swum.chain, swum.target, swum.force)
    see = dict(zip(names["table1"], jnp.moveaxis(table1, -1, 0), strict=True))
    units = swum.chain.units
    np.testing.assert_allclose(see["position y"], units.position[..., 1])
    np.testing.assert_allclose(see["angular velocity"], units.angular_velocity)
    error = swum.target - units.position
    np.testing.assert_allclose(see["own target point minus position x"], error[..., 0], atol=1e-6)
    np.testing.assert_allclose(
        see["last force of the next unit y"][:, :-1], swum.force[:, 1:, 1], atol=1e-6
    )
    see = dict(zip(names["body"], jnp.moveaxis(swum.obs, -1, 0), strict=True))
    np.testing.assert_allclose(see["angular velocity"], units.angular_velocity / 3, atol=1e-6)
    along = error[..., 0] * jnp.cos(units.angle) + error[..., 1] * jnp.sin(units.angle)
    np.testing.assert_allclose(
        see["own target point minus own position along"],
        np.sign(along) * np.log1p(5 * np.abs(along)),
        atol=1e-5,
    )


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--format", "tflite"], "unknown format 'tflite': choose one of onnx, torch"),
        (["--format", "torch", "--out", "x.onnx"], "must end in .safetensors"),
        (["--out", "nowhere/x.onnx"], "no such file or directory"),
        (["--format", "torch", "--out", "policy.safetensors"], "the policy itself"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    folder, arguments, word, capsys, monkeypatch
):
    monkeypatch.chdir(folder)
    assert run(["export", ".", *arguments]) == 2
    said = capsys.readouterr().err
    assert word in said and said.count("\n") == 1
