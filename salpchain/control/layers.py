"""Layers that controllers share, with the meaning and defaults of PyTorch (Geometric)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.control.graph import Graph

WIDTH = 128  # features of a hidden layer (paper Table 3)
ACTOR_GAIN = 0.01  # of an actor's last layer, so that training starts from no thrust (chosen)


class Linear(eqx.Module):
    """x W + b on the last axis (torch.nn.Linear, W transposed)."""

    weight: Float[Array, "inputs outputs"]
    bias: Float[Array, " outputs"]

    def __call__(self, x: Float[Array, "*rows inputs"]) -> Float[Array, "*rows outputs"]:
        """(..., inputs) to (..., outputs)."""
        return x @ self.weight + self.bias


class GCNConv(eqx.Module):
    """Graph convolution with symmetric normalisation (paper equation 2; PyG `GCNConv`)."""

    linear: Linear

    def __call__(
        self, x: Float[Array, "unit inputs"], graph: Graph
    ) -> Float[Array, "unit outputs"]:
        """Sum over the nodes j seen by i of W x_j / sqrt(degree_i degree_j), plus the bias.

        The sum is taken before the product: the same, and cheaper where inputs are few.
        """
        scale = jax.lax.rsqrt(graph.degree().astype(x.dtype))[:, None]
        return self.linear(scale * graph.gather(scale * x))


class Head(eqx.Module):
    """Linear layers with GELU between them."""

    layers: list[Linear]

    def __call__(self, x: Float[Array, "*rows inputs"]) -> Float[Array, "*rows outputs"]:
        """(..., inputs) to (..., outputs)."""
        for layer in self.layers[:-1]:
            x = gelu(layer(x))
        return self.layers[-1](x)


def linear(key: PRNGKeyArray, inputs: int, outputs: int, gain: float = 1.0) -> Linear:
    """Weights and biases uniform within 1 / sqrt(inputs), torch's default, times the gain."""
    weight_key, bias_key = jr.split(key)
    bound = gain / inputs**0.5
    return Linear(
        jr.uniform(weight_key, (inputs, outputs), minval=-bound, maxval=bound),
        jr.uniform(bias_key, (outputs,), minval=-bound, maxval=bound),
    )


def gcn_conv(key: PRNGKeyArray, inputs: int, outputs: int) -> GCNConv:
    """Weights uniform as Glorot has them, biases zero: PyG's defaults."""
    bound = (6.0 / (inputs + outputs)) ** 0.5
    weight = jr.uniform(key, (inputs, outputs), minval=-bound, maxval=bound)
    return GCNConv(Linear(weight, jnp.zeros(outputs)))


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
