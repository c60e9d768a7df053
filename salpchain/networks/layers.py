"""Layers that controllers share, with the meaning and defaults of PyTorch (Geometric)."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.networks.graph import Graph
from salpchain.xla import product, whole_gradient

WIDTH = 128  # features of a hidden layer (paper Table 3)
ACTOR_GAIN = 0.01  # of an actor's last layer, so that training starts from no thrust (chosen)


class Linear(eqx.Module):
    """x W + b on the last axis (torch.nn.Linear, W transposed)."""

    weight: Float[Array, "inputs outputs"]
    bias: Float[Array, " outputs"]

    def __call__(self, x: Float[Array, "*rows inputs"]) -> Float[Array, "*rows outputs"]:
        """(..., inputs) to (..., outputs)."""
        return product(x, self.weight) + self.bias


class GCNConv(eqx.Module):
    """Graph convolution with symmetric normalisation (paper equation 2; PyG `GCNConv`).

    `improved` counts each node's own features twice (PyG's option of that name). Without, two nodes
    that see each other get the same sum, whatever the weights: so do the units of a chain of two.
    """

    linear: Linear
    improved: bool = eqx.field(static=True, default=False)

    def __call__(
        self, x: Float[Array, "unit inputs"], graph: Graph
    ) -> Float[Array, "unit outputs"]:
        """Sum over the nodes j seen by i of W x_j / sqrt(degree_i degree_j), plus the bias.

        The sum is taken before the product: the same, and cheaper where inputs are few.
        """
        again = 1 if self.improved else 0
        scale = jax.lax.rsqrt(graph.degree() + again)[:, None].astype(x.dtype)
        scaled = scale * x
        summed = graph.gather(scaled) + scaled if self.improved else graph.gather(scaled)
        return self.linear(scale * summed)


class GATv2Conv(eqx.Module):
    """Attention of a node to those it sees (paper equation 3; Brody et al. 2022; PyG `GATv2Conv`).

    The score of j for i is a . leaky_relu(W_s x_j + W_t x_i), per head; heads are concatenated.
    """

    source: Linear  # of the nodes seen, whose values are mixed
    target: Linear  # of the node that sees
    attention: Float[Array, "head feature"]
    bias: Float[Array, " outputs"]

    def __call__(
        self, x: Float[Array, "unit inputs"], graph: Graph
    ) -> Float[Array, "unit outputs"]:
        """(unit, inputs) to (unit, heads x features)."""
        heads = self.attention.shape[0]
        source, target = (_split(layer(x), heads) for layer in (self.source, self.target))
        attention = self.attention if heads > 1 else self.attention[0]

        def score(target: Array, source: Array) -> Array:
            return (jax.nn.leaky_relu(source + target, 0.2) * attention).sum(axis=-1)

        scores = whole_gradient(graph.compare(score, target, source), self.bias)
        mixed = graph.attend(scores, source)
        return whole_gradient(mixed.reshape(x.shape[0], -1) + self.bias, self.bias, kept=True)


class Layers(eqx.Module):
    """Graph layers, GELU after each, layer norm without parameters between (paper Table 3: two)."""

    first: GCNConv | GATv2Conv
    second: GCNConv | GATv2Conv
    more: Sequence[GCNConv | GATv2Conv]

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features of each unit from what the units within as many edges of it observe."""
        x = gelu(self.first(x, graph))
        for layer in (self.second, *self.more):
            x = gelu(layer(layer_norm(x), graph))
        return x


class TransformerConv(eqx.Module):
    """Scaled dot-product attention with a gated skip (paper equation 4; Shi et al. 2021).

    PyG's `TransformerConv` with `concat=False` (heads are averaged) and `beta=True`.
    """

    query: Linear
    key: Linear
    value: Linear
    skip: Linear
    gate: Float[Array, " thrice_outputs"]
    heads: int = eqx.field(static=True)

    def __call__(
        self, x: Float[Array, "unit inputs"], graph: Graph
    ) -> Float[Array, "unit outputs"]:
        """(unit, inputs) to (unit, outputs)."""
        query, key, value = (
            _split(layer(x), self.heads) for layer in (self.query, self.key, self.value)
        )
        scores = whole_gradient(graph.products(query, key) / query.shape[-1] ** 0.5, self.gate)
        heard, own = (
            whole_gradient(graph.attend(scores, value), self.gate).mean(axis=1),
            self.skip(x),
        )
        gate = jax.nn.sigmoid(jnp.concatenate([heard, own, heard - own], axis=-1) @ self.gate)
        return whole_gradient(gate[:, None] * own + (1 - gate[:, None]) * heard, self.gate)


def _split(x: Float[Array, "unit outputs"], heads: int) -> Float[Array, "unit *head feature"]:
    """Split the last axis into heads; a single head gets no axis, which XLA on CPU is slow with."""
    return x.reshape(x.shape[0], heads, -1) if heads > 1 else x


class LayerNorm(eqx.Module):
    """`layer_norm` with a learned scale and shift (torch.nn.LayerNorm)."""

    scale: Float[Array, " feature"]
    shift: Float[Array, " feature"]

    def __call__(self, x: Float[Array, "*rows feature"]) -> Float[Array, "*rows feature"]:
        """Normalised over the last axis."""
        return layer_norm(x) * self.scale + self.shift


class Head(eqx.Module):
    """Linear layers with GELU between them."""

    layers: list[Linear]

    def __call__(self, x: Float[Array, "*rows inputs"]) -> Float[Array, "*rows outputs"]:
        """(..., inputs) to (..., outputs)."""
        for layer in self.layers[:-1]:
            x = gelu(layer(x))
        return self.layers[-1](x)


class Recall(eqx.Module):
    """What a unit remembers: a gated recurrent cell (Cho et al. 2014) on its features.

    What it recalls is added to the features; at first that is nothing.
    """

    cell: eqx.nn.GRUCell
    recalled: Linear

    def __call__(
        self, features: Float[Array, "unit 128"], memory: Float[Array, "unit 128"]
    ) -> tuple[Float[Array, "unit 128"], Float[Array, "unit 128"]]:
        """The features with what is recalled, and the memory after this step."""
        after = jax.vmap(self.cell)(features, memory)
        return features + self.recalled(after), after


def recall(key: PRNGKeyArray) -> Recall:
    """A cell with Equinox's fresh weights."""
    cell = eqx.nn.GRUCell(WIDTH, WIDTH, key=key)
    return Recall(cell, Linear(jnp.zeros((WIDTH, WIDTH)), jnp.zeros(WIDTH)))


def linear(key: PRNGKeyArray, inputs: int, outputs: int, gain: float = 1.0) -> Linear:
    """Weights and biases uniform within 1 / sqrt(inputs), torch's default, times the gain."""
    weight_key, bias_key = jr.split(key)
    bound = gain / inputs**0.5
    return Linear(
        jr.uniform(weight_key, (inputs, outputs), minval=-bound, maxval=bound),
        jr.uniform(bias_key, (outputs,), minval=-bound, maxval=bound),
    )


def _glorot(key: PRNGKeyArray, rows: int, columns: int) -> Float[Array, "rows columns"]:
    """Uniform as Glorot has it: PyG's default."""
    bound = (6.0 / (rows + columns)) ** 0.5
    return jr.uniform(key, (rows, columns), minval=-bound, maxval=bound)


def _glorot_linear(key: PRNGKeyArray, inputs: int, outputs: int) -> Linear:
    return Linear(_glorot(key, inputs, outputs), jnp.zeros(outputs))


def gcn_conv(key: PRNGKeyArray, inputs: int, outputs: int, improved: bool = False) -> GCNConv:
    """Weights uniform as Glorot has them, biases zero: PyG's defaults."""
    return GCNConv(_glorot_linear(key, inputs, outputs), improved)


def gatv2_conv(key: PRNGKeyArray, inputs: int, features: int, heads: int) -> GATv2Conv:
    """Weights uniform as Glorot has them, biases zero: PyG's defaults."""
    source_key, target_key, attention_key = jr.split(key, 3)
    return GATv2Conv(
        source=_glorot_linear(source_key, inputs, heads * features),
        target=_glorot_linear(target_key, inputs, heads * features),
        attention=_glorot(attention_key, heads, features),
        bias=jnp.zeros(heads * features),
    )


def transformer_conv(key: PRNGKeyArray, inputs: int, outputs: int, heads: int) -> TransformerConv:
    """Weights and biases uniform within 1 / sqrt(inputs), PyG's default here."""
    *keys, skip_key, gate_key = jr.split(key, 5)
    query, key_, value = (linear(k, inputs, heads * outputs) for k in keys)
    skip, gate = linear(skip_key, inputs, outputs), linear(gate_key, 3 * outputs, 1)
    return TransformerConv(query, key_, value, skip, gate.weight[:, 0], heads)


def new_layer_norm(features: int) -> LayerNorm:
    """Scale 1, shift 0."""
    return LayerNorm(jnp.ones(features), jnp.zeros(features))


def layer_norm(x: Float[Array, "*rows feature"]) -> Float[Array, "*rows feature"]:
    """Zero mean and unit variance over the last axis, without parameters (epsilon 1e-5)."""
    centred = x - x.mean(axis=-1, keepdims=True)
    return centred * jax.lax.rsqrt((centred**2).mean(axis=-1, keepdims=True) + 1e-5)


def gelu(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """x times the normal distribution function of x, exact as in torch.

    By erf: `jax.nn.gelu` takes erfc, which XLA on a CPU computes in several more passes.
    """
    return 0.5 * x * (1.0 + jax.lax.erf(x * 0.5**0.5))


def head(key: PRNGKeyArray, sizes: list[int], last_gain: float = 1.0) -> Head:
    """Fresh layers of these sizes; the last one's weights are scaled."""
    keys = jr.split(key, len(sizes) - 1)
    gains = [1.0] * (len(sizes) - 2) + [last_gain]
    return Head([linear(*args) for args in zip(keys, sizes[:-1], sizes[1:], gains, strict=True)])
