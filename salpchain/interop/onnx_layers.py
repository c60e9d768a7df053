"""Our layers as ONNX operators, for a symbolic number of chains and units.

Shapes are (chain, unit, ...). Only common operators are used, so that converters for small devices
know them. Meaning and names are those of `networks/layers.py` and `networks/graph.py`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from salpchain.interop.extras import need
from salpchain.networks.config import REACH
from salpchain.networks.layers import (
    GATv2Conv,
    GCNConv,
    Head,
    LayerNorm,
    Linear,
    TransformerConv,
)

onnx = need("onnx", "onnx")

UNSEEN = 1e9  # taken from the score of a neighbour that is not there: its weight becomes 0


class Builder:
    """Nodes and constants of a graph that grows; values go by their names."""

    def __init__(self) -> None:
        """An empty graph."""
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._known: dict[tuple[str, bytes, tuple[int, ...]], str] = {}

    def constant(self, value: Any) -> str:
        """A constant array; equal ones are stored once."""
        array = np.asarray(value)
        array = np.asarray(array, np.int64 if array.dtype.kind == "i" else np.float32)
        known = (str(array.dtype), array.tobytes(), array.shape)
        if known not in self._known:
            self._known[known] = f"constant_{len(self.constants)}"
            self.constants.append(onnx.numpy_helper.from_array(array, self._known[known]))
        return self._known[known]

    def op(self, kind: str, *inputs: Any, name: str | None = None, **attributes: Any) -> str:
        """The output of an operator; inputs that are no names are constants."""
        names = [x if isinstance(x, str) else self.constant(x) for x in inputs]
        output = name or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(onnx.helper.make_node(kind, names, [output], **attributes))
        return output

    def linear(self, layer: Linear, x: str) -> str:
        """x W + b on the last axis."""
        return self.op("Add", self.op("MatMul", x, layer.weight), layer.bias)

    def gelu(self, x: str) -> str:
        """x times the normal distribution function of x."""
        erf = self.op("Erf", self.op("Mul", x, 0.5**0.5))
        return self.op("Mul", self.op("Mul", x, 0.5), self.op("Add", erf, 1.0))

    def layer_norm(self, x: str, norm: LayerNorm | None = None) -> str:
        """Zero mean and unit variance over the last axis, then scale and shift if there are."""
        centred = self.op("Sub", x, self.op("ReduceMean", x, axes=[-1]))
        variance = self.op("ReduceMean", self.op("Mul", centred, centred), axes=[-1])
        normal = self.op("Div", centred, self.op("Sqrt", self.op("Add", variance, 1e-5)))
        if norm is None:
            return normal
        return self.op("Add", self.op("Mul", normal, norm.scale), norm.shift)

    def head(self, head: Head, x: str) -> str:
        """Linear layers with GELU between them."""
        for layer in head.layers[:-1]:
            x = self.gelu(self.linear(layer, x))
        return self.linear(head.layers[-1], x)

    def split_linear(self, layer: Linear, x: str, heads: int) -> str:
        """`linear`, (chain, unit, heads x feature), by heads: (chain, unit, head, feature)."""
        features = layer.weight.shape[1] // heads  # told, for -1 is not known of an empty batch
        return self.op("Reshape", self.linear(layer, x), [0, 0, heads, features])

    def total(self, x: str, axis: int) -> str:
        """Sum over an axis, which goes."""
        return self.op("ReduceSum", x, [axis], keepdims=0)

    def ones(self, x: str) -> str:
        """(chain, unit, 1) of ones."""
        size = self.op("Slice", self.op("Shape", x), [0], [2])
        shape = self.op("Concat", size, [1], axis=0)
        one = onnx.numpy_helper.from_array(np.ones(1, np.float32))
        return self.op("ConstantOfShape", shape, value=one)


class Mixed:
    """Each unit sees the one before it, itself, and the one after it."""

    others = 0  # nodes after the units
    alike = False  # whether every node sees the same

    def __init__(self, builder: Builder, x: str) -> None:
        """The graph over the units of an observation."""
        self.builder = builder
        ones = builder.ones(x)
        self.degree = self.gather(ones)
        absent = builder.op("Sub", self._sides(ones), 1.0)  # (chain, unit, 3, 1): 0 or -1
        self._unseen = builder.op("Mul", absent, UNSEEN)

    def _along(self, x: str, rank: int) -> tuple[str, str]:
        """What the unit before has, what the unit after has; zeros at the ends."""
        pads = [0, 1, *[0] * (rank - 2)] * 2
        padded = self.builder.op("Pad", x, pads)
        ends = np.iinfo(np.int64).max
        previous = self.builder.op("Slice", padded, [0], [-2], [1])
        return previous, self.builder.op("Slice", padded, [2], [ends], [1])

    def _sides(self, x: str, rank: int = 3) -> str:
        """(chain, unit, ...) as (chain, unit, 3, ...): of the one before, own, of the one after."""
        previous, following = self._along(x, rank)
        parts = [self.builder.op("Unsqueeze", part, [2]) for part in (previous, x, following)]
        return self.builder.op("Concat", *parts, axis=2)

    def gather(self, x: str) -> str:
        """Own value plus those of the neighbours."""
        previous, following = self._along(x, 3)
        return self.builder.op("Add", self.builder.op("Add", x, previous), following)

    def pairs(self, query: str, key: str) -> tuple[str, str]:
        """Heads of each unit and of those it may see, of shapes that broadcast."""
        return self.builder.op("Unsqueeze", query, [2]), self._sides(key, 4)

    def products(self, query: str, key: str) -> str:
        """Scalar products, (chain, unit, seen, head)."""
        return self.builder.total(self.builder.op("Mul", *self.pairs(query, key)), -1)

    def attend(self, scores: str, values: str) -> str:
        """Values of those seen, weighted by the softmax of the scores: (chain, unit, head, f)."""
        weights = self.builder.op("Softmax", self.builder.op("Add", scores, self._unseen), axis=2)
        weights = self.builder.op("Unsqueeze", weights, [-1])
        return self.builder.total(self.builder.op("Mul", weights, self._sides(values, 4)), 2)


class Full:
    """Every unit sees every unit."""

    others = 0
    alike = True

    def __init__(self, builder: Builder, x: str) -> None:
        """The graph over the units of an observation."""
        self.builder = builder
        self.degree = self.gather(builder.ones(x))

    def gather(self, x: str) -> str:
        """The sum over all, the same for each: (chain, 1, feature)."""
        return self.builder.op("ReduceSum", x, [1], keepdims=1)

    def pairs(self, query: str, key: str) -> tuple[str, str]:
        """Heads of each unit and of all, of shapes that broadcast."""
        return self.builder.op("Unsqueeze", query, [2]), self.builder.op("Unsqueeze", key, [1])

    def products(self, query: str, key: str) -> str:
        """Scalar products, (chain, unit, seen, head)."""
        rows = self.builder.op("Transpose", query, perm=[0, 2, 1, 3])
        columns = self.builder.op("Transpose", key, perm=[0, 2, 3, 1])
        scores = self.builder.op("MatMul", rows, columns)
        return self.builder.op("Transpose", scores, perm=[0, 2, 3, 1])

    def attend(self, scores: str, values: str) -> str:
        """Values of all, weighted by the softmax of the scores: (chain, unit, head, feature)."""
        weights = self.builder.op("Softmax", scores, axis=2)
        rows = self.builder.op("Transpose", weights, perm=[0, 3, 1, 2])
        columns = self.builder.op("Transpose", values, perm=[0, 2, 1, 3])
        return self.builder.op(
            "Transpose", self.builder.op("MatMul", rows, columns), perm=[0, 2, 1, 3]
        )


class Near(Full):
    """Each unit sees those at most `REACH` links away."""

    alike = False

    def __init__(self, builder: Builder, x: str) -> None:
        """The graph over the units of an observation."""
        self.builder = builder
        number = builder.op("Gather", builder.op("Shape", x), 1)
        row = builder.op("Range", 0, number, 1)
        column = builder.op("Unsqueeze", row, [1])
        last = builder.op("Sub", number, 1)
        self.sees = self._number(self._sees(row, column, last))
        self.weights = self._weights(row, column, last)
        self.degree = builder.op("ReduceSum", self.weights, [1], keepdims=1)
        unseen = builder.op("Mul", builder.op("Sub", self.sees, 1.0), UNSEEN)
        self._unseen = builder.op("Unsqueeze", unseen, [-1])

    def _sees(self, row: str, column: str, last: str) -> str:
        return self._within(row, column, REACH)

    def _weights(self, row: str, column: str, last: str) -> str:
        return self.sees

    def _number(self, x: str) -> str:
        return self.builder.op("Cast", x, to=onnx.TensorProto.FLOAT)

    def _within(self, row: str, column: str, links: int) -> str:
        apart = self.builder.op("Abs", self.builder.op("Sub", row, column))
        return self.builder.op("LessOrEqual", apart, links)

    def gather(self, x: str) -> str:
        """The weighted sum over those seen."""
        return self.builder.op("MatMul", self.weights, x)

    def attend(self, scores: str, values: str) -> str:
        """Values of those seen, weighted by the softmax of the scores."""
        return super().attend(self.builder.op("Add", scores, self._unseen), values)


class Hub(Near):
    """Each unit sees its neighbours and the last node, which is no unit and sees all.

    In a graph convolution, that node hears the mean of the units.
    """

    others = 1

    def _weights(self, row: str, column: str, last: str) -> str:
        is_hub, is_unit = (
            self._number(self.builder.op(kind, place, last))
            for kind, place in (("Equal", column), ("Less", row))
        )
        more = self.builder.op("Sub", self._number(last), 1.0)  # than one unit that it hears
        shared = self.builder.op("Mul", self.builder.op("Mul", is_hub, is_unit), more)
        return self.builder.op("Div", self.sees, self.builder.op("Add", shared, 1.0))

    def _sees(self, row: str, column: str, last: str) -> str:
        is_hub = [self.builder.op("Equal", place, last) for place in (row, column)]
        with_hub = self.builder.op("Or", *is_hub)
        return self.builder.op("Or", self._within(row, column, 1), with_hub)


Seen = Mixed | Full
GRAPHS: dict[str, type[Mixed] | type[Full]] = {
    "mixed": Mixed,
    "full": Full,
    "near": Near,
    "hub": Hub,
}


def graph_layer(layer: GCNConv | GATv2Conv | TransformerConv, x: str, graph: Seen) -> str:
    """The layer's output, (chain, unit, feature)."""
    if isinstance(layer, GCNConv):
        return _gcn(layer, x, graph)
    return (
        _gatv2(layer, x, graph) if isinstance(layer, GATv2Conv) else _transformer(layer, x, graph)
    )


def _gcn(layer: GCNConv, x: str, graph: Seen) -> str:
    build = graph.builder
    degree = build.op("Add", graph.degree, 1.0) if layer.improved else graph.degree
    root = build.op("Sqrt", degree)
    scaled = build.op("Div", x, root)
    summed = graph.gather(scaled)
    if layer.improved:
        summed = build.op("Add", summed, scaled)
    summed = build.op("Div", summed, root)
    if graph.alike:  # the same for all units: once for each
        summed = build.op("Mul", summed, build.ones(x))
    return build.linear(layer.linear, summed)


def _gatv2(layer: GATv2Conv, x: str, graph: Seen) -> str:
    build, (heads, features) = graph.builder, layer.attention.shape
    source, target = (build.split_linear(w, x, heads) for w in (layer.source, layer.target))
    both = build.op("LeakyRelu", build.op("Add", *graph.pairs(target, source)), alpha=0.2)
    scores = build.total(build.op("Mul", both, layer.attention), -1)
    mixed = build.op("Reshape", graph.attend(scores, source), [0, 0, heads * features])
    return build.op("Add", mixed, layer.bias)


def _transformer(layer: TransformerConv, x: str, graph: Seen) -> str:
    build, heads = graph.builder, layer.heads
    query, key, value = (
        build.split_linear(w, x, heads) for w in (layer.query, layer.key, layer.value)
    )
    features = layer.query.bias.shape[0] // heads
    scores = build.op("Mul", graph.products(query, key), features**-0.5)
    heard = build.op("ReduceMean", graph.attend(scores, value), axes=[2], keepdims=0)
    own = build.linear(layer.skip, x)
    parts = build.op("Concat", heard, own, build.op("Sub", heard, own), axis=-1)
    gate = build.op("Sigmoid", build.op("MatMul", parts, np.asarray(layer.gate)[:, None]))
    return build.op("Add", heard, build.op("Mul", gate, build.op("Sub", own, heard)))


def opset(version: int) -> Sequence[Any]:
    """What the operators mean."""
    return [onnx.helper.make_opsetid("", version)]
