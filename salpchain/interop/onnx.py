"""A policy as one ONNX file that runs without JAX and without salpchain."""

from typing import Any

from salpchain import __version__
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.files import StrPath, write_bytes
from salpchain.interop.extras import need
from salpchain.interop.metadata import metadata
from salpchain.networks.actor_critic import GraphActorCritic
from salpchain.networks.gt import GT
from salpchain.networks.layers import Layers
from salpchain.networks.mlp import MLP
from salpchain.tasks.config import ACTION_SIZES
from salpchain.tasks.features import observation_size

onnx = need("onnx", "onnx")

from salpchain.interop.onnx_layers import GRAPHS, Builder, Seen, graph_layer, opset

OPSET = 17  # of 2022: known to most runtimes
IR_VERSION = 8  # the file format of that time


def export_onnx(policy: Policy, path: StrPath) -> None:
    """The policy as one file: `observation` in, `action` and `thrust` out, weights inside.

    Shapes: observation (batch, units, features), action (batch, units, act), thrust (batch, units)
    in newton. Batch and units may be any number (an `mlp` has its own number of units). The
    metadata says what each number is.

    Raises:
        InputError: the extra `onnx` is not installed.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    write_bytes(path, model_of(policy).SerializeToString())


def model_of(policy: Policy) -> Any:
    """The checked ONNX model."""
    card, build = policy.card, Builder()
    units = card.length if card.control.model == "mlp" else "units"
    mean = _mean(build, policy.network, card)
    action = build.op("Clip", mean, -1.0, 1.0, name="action")
    _thrust(build, action, card.action)
    shapes = {
        "observation": ("batch", units, observation_size(card.observation)),
        "action": ("batch", units, ACTION_SIZES[card.action]),
        "thrust": ("batch", units),
    }
    values = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)
        for name, shape in shapes.items()
    ]
    graph = onnx.helper.make_graph(
        build.nodes, "salpchain", values[:1], values[1:], build.constants
    )
    model = onnx.helper.make_model(graph, opset_imports=opset(OPSET), ir_version=IR_VERSION)
    model.producer_name, model.producer_version = "salpchain", __version__
    onnx.helper.set_model_props(model, metadata(card))
    onnx.checker.check_model(model, full_check=True)
    return model


def _mean(build: Builder, network: Any, card: PolicyCard) -> str:
    """The mean action, before clipping."""
    x = "observation"
    if isinstance(network, MLP):
        row = build.op("Reshape", x, [0, card.length * observation_size(card.observation)])
        shape = [0, card.length, ACTION_SIZES[card.action]]
        return build.op("Reshape", build.head(network.actor, row), shape)
    assert isinstance(network, GraphActorCritic)
    kind = GRAPHS[network.graph]
    if kind.others:
        x = build.op("Pad", x, [0, 0, 0, 0, kind.others, 0])
    features = _trunk(network.trunk, x, kind(build, x))
    if kind.others:
        features = build.op("Slice", features, [0], [-kind.others], [1])
    return build.head(network.actor, features)


def _trunk(trunk: Any, x: str, graph: Seen) -> str:
    build = graph.builder
    if isinstance(trunk, GT):
        x = build.linear(trunk.entry, x)
        for block in trunk.blocks:
            heard = build.gelu(graph_layer(block.layer, x, graph))
            x = build.layer_norm(build.op("Add", x, heard), block.norm)
        return x
    assert isinstance(trunk, Layers)
    x = build.gelu(graph_layer(trunk.first, x, graph))
    for layer in (trunk.second, *trunk.more):
        x = build.gelu(graph_layer(layer, build.layer_norm(x), graph))
    return x


def _thrust(build: Builder, action: str, kind: str) -> None:
    """Thrusts (N) of the clipped actions, as the task maps them."""
    first = build.op("Gather", action, 0, axis=2, name=None if kind == "pair" else "thrust")
    if kind == "pair":
        apart = build.op("Sub", first, build.op("Gather", action, 1, axis=2))
        build.op("Mul", apart, 0.5, name="thrust")
