import json

import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from salpchain.interop.onnx import export_onnx
from salpchain.tasks.features import layout as layout_of
from salpchain.tasks.features import observation_size
from tests.interop.policies import fresh

GRAPHS = ("mixed", "full", "near", "hub")
MODELS = ("gcn", "gatv2", "gt")
KINDS = [(model, graph, {}) for model in MODELS for graph in GRAPHS]
KINDS += [("gcn", graph, {"improved": True}) for graph in ("mixed", "hub")]
KINDS += [(model, "mixed", {"depth": 3}) for model in MODELS]


def actions(policy, obs):
    """By JAX, (chain, unit, act), clipped."""
    present, joined = jnp.ones(obs.shape[1], bool), jnp.ones(obs.shape[1] - 1, bool)
    act = jax.jit(jax.vmap(lambda one: policy.network.act(one, present, joined)))
    return np.clip(act(obs), -1, 1)


def observed(batch, units, observation="body"):
    shape = batch, units, observation_size(observation)
    return np.random.default_rng(units).normal(size=shape).astype(np.float32)


def actions_at_all(policy, lengths):
    """By JAX, clipped, of `observed(1, length)` for each length; all in one program with masks."""
    slots = max(lengths)
    obs = np.stack([np.pad(observed(1, n)[0], ((0, slots - n), (0, 0))) for n in lengths])
    present = np.arange(slots) < np.array(lengths)[:, None]
    acted = jax.jit(jax.vmap(policy.network.act))(obs, present, present[:, 1:])
    return [np.clip(row[:n], -1, 1) for row, n in zip(acted, lengths, strict=True)]


@pytest.mark.parametrize(("model", "graph", "settings"), KINDS)
def test_onnxruntime_acts_as_jax_does_at_every_length(model, graph, settings, tmp_path):
    policy, lengths = fresh(model, graph, **settings), (2, 5, 8, 64, 128)
    export_onnx(policy, tmp_path / "policy.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    for units, expected in zip(lengths, actions_at_all(policy, lengths), strict=True):
        two = np.concatenate([np.zeros((1, units, 22), np.float32), observed(1, units)])
        action, thrust = session.run(["action", "thrust"], {"observation": two})
        np.testing.assert_allclose(action[1], expected, atol=1e-5)
        np.testing.assert_allclose(thrust[1], expected[:, 0], atol=1e-5)
    if graph == "mixed" and not settings:
        assert np.abs(expected).max() == 1 and (np.abs(expected) < 1).any()


def test_pairs_become_thrusts_and_an_mlp_keeps_its_length(tmp_path):
    policy = fresh("mlp", observation="table1", action="pair", length=3)
    export_onnx(policy, tmp_path / "policy.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    obs = observed(4, 3, "table1")
    action, thrust = session.run(["action", "thrust"], {"observation": obs})
    expected = actions(policy, obs)
    np.testing.assert_allclose(action, expected, atol=1e-5)
    np.testing.assert_allclose(thrust, (expected[..., 0] - expected[..., 1]) / 2, atol=1e-5)
    assert session.get_inputs()[0].shape == ["batch", 3, 24]


def test_the_file_says_what_it_is_and_is_small(tmp_path):
    path = tmp_path / "policy.onnx"
    export_onnx(fresh(), path)
    model = onnx.load(path)
    about = {entry.key: entry.value for entry in model.metadata_props}
    layout = json.loads(about["observation_layout"])
    assert [row["name"] for row in layout] == [field.name for field in layout_of("body")]
    assert all(row["unit"] and row["frame"] for row in layout)
    assert about["model"] == "gcn" and json.loads(about["training_lengths"]) == [8]
    assert path.stat().st_size < 1_000_000
    assert {node.op_type for node in model.graph.node} <= COMMON
    assert all(entry.domain == "" for entry in model.opset_import)


COMMON = {"Add", "Sub", "Mul", "Div", "MatMul", "Sqrt", "Erf", "Clip", "Concat", "Pad", "Slice"}
COMMON |= {"Shape", "ConstantOfShape", "ReduceMean", "Unsqueeze", "Gather"}
